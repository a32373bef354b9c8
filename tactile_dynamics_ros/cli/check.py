"""`tactile-dynamics check`: is a recording fit for an estimate, while more can be recorded?"""

from __future__ import annotations

import json
from argparse import Namespace, _SubParsersAction
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    model_of,
    read_joint_torques,
    read_pushed,
    read_recording,
)
from tactile_dynamics_ros.core.options import POSITIVE

if TYPE_CHECKING:
    from tactile_dynamics_ros.api.readiness import Readiness


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "check",
        description="Tell whether a recording is fit for an estimate, in words: rates and gaps, "
        "clocks, suspicious units, how well each parameter is known, and which further motion "
        "would bring it to the goal. The exit code is 0 if it is ready and 3 if not.",
    )
    add_recording_arguments(parser, effects=False)
    parser.add_argument(
        "--goal",
        type=POSITIVE,
        default=10.0,
        metavar="PERCENT",
        help="wanted standard deviation: of the mass, of the centre of mass over the radius of "
        "gyration, of I_ij over sqrt(I_ii I_jj) (10)",
    )
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Check and print."""
    found = _checked(args)
    print(json.dumps(found.to_json()) if args.json else found)
    return 0 if found.ready else 3


def _checked(args: Namespace) -> Readiness:
    from tactile_dynamics_ros.api.verbs import check

    kind, goal = model_of(args), args.goal / 100.0
    if kind == "joints":
        return check(read_joint_torques(args), goal)
    return check(read_pushed(args) if kind == "pushed" else read_recording(args), goal)
