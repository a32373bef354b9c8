"""`tactile-dynamics estimate`: inertia of the held object, and parameters of effects."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    model_of,
    pushed_effects,
    read_beside,
    read_effects,
    read_joint_torques,
    read_pushed,
    read_recording,
)
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.options import (
    FINITE,
    POSITIVE,
    Number,
    Numbers,
    file_to_write,
    folder_to_write,
)
from tactile_dynamics_ros.core.rigid_body.rotation import pose_of

if TYPE_CHECKING:
    from tactile_dynamics_ros.api.estimates import Estimate
    from tactile_dynamics_ros.api.joint_estimates import EstimateOfJoints
    from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
    from tactile_dynamics_ros.recording import Recording


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("estimate")
    add_recording_arguments(parser)
    parser.add_argument(
        "--out",
        type=folder_to_write,
        metavar="DIR",
        help="also write DIR/report.html with figures",
    )
    parser.add_argument(
        "--export",
        metavar="FORMAT",
        help="print the body as urdf, sdf, mjcf, ur (payload call), franka (SetLoad request), "
        "xarm, kuka, control_toolbox, admittance_controller or moveit (attached object) instead; "
        "refused if the recording does not determine it",
    )
    parser.add_argument(
        "--shape",
        metavar="FILE",
        help="the object fills this shape; its density is estimated: mesh (m), "
        "cloud of points from all sides, yaml file of an object, or JSON of `shape` (axes of its "
        "first part); --export moveit prints it too, if it is a mesh or yaml file",
    )
    parser.add_argument(
        "--shape-pose",
        nargs=6,
        type=FINITE,
        metavar=("X", "Y", "Z", "ROLL", "PITCH", "YAW"),
        help="pose of the shape in the object's frame, m and deg (default: identical)",
    )
    parser.add_argument(
        "--tool",
        metavar="FILE",
        help="subtract this known part, such as a gripper: a URDF (FILE#LINK if "
        "it has several), or a file of --save",
    )
    parser.add_argument(
        "--prior",
        metavar="FILE",
        help="estimate of the same object from earlier recordings, written by --save",
    )
    parser.add_argument(
        "--wrist",
        metavar="HAND",
        help="also use /wrist/wrench of the same bag; HAND: file that `--carried --save` wrote "
        "with the empty hand, its fingers closed as they hold the object",
    )
    parser.add_argument(
        "--carried",
        action="store_true",
        help="estimate all that the wrist sensor carries, not the object, in the flange's frame "
        "(from /wrist/wrench and /joint_states)",
    )
    parser.add_argument(
        "--robot",
        metavar="NAME",
        help="robot of --wrist and --carried: file in config/robots, or path of a yaml file; of "
        "an arm by its joint torques: its URDF, as --urdf",
    )
    parser.add_argument(
        "--without",
        metavar="BAG",
        help="for an arm by its joint torques: a recording without the payload; if the motion is "
        "the same, friction and model errors cancel",
    )
    parser.add_argument(
        "--known-load",
        type=POSITIVE,
        metavar="KG",
        help="for an arm by its joint torques: known mass of the payload; calibrates drives that "
        "report currents",
    )
    parser.add_argument(
        "--stiffness",
        type=Numbers(POSITIVE),
        metavar="K[,KY]",
        help="of a robot that pushes without a force sensor, N/m, or along x and y of the table: "
        "its force is that times how far /pusher/pose stays behind /pusher/target",
    )
    parser.add_argument(
        "--stiffness-std",
        type=Number(0.0, 1.0, above=True),
        default=0.1,
        metavar="SHARE",
        help="how well that is known, as a share of it (0.1); it is in the intervals",
    )
    parser.add_argument(
        "--save",
        type=file_to_write,
        metavar="FILE",
        help="write what is known of the body now, for --tool or --prior",
    )
    parser.add_argument(
        "--model",
        choices=("auto", "held", "pushed", "joints"),
        default="auto",
        help="what was recorded: an object held, one pushed on a support, or an arm by its joint "
        "torques; auto decides by the topics",
    )
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Estimate and print; the exit code is 3 where the numbers are no answer."""
    if args.shape_pose and not args.shape:
        raise BadInputError("--shape-pose is of --shape; name its file too")
    args.model = model_of(args)  # asked of the recording once
    if args.model == "pushed":
        return _estimate_pushed(args)
    if args.model == "joints":
        return _estimate_joints(args)
    from tactile_dynamics_ros.api.verbs import estimate

    if args.stiffness:
        raise BadInputError("--stiffness: for an object on a support; leave it out")
    if args.without or args.known_load:
        raise BadInputError("--without, --known-load: for an arm by its joint torques")
    known = {"tool": args.tool, "prior": args.prior}
    if _as_prior(args):
        known |= {"shape": args.shape, "shape_pose": _shape_pose(args)}
    if args.carried:
        found = estimate(_read_wrist(args), read_effects(args), **known)
    elif args.wrist:
        wrist = {"wrist": _read_wrist(args), "hand": args.wrist}
        found = estimate(read_recording(args), read_effects(args), **known, **wrist)
    else:
        found = estimate(read_recording(args), read_effects(args), **known)
    return _told(args, found, _export(args, found) if args.export else None)


def _as_prior(args: Namespace) -> bool:
    """Whether a shape counts; beside tool, prior or wrist, --export moveit prints it and no more.

    Raises:
        BadInputError: it can neither count nor be printed.
    """
    beside = args.tool or args.prior or args.wrist or args.carried
    if args.shape and beside and args.export != "moveit":
        raise BadInputError("--shape: of the recording alone; leave out tool, prior and wrist")
    return bool(args.shape and not beside)


def _shape_pose(args: Namespace) -> Array | None:
    if args.shape_pose is None:
        return None
    return pose_of(args.shape_pose[:3], np.deg2rad(args.shape_pose[3:]))


def _read_wrist(args: Namespace) -> Recording:
    """Read what the wrist carried.

    Raises:
        BadInputError: options contradict each other, or it cannot be read.
    """
    from tactile_dynamics_ros.api.wrist import read_wrist

    if args.carried and args.wrist:
        raise BadInputError("--carried takes hand and object together; leave out --wrist")
    if len(args.bag) > 1:
        raise BadInputError(f"the wrist helps with one recording; {len(args.bag)} are given")
    return read_wrist(args.bag[0], args.robot, args.namespace)


def _estimate_pushed(args: Namespace) -> int:
    """Estimate what was pushed or pulled over a support, and print.

    Raises:
        BadInputError: an option is asked for that holds for held objects only.
        NotIdentifiableError: the recording does not determine the friction force.
    """
    from tactile_dynamics_ros.api.verbs import estimate

    if args.shape:
        raise BadInputError("--shape is for held objects; leave it out")
    if args.stiffness and args.prior:
        raise BadInputError("--prior: its doubt of the stiffness is the same one; leave it out")
    return _told(args, estimate(read_pushed(args), pushed_effects(args), prior=args.prior))


def _estimate_joints(args: Namespace) -> int:
    """Estimate payload and friction of an arm by its joint torques, and print.

    Raises:
        BadInputError: an option is asked for that holds for held objects only.
        NotIdentifiableError: the model does not fit.
    """
    from tactile_dynamics_ros.api.verbs import estimate

    if args.stiffness:
        raise BadInputError("--stiffness: for an object on a support; leave it out")
    if args.prior:
        raise BadInputError("--prior: not for an arm by its joint torques; leave it out")
    recording, empty = read_joint_torques(args), args.without
    if empty is not None:
        empty = read_beside(args, recording)
    known = {"without": empty, "known_load": args.known_load}
    found = estimate(recording, pushed_effects(args), **known)
    return _told(args, found)


def _told(
    args: Namespace,
    found: Estimate | EstimateOfPushes | EstimateOfJoints,
    block: str | None = None,
) -> int:
    """Print an estimate, or a block of it, write its report, and keep what is known.

    Raises:
        BadInputError: the file to write is that of another object.
        NotIdentifiableError: the numbers are no answer.
    """
    for note in found.notes:
        print(f"note: {note}", file=sys.stderr)
    if block is None:
        print(json.dumps(found.to_json()) if args.json else found)
    else:
        print(block, end="")
    if args.out:
        print(f"report: {found.report(Path(args.out))}", file=sys.stderr)
    found.require_answer()
    if args.save:
        print(f"saved: {found.save(args.save)}", file=sys.stderr)
    return 0


def _export(args: Namespace, found: Estimate) -> str:
    """Return the block; say on stderr what is not in it.

    Raises:
        BadInputError: JSON is wanted as well.
        NotIdentifiableError: the recording does not determine what the format needs.
    """
    if args.json:
        raise BadInputError("--export prints the block alone; leave out --json")
    block = found.export(args.export, shape=args.shape if args.export == "moveit" else None)
    for line in block.doubts:
        print(f"warning: {line}", file=sys.stderr)
    for line in block.left_out:
        print(f"note: left out: {line}", file=sys.stderr)
    return block.text
