"""What verbs that read a recording have in common, of probes of friction too."""

from __future__ import annotations

import sys
from argparse import Action, ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.api.questions import Question, question_friction
from tactile_dynamics_ros.api.reading import effects_of, names_of, read_pushed_recording
from tactile_dynamics_ros.api.reading import read_recording as recording_of
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.options import span
from tactile_dynamics_ros.recording.bag_options import add_bag_arguments

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect
    from tactile_dynamics_ros.core.planar.tip import Stiffness
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.joints import JointRecording
    from tactile_dynamics_ros.recording.pushed import PushedRecording


def add_model_argument(parser: ArgumentParser) -> None:
    """Add the choice between the models that a recording can be held against."""
    parser.add_argument(
        "--model",
        choices=("auto", "held", "pushed", "friction", "joints"),
        default="auto",
        help="rigid body in the hand, object on a support, Coulomb friction of a probe, or an arm "
        "by its joint torques; auto: by the topics",
    )


def is_probe_recording(args: Namespace) -> bool:
    """Whether the friction of a probe is to be questioned rather than a held body."""
    from tactile_dynamics_ros.recording.probe_slips import holds_slips

    if args.model != "auto":
        return bool(args.model == "friction")
    found = any(holds_slips(Path(bag), args.namespace) for bag in args.bag)
    if found:
        print("note: a friction probe's recording; Coulomb friction is compared", file=sys.stderr)
    return found


def ask_about_friction(args: Namespace) -> Question:
    """Fit Coulomb friction, with the named effects, to the slips of a recording.

    Raises:
        BadInputError: several recordings are given, or this one cannot be read.
    """
    if len(args.bag) > 1:
        raise BadInputError(
            f"{len(args.bag)} recordings, some of a friction probe; ask about one at a time"
        )
    [bag] = args.bag
    names = [name.strip() for name in args.effects.split(",") if name.strip()]
    return question_friction(Path(bag), names, args.namespace)


_QUESTIONS = ("diagnose", "explain")
"""Verbs that find out units for themselves, so that a recording is not refused for them."""


NEW_RECORDING = "new rosbag2 directory, or a single new file if the name ends in .mcap"
"""Help of every argument that names a recording to be written."""


class JoinNames(Action):
    """Names with commas between them; an option that is given again adds to those before."""

    def __call__(
        self, parser: ArgumentParser, namespace: Namespace, values: Any, option: str | None = None
    ) -> None:
        """Append the names."""
        before = getattr(namespace, self.dest)
        setattr(namespace, self.dest, f"{before},{values}" if before else values)


def add_recording_arguments(
    parser: ArgumentParser, optional: bool = False, effects: bool = True
) -> None:
    """Add the recording, its remappings and the effects of the model, unless it has none."""
    count = "?" if optional else "+"
    bag_help = "rosbag2 directory, .mcap, .db3 or ROS 1 .bag file"
    several = "" if optional else "; several of one object together, biases estimated for each"
    parser.add_argument("bag", metavar="BAG", nargs=count, help=bag_help + several)
    if effects:
        parser.add_argument(
            "--effects",
            action=JoinNames,
            default="",
            metavar="A,B",
            help="effects added to the model (see `tactile-dynamics effects`): names, or files "
            "that define them",
        )
        add_effect_file(parser)
    parser.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="RECORDED:=MEANT",
        help="read a recorded topic under the name that it stands for; repeatable, also for one "
        "topic that stands for several; columns of a table of an arm's joints, as 2-7:=position",
    )
    parser.add_argument(
        "--world-frame",
        metavar="FRAME",
        help="frame of the poses, z up, if it is neither `world` nor the base of a robot",
    )
    add_namespace(parser)
    add_bag_arguments(parser)
    parser.add_argument(
        "--between",
        type=span,
        metavar="START,STOP",
        help="use only this part, in seconds from the first pose",
    )
    parser.add_argument(
        "--assume",
        action="append",
        default=[],
        metavar="NAME",
        help="correct the recording for this convention, such as torque_unit (`diagnose` names "
        "them); the variant that fits best is used; or drive_units=G1,G2,.. with N m per unit of "
        "each joint; repeatable",
    )


def add_namespace(parser: ArgumentParser, default: str | None = None) -> None:
    """Add the namespace of the hand that is meant."""
    parser.add_argument(
        "--namespace",
        default=default,
        metavar="NS",
        help="namespace of the hand's topics, as left for /left/object/pose (default: root, or "
        "the only one)",
    )


def add_effect_file(parser: ArgumentParser) -> None:
    """Add the option that makes effects of one's own known."""
    parser.add_argument(
        "--effect-file",
        action="append",
        default=[],
        metavar="FILE",
        help="load effects from a .yaml or .py file, for --effects and as candidates; repeatable",
    )


def model_of(args: Namespace) -> str:
    """Return "pushed", "joints" or "held", as the option or the topics of the recording say.

    Raises:
        BadInputError: there is no recording at the path.
    """
    from tactile_dynamics_ros.recording.kinds import recorded_kind

    chosen = str(getattr(args, "model", "auto"))
    first = args.bag if isinstance(args.bag, str) else args.bag[0]
    if chosen != "auto":
        return chosen
    return recorded_kind(first, _parse_remappings(getattr(args, "remap", [])))


_HELD_ONLY = ("export", "tool", "wrist", "carried", "robot", "stamps", "urdf")
"""Options of the verbs that mean nothing for an object on a support."""


def read_pushed(args: Namespace) -> PushedRecording:
    """Read recordings of an object on a support; problems go to stderr, one line each.

    Raises:
        BadInputError: one cannot be read, an option holds for held objects only, several are not of
            one object, or the tip presses into the outline only if signs, units or axes are read
            another way.
    """
    from tactile_dynamics_ros.recording.pushed import PushedRecording

    asked = [name for name in _HELD_ONLY if getattr(args, name, None)]
    if asked:
        raise BadInputError(
            f"--{asked[0].replace('_', '-')}: not for an object on a support; leave it out"
        )
    span, bags = args.between, list(args.bag)
    if span and len(bags) > 1:
        raise BadInputError(f"--between cuts one recording; {len(bags)} are given")
    recordings = []
    for bag in bags:
        recording, notes = read_pushed_recording(
            bag,
            getattr(args, "assume", []),
            remap=_parse_remappings(args.remap),
            namespace=args.namespace,
            world_frame=args.world_frame,
            stiffness=_stiffness(args),
        )
        for line in [*recording.problem_lines(), *notes]:
            print(f"note: {line}", file=sys.stderr)
        recordings.append(recording)
    return recordings[0].between(*span) if span else PushedRecording.join(recordings)


def _stiffness(args: Namespace) -> Stiffness | None:
    """Return the robot's stiffness that the arguments state.

    Raises:
        BadInputError: neither one number nor two are given.
    """
    from tactile_dynamics_ros.core.planar.tip import Stiffness

    given = getattr(args, "stiffness", None)
    if not given:
        return None
    if len(given) > 2:
        raise BadInputError(f"--stiffness: {len(given)} numbers, expected one, or one of x and y")
    return Stiffness(np.array([given[0], given[-1]]), args.stiffness_std)


def read_joint_torques(args: Namespace) -> JointRecording:
    """Read the recording of an arm's joint torques; problems go to stderr, one line each.

    Raises:
        BadInputError: one cannot be read, there is no URDF, or an option holds for held objects
            only.
    """
    from tactile_dynamics_ros.api.reading import read_joints

    asked = [name for name in _HELD_ONLY if getattr(args, name, None)]
    asked = [name for name in asked if name not in ("urdf", "robot")]
    if asked:
        raise BadInputError(f"--{asked[0]}: not for an arm by its joint torques; leave it out")
    bags = [args.bag] if isinstance(args.bag, str) else args.bag
    robot = args.robot if args.verb == "estimate" else None
    recording = read_joints(bags, args.urdf or robot, _parse_remappings(args.remap))
    for line in recording.problem_lines():
        print(f"note: {line}", file=sys.stderr)
    recording = recording.between(*args.between) if args.between else recording
    for name in getattr(args, "assume", []):
        from tactile_dynamics_ros.core.joints.conventions import assumed

        streams, reading = assumed(recording.streams, name)
        print(f"note: read as {name}: {reading.change}", file=sys.stderr)
        recording = replace(recording, streams=streams)
    return recording


def read_beside(args: Namespace, recording: JointRecording) -> JointRecording:
    """Read the recording without the payload as that with it; problems go to stderr.

    Raises:
        BadInputError: it cannot be read.
    """
    from tactile_dynamics_ros.recording.joints import JointRecording

    remap, urdf = _parse_remappings(args.remap), recording.streams.urdf
    empty = JointRecording.read(args.without, known=urdf, remap=remap)
    for line in empty.problem_lines():
        print(f"note: without: {line}", file=sys.stderr)
    return empty


def pushed_effects(args: Namespace) -> list[str]:
    """Return the names of effects of a pushed object or of joints that the arguments name.

    Raises:
        BadInputError: a file of effects cannot be read.
    """
    read_effect_files(args)
    return names_of(args.effects)


def read_recording(args: Namespace) -> Recording:
    """Read the recordings that the arguments name; problems go to stderr, one line each.

    Returns:
        The recording, or several of one object joined.

    Raises:
        BadInputError: one cannot be read, no contact pushes, or a remapping is malformed.
    """
    from tactile_dynamics_ros.recording import Recording

    span = args.between
    bags = [args.bag] if isinstance(args.bag, str) else list(args.bag)
    if span and len(bags) > 1:
        raise BadInputError(f"--between cuts one recording; {len(bags)} are given")
    kind = model_of(args)
    if kind in ("pushed", "joints"):
        what = "an object on a support" if kind == "pushed" else "an arm by its joint torques"
        raise BadInputError(f"{bags[0]}: {what}; ask estimate, compare, diagnose or explain")
    recordings = [_read(bag, args) for bag in bags]
    recording = _part(recordings[0], *span) if span else Recording.join(recordings)
    for name in getattr(args, "assume", []):
        recording = _assume(recording, name)
    return recording


def _assume(recording: Recording, name: str) -> Recording:
    """Return a recording as it reads by a convention; say on stderr what that is.

    Raises:
        BadInputError: there is no such convention, or this recording cannot be read so.
    """
    from tactile_dynamics_ros.core.inertia.conventions.finder import assumed

    streams, reading = assumed(recording.streams, name)
    print(f"note: read as {name}: {reading.change}", file=sys.stderr)
    return replace(recording, streams=streams)


def _read(bag: str, args: Namespace) -> Recording:
    """Read one recording.

    Raises:
        BadInputError: it cannot be read, or no contact pushes.
    """
    assumed = getattr(args, "assume", [])
    recording = recording_of(
        bag,
        remap=_parse_remappings(args.remap),
        namespace=args.namespace,
        world_frame=getattr(args, "world_frame", None),
        any_unit=getattr(args, "verb", "") in _QUESTIONS or "acceleration_unit" in assumed,
        stamps=args.stamps,
        urdf=args.urdf,
    )
    for line in recording.problem_lines():
        print(f"note: {line}", file=sys.stderr)
    return recording


def _part(recording: Recording, start: float, stop: float) -> Recording:
    """Return a part of a recording.

    Raises:
        BadInputError: nothing was recorded then.
    """
    if start > recording.duration or stop <= 0.0:
        raise BadInputError(
            f"--between {start:g},{stop:g}: nothing was recorded then; {recording.source} lasts "
            f"from 0 to {recording.duration:.1f} s"
        )
    return recording.between(start, stop)


def _parse_remappings(arguments: list[str]) -> dict[str, list[str]]:
    """Return the names that each recorded topic stands for."""
    remap: dict[str, list[str]] = {}
    for argument in arguments:
        recorded, separator, meant = argument.partition(":=")
        if not separator or not meant or recorded.startswith("/") != meant.startswith("/"):
            raise BadInputError(
                f"--remap {argument}: expected /recorded/topic:=/meant/topic, or of a table of an "
                "arm's joints 2-7:=position"
            )
        remap.setdefault(recorded, []).append(meant)
    return remap


def read_effects(args: Namespace) -> list[Effect]:
    """Return the effects that the arguments name, those of files included.

    Raises:
        BadInputError: a name is unknown or given twice, or a file cannot be read.
    """
    own = read_effect_files(args)
    effects = effects_of(args.effects)
    if own and not set(own) & {effect.name for effect in effects}:
        known = ",".join(own)
        print(f"note: known now, not yet in the model: --effects {known}", file=sys.stderr)
    return effects


def read_effect_files(args: Namespace) -> list[str]:
    """Make the effects of all named files known and return their names.

    Raises:
        BadInputError: a file cannot be read, or two of them name an effect alike.
    """
    if not args.effect_file:
        return []
    from tactile_dynamics_ros.core.effects.formula import load_effects

    files: dict[str, str] = {}
    for path in args.effect_file:
        for effect in load_effects(path):
            first = files.setdefault(effect.name, path)
            if first != path:
                raise BadInputError(f"{path}: effect '{effect.name}' is in {first} too; rename one")
    return list(files)
