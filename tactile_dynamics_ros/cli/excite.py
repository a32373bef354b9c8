"""`tactile-dynamics excite`: the motion that would tell most about the object in the hand."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    read_effects,
    read_recording,
)
from tactile_dynamics_ros.cli.text_table import align_rows
from tactile_dynamics_ros.core.errors import BadInputError

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.excitation.plan import ExcitationPlan


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "excite",
        help="design the motion that reveals most about a held object, within arm and grip limits",
        description="Design a motion for the object, the grip and the present estimate that a "
        "recording shows. The motion is a table of Cartesian offsets (rotation vector in rad and "
        "translation in m, world axes) about the fingertips, zero at both ends.",
    )
    add_recording_arguments(parser)
    parser.add_argument("--duration", type=float, default=15.0, metavar="S", help="length (15)")
    parser.add_argument("--rotation", type=float, default=0.45, metavar="RAD", help="(0.45)")
    parser.add_argument("--translation", type=float, default=0.05, metavar="M", help="(0.05)")
    parser.add_argument("--highest-hz", type=float, default=1.5, metavar="HZ", help="(1.5)")
    parser.add_argument("--friction", type=float, default=0.6, metavar="MU", help="(0.6)")
    parser.add_argument("--criterion", choices=("A", "D"), default="A", help="mean error, volume")
    parser.add_argument("--arm", metavar="Q1,..,Q7", help="arm joints at the start, rad")
    parser.add_argument("--seed", type=int, default=0, help="of the search (0)")
    parser.add_argument("--out", metavar="FILE", help="write the motion here (JSON)")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Design, check on the arm, print and write."""
    from tactile_dynamics_ros.core.inertia.batch import fit_recording
    from tactile_dynamics_ros.core.inertia.excitation import DesignConfig, MotionLimits
    from tactile_dynamics_ros.core.inertia.excitation.plan import plan_excitation

    model = fit_recording(read_recording(args).streams, read_effects(args))
    plan = plan_excitation(
        model,
        DesignConfig(duration=args.duration, highest_hz=args.highest_hz, seed=args.seed),
        MotionLimits(rotation=args.rotation, translation=args.translation),
        args.friction,
        args.criterion,
        _parse_arm(args.arm),
    )
    if args.out:
        Path(args.out).write_text(json.dumps(plan.motion_table()) + "\n")
        print(f"motion: {args.out}", file=sys.stderr)
    print(json.dumps(plan.to_json()) if args.json else _describe(plan))
    return 0


def _parse_arm(argument: str | None) -> list[float] | None:
    if argument is None:
        return None
    try:
        joints = [float(part) for part in argument.split(",")]
    except ValueError as error:
        raise BadInputError(f"--arm {argument}: expected seven numbers Q1,..,Q7") from error
    if len(joints) != 7:
        raise BadInputError(f"--arm {argument}: expected seven numbers, got {len(joints)}")
    return joints


def _describe(plan: ExcitationPlan) -> str:
    """Return the plan for people."""
    rows = [("", "now", "after it", "unit")]
    rows += [
        (name, f"{now:.3g}", f"{after:.3g}", unit)
        for name, (now, after, unit) in plan.deviations().items()
    ]
    return "\n".join(
        [
            f"{plan.offsets.duration:.1f} s, at most {plan.grip_usage:.0%} of the friction cones",
            f"expected standard deviations (distance to the truth {plan.expected_before:.3g} -> "
            f"{plan.expected_after:.3g}):",
            align_rows(rows),
        ]
    )
