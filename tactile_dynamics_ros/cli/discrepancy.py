"""`tactile-dynamics compare | diagnose | explain`: what is missing from the model?"""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.api.discrepancies import Comparison, Diagnosis, Discrepancy, Explanation
from tactile_dynamics_ros.api.questions import (
    Question,
    question_held,
    question_joints,
    question_pushed,
)
from tactile_dynamics_ros.cli.progress import shown_progress
from tactile_dynamics_ros.cli.recordings import (
    add_model_argument,
    add_recording_arguments,
    ask_about_friction,
    is_probe_recording,
    model_of,
    pushed_effects,
    read_effects,
    read_joint_torques,
    read_pushed,
    read_recording,
)
from tactile_dynamics_ros.core.options import file_to_write, folder_to_write

_VERBS: dict[str, Any] = {
    "compare": Comparison,
    "diagnose": Diagnosis,
    "explain": Explanation,
}


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the three verbs."""
    for name in _VERBS:
        parser = verbs.add_parser(name)
        add_recording_arguments(parser)
        add_model_argument(parser)
        parser.add_argument(
            "--out",
            type=folder_to_write,
            metavar="DIR",
            help="also write DIR/report.html with figures",
        )
        if name == "diagnose":
            parser.add_argument(
                "--learn",
                type=file_to_write,
                metavar="LAW.yaml",
                help="learn the law of what no known effect explains (held and pushed objects); "
                "the file is for --effects of any verb",
            )
        parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Ask and print."""
    kind = _VERBS[args.verb]
    ask = _ask(args)
    with shown_progress(args.json):
        result: Discrepancy = kind.of(ask())
        if getattr(args, "learn", None):
            result = result.learn(args.learn)
    for note in result.notes:
        print(f"note: {note}", file=sys.stderr)
    print(json.dumps(result.to_json()) if args.json else result)
    if args.out:
        page = result.report(Path(args.out), f"tactile-dynamics {args.verb} ...")
        print(f"report: {page}", file=sys.stderr)
    return 0


def _ask(args: Namespace) -> Callable[[], Question]:
    """Read the recording; what is returned fits the model that suits it."""
    if is_probe_recording(args):
        return lambda: ask_about_friction(args)
    args.model = model_of(args)  # asked of the recording once
    if args.model == "pushed":
        return partial(question_pushed, read_pushed(args), pushed_effects(args))
    if args.model == "joints":
        return partial(question_joints, read_joint_torques(args), pushed_effects(args))
    return partial(question_held, read_recording(args), read_effects(args))
