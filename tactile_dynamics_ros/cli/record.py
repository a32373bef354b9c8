"""`tactile-dynamics record`: live topics to a rosbag2 recording."""

from __future__ import annotations

import json
import time
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.cli.bringup import read_namespace
from tactile_dynamics_ros.cli.domain import stay_on_this_host
from tactile_dynamics_ros.cli.live import StopRequest


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("record", help="record live topics to a rosbag2 directory (MCAP)")
    parser.add_argument("out", metavar="OUT", help="new directory of the recording")
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="all but images if none")
    parser.add_argument(
        "--namespace", default="", metavar="NS", help="only this hand's topics, and global ones"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="stop after S seconds")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Record until Ctrl-C, SIGTERM or the end of the duration."""
    stay_on_this_host()
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from tactile_dynamics_ros.ros.recorder import Recorder
    from tactile_dynamics_ros.ros.shell import finish_bursts, spin

    finish_bursts()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        recorder = Recorder(Path(args.out), args.topics, read_namespace(args.namespace))
        end = time.monotonic() + (args.duration or float("inf"))
        with StopRequest() as stop:
            spin(recorder, lambda: stop.requested or time.monotonic() > end)
            recorder.close()
    finally:
        rclpy.try_shutdown()
    total = recorder.counts.total()
    counts = dict(sorted(recorder.counts.items()))
    if args.json:
        print(json.dumps({"recording": args.out, "messages": total, "topics": counts}))
    else:
        print(f"{args.out}: {total} messages of {len(counts)} topics")
    return 0
