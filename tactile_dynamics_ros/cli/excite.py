"""`tactile-dynamics excite`: the motion that would determine most of the object in the hand."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.result import align_rows
from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    read_effects,
    read_joint_torques,
    read_recording,
)
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.options import (
    FINITE,
    NOT_NEGATIVE,
    POSITIVE,
    SEED,
    Numbers,
    file_to_write,
)
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT, load_robot
from tactile_dynamics_ros.recording.kinds import recorded_kind
from tactile_dynamics_ros.share import object_file

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.excitation.plan import ExcitationPlan
    from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite

_UNSHAPED = (
    "no shapes of links (meshes not found, or none named); the motion keeps the joints apart, not "
    "the links: look at it first, or give --urdf beside its meshes"
)
"""What is said of a motion that knows nothing of the links' shapes. Words, no number."""
_PRESUMED_MASS = 0.3
"""Mass of an object before it was held, kg: between those of config/objects (0.1 to 0.8 kg)."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "excite",
        description="Design a motion for the object, the grip and the present estimate that a "
        "recording shows or, before the first grasp, for an object's grasp site. The motion is a "
        "table of Cartesian offsets (rotation vector in rad and translation in m, world axes) "
        "about the fingertips, zero at both ends. Of an arm by its joint torques (BAG, or --urdf "
        "alone) it is a trajectory_msgs/JointTrajectory as JSON.",
    )
    add_recording_arguments(parser, optional=True)
    parser.add_argument("--object", metavar="NAME", help="instead of BAG: file in config/objects")
    parser.add_argument("--mass", type=POSITIVE, metavar="KG", help="presumed, with --object (0.3)")
    parser.add_argument("--duration", type=POSITIVE, default=15.0, metavar="S", help="length (15)")
    parser.add_argument(
        "--rotation",
        type=NOT_NEGATIVE,
        default=0.45,
        metavar="RAD",
        help="largest rotation of the motion (0.45)",
    )
    parser.add_argument(
        "--translation",
        type=NOT_NEGATIVE,
        default=0.05,
        metavar="M",
        help="largest shift of the motion (0.05)",
    )
    parser.add_argument(
        "--highest-hz",
        type=POSITIVE,
        default=1.5,
        metavar="HZ",
        help="highest frequency of the motion (1.5)",
    )
    parser.add_argument(
        "--friction",
        type=POSITIVE,
        default=0.6,
        metavar="MU",
        help="coefficient between finger and object (0.6)",
    )
    parser.add_argument("--criterion", choices=("A", "D"), default="A", help="mean error, volume")
    parser.add_argument(
        "--arm",
        type=Numbers(FINITE),
        metavar="Q1,Q2,..",
        help="with BAG: arm joints at the start, rad",
    )
    parser.add_argument(
        "--robot",
        metavar="NAME",
        default=DEFAULT_ROBOT,
        help=f"file in config/robots, or path of a yaml file ({DEFAULT_ROBOT})",
    )
    parser.add_argument(
        "--floor",
        type=FINITE,
        default=0.05,
        metavar="M",
        help="of an arm by its torques: height in its base above which its links stay (0.05)",
    )
    parser.add_argument("--seed", type=SEED, default=0, help="of the search (0)")
    parser.add_argument(
        "--out", type=file_to_write, metavar="FILE", help="write the motion here (JSON)"
    )
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Design, check on the arm, print and write."""
    if _is_of_joints(args):
        return _excite_joints(args)
    plan = _plan(args)
    if args.out:
        with written_whole(Path(args.out)) as part:
            part.write_text(json.dumps(plan.motion_table()) + "\n")
        print(f"motion: {args.out}", file=sys.stderr)
    print(json.dumps(plan.to_json()) if args.json else _describe(plan))
    return 0


def _is_of_joints(args: Namespace) -> bool:
    """Whether the motion is one of an arm by its joint torques."""
    if args.object is not None:
        return False
    return bool(args.urdf) if args.bag is None else recorded_kind(args.bag) == "joints"


def _excite_joints(args: Namespace) -> int:
    """Design a motion in joint space, print what it tells, and write it."""
    from tactile_dynamics_ros.core.joints.arm import Arm
    from tactile_dynamics_ros.core.joints.estimate import fit
    from tactile_dynamics_ros.core.joints.excitation import JointLimits, design_motion
    from tactile_dynamics_ros.core.reading import read_text
    from tactile_dynamics_ros.core.robot.kinematic_tree import read_tree
    from tactile_dynamics_ros.core.weighing.arm import SerialArm

    limits = JointLimits(duration=args.duration, floor=args.floor)
    folder = str(Path(args.urdf).parent) if args.urdf else ""
    if args.bag is None:
        urdf = read_text(Path(args.urdf), "a URDF")
        names = [j.name for j in read_tree(urdf, args.urdf) if j.axis is not None]
        arm, known = Arm.from_urdf(urdf, names, args.urdf), None
    else:
        streams = read_joint_torques(args).streams
        model, urdf = fit(streams), streams.urdf
        arm, known = model.samples.arm, model.learned
    shape = SerialArm.of_urdf(urdf, "", arm.flange, folder, drawn=True)
    motion = design_motion(arm, limits, known, args.seed, shape=shape)
    if shape.by_bodies is None:
        print(f"{Path(args.urdf or args.bag).name}: {_UNSHAPED}", file=sys.stderr)
    before, after = motion.mass_std
    if args.out:
        with written_whole(Path(args.out)) as part:
            part.write_text(json.dumps(motion.to_document()) + "\n")
        print(f"motion: {args.out}", file=sys.stderr)
    if args.json:
        expected = {"payload_mass_std_before": before, "payload_mass_std_after": after}
        print(json.dumps({"duration_s": limits.duration, **expected, **motion.to_document()}))
    else:
        print(
            f"{limits.duration:.1f} s of {len(motion.names)} joints; a payload's mass would be "
            f"known to {after:.3g} kg (now {before:.3g} kg), by the URDF's masses; the same motion "
            "without the payload tells far more"
        )
    return 0


def _plan(args: Namespace) -> ExcitationPlan:
    """Design for the recording or the object that the arguments name.

    Raises:
        BadInputError: both or none of them are named, or an option goes with the other one.
    """
    from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
    from tactile_dynamics_ros.core.inertia.excitation import DesignConfig, MotionLimits
    from tactile_dynamics_ros.core.inertia.excitation.plan import (
        plan_excitation,
        plan_first_excitation,
    )

    if (args.bag is None) == (args.object is None):
        raise BadInputError("excite: expected a recording, or --object NAME before the first grasp")
    beside, needed = ("mass", "--object") if args.object is None else ("arm", "a recording")
    if getattr(args, beside) is not None:
        raise BadInputError(f"excite: --{beside} goes with {needed}; leave it out")
    robot = load_robot(args.robot)
    config = DesignConfig(duration=args.duration, highest_hz=args.highest_hz, seed=args.seed)
    limits = MotionLimits(rotation=args.rotation, translation=args.translation)
    if args.object is not None:
        site = _grasp_site(args.object)
        mass = _PRESUMED_MASS if args.mass is None else args.mass
        return plan_first_excitation(
            site, config, limits, mass, args.friction, args.criterion, robot
        )
    if args.arm is not None and len(args.arm) != robot.arm_dof:
        raise BadInputError(
            f"--arm: {len(args.arm)} numbers, expected {robot.arm_dof}, one for each arm joint"
        )
    model = fit_with_readings(read_recording(args).streams, read_effects(args))
    return plan_excitation(model, config, limits, args.friction, args.criterion, args.arm, robot)


def _grasp_site(name: str) -> GraspSite:
    from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite

    return GraspSite.from_file(object_file(name))


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
