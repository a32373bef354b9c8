"""`tactile-dynamics record`: live topics to a rosbag2 recording."""

from __future__ import annotations

import json
import sys
import time
from argparse import Namespace, _SubParsersAction
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.bringup import read_namespace
from tactile_dynamics_ros.cli.domain import stay_on_this_host
from tactile_dynamics_ros.cli.live import StopRequest
from tactile_dynamics_ros.cli.recordings import NEW_RECORDING
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import reason_of
from tactile_dynamics_ros.core.options import POSITIVE, path_to_write

if TYPE_CHECKING:
    from tactile_dynamics_ros.cli.record_check import RecordCheck
    from tactile_dynamics_ros.ros.recorder import Recorder


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("record")
    parser.add_argument("out", type=path_to_write, metavar="OUT", help=NEW_RECORDING)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="all but images if none")
    parser.add_argument(
        "--namespace", default="", metavar="NS", help="only this hand's topics, and global ones"
    )
    parser.add_argument("--duration", type=POSITIVE, metavar="S", help="stop after S seconds")
    parser.add_argument(
        "--check",
        type=POSITIVE,
        nargs="?",
        const=20.0,
        metavar="S",
        help="say every S seconds (20), here and on /diagnostics, whether what is recorded of a "
        "held object is fit for an estimate, and what to record as well",
    )
    parser.set_defaults(run=run)


@contextmanager
def _checked(args: Namespace, recorder: Recorder) -> Iterator[RecordCheck | None]:
    """What checks the recording while it grows; None if that is not wanted."""
    if args.check is None:
        yield None
        return
    from tactile_dynamics_ros.cli.record_check import RecordCheck

    namespace = args.namespace or None
    check = RecordCheck(recorder, str(recorder.folder), namespace, args.check, args.json)
    try:
        yield check
    finally:
        check.close()


def run(args: Namespace) -> int:
    """Record until Ctrl-C, SIGTERM or the end of the duration."""
    stay_on_this_host()
    import rclpy

    from tactile_dynamics_ros.ros.recorder import Recorder
    from tactile_dynamics_ros.ros.shell import finish_bursts, spin
    from tactile_dynamics_ros.ros.startup import start_tool

    finish_bursts()
    start_tool()
    try:
        recorder = Recorder(Path(args.out), args.topics, read_namespace(args.namespace))
        end = time.monotonic() + (args.duration or float("inf"))
        with StopRequest() as stop, _checked(args, recorder) as check:
            print(f"recording to {args.out}; Ctrl-C ends it", file=sys.stderr, flush=True)

            def is_over() -> bool:
                if check is not None:
                    check.advance()
                return stop.requested or time.monotonic() > end

            try:
                spin(recorder, is_over)
            finally:
                recorder.close()
    except OSError as error:
        raise BadInputError(
            f"{args.out}: {reason_of(error)}; recording has ended, what was written before is kept"
        ) from error
    finally:
        rclpy.try_shutdown()
    total = recorder.counts.total()
    counts = dict(sorted(recorder.counts.items()))
    if args.json:
        print(json.dumps({"recording": args.out, "messages": total, "topics": counts}))
    else:
        print(f"{args.out}: {total} messages of {len(counts)} topics")
    return 0
