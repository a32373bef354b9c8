"""`tactile-dynamics synthetic`: a recording with known truth."""

from __future__ import annotations

import json
from argparse import SUPPRESS, ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.recordings import NEW_RECORDING, JoinNames
from tactile_dynamics_ros.core.errors import BadInputError, refuse_existing
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.options import (
    NOT_NEGATIVE,
    POSITIVE,
    SEED,
    Number,
    path_to_write,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.synthetic import HiddenRecording

_DURATION = Number(0.5, 3600.0)
"""Length of a recording, s: a few cycles of the fastest motion (2 Hz) fit in, and an hour at 1000
Hz fits in the memory of a small machine."""
_REPEATS = Number(0, 1000, whole=True)
"""Repetitions of one motion: each has noise of its own, and no day has room for a thousand."""
_INTERRUPTIONS, _ACTIONS = Number(0, 100, whole=True), Number(1, 1000, whole=True)
"""Contact breaks or gaps of the pose, and pushes: of more, a second would have several, or an hour
of simulation would not be enough."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("synthetic")
    forms = parser.add_subparsers(dest="form", metavar="FORM", required=True)
    held = forms.add_parser(
        "held", help="an object held and moved by four fingers, with hidden effects"
    )
    held.add_argument("out", type=path_to_write, metavar="OUT", help=NEW_RECORDING)
    held.add_argument(
        "--effect",
        action=JoinNames,
        default="",
        metavar="NAME[,..]",
        help="none: a clean recording",
    )
    held.add_argument("--seed", type=SEED, default=0)
    size = held.add_mutually_exclusive_group()
    size.add_argument(
        "--magnitude", type=NOT_NEGATIVE, help="multiple of the effect's typical size"
    )
    size.add_argument(
        "--whitened-rms",
        type=Number(1.0),
        default=2.0,
        help="choose the size that raises the whitened error to about this (default 2)",
    )
    _add_circumstances(held)
    held.add_argument(
        "--json", action="store_true", default=SUPPRESS, help="print only JSON on stdout"
    )
    held.set_defaults(run=run)
    _add_pushed(forms)
    _add_joints(forms)


def _add_joints(forms: _SubParsersAction[Any]) -> None:
    joints = forms.add_parser(
        "joints", help="an arm that moves, by the torques of its joints, with hidden effects"
    )
    joints.add_argument("out", type=path_to_write, metavar="OUT", help=NEW_RECORDING)
    joints.add_argument(
        "--effect",
        action=JoinNames,
        default="",
        metavar="NAME[,..]",
        help="none: rigid links, Coulomb and viscous friction",
    )
    joints.add_argument("--seed", type=SEED, default=0)
    joints.add_argument(
        "--magnitude", type=NOT_NEGATIVE, default=1.0, help="multiple of a typical size"
    )
    joints.add_argument("--urdf", metavar="FILE", help="of the arm (default: the KUKA iiwa)")
    joints.add_argument(
        "--payload", type=NOT_NEGATIVE, default=0.0, metavar="KG", help="at the flange"
    )
    joints.add_argument(
        "--repeat",
        type=_REPEATS,
        default=0,
        metavar="N",
        help="number of the repetition of the same motion: other noise",
    )
    joints.add_argument("--duration", type=_DURATION, default=30.0, help="s")
    joints.add_argument("--rate", type=Number(50.0, 2000.0), default=500.0, help="Hz")
    joints.add_argument(
        "--json", action="store_true", default=SUPPRESS, help="print only JSON on stdout"
    )
    joints.set_defaults(run=run)


def _add_pushed(forms: _SubParsersAction[Any]) -> None:
    pushed = forms.add_parser(
        "pushed", help="an object that is pushed or pulled over a table, with hidden effects"
    )
    pushed.add_argument("out", type=path_to_write, metavar="OUT", help=NEW_RECORDING)
    pushed.add_argument(
        "--effect",
        action=JoinNames,
        default="",
        metavar="NAME[,..]",
        help="none: a clean recording",
    )
    pushed.add_argument("--seed", type=SEED, default=0)
    pushed.add_argument(
        "--magnitude", type=NOT_NEGATIVE, default=1.0, help="multiple of a typical size"
    )
    pushed.add_argument(
        "--object", choices=["single", "rigid_pair", "jointed"], default="single", dest="kind"
    )
    pushed.add_argument("--action", choices=["push", "pull", "shake", "mixed"], default="push")
    pushed.add_argument("--count", type=_ACTIONS, default=6, help="of actions (default 6)")
    pushed.add_argument(
        "--speed", type=POSITIVE, nargs=2, default=[0.03, 0.2], metavar=("LOW", "HIGH"), help="m/s"
    )
    pushed.add_argument(
        "--variation",
        type=NOT_NEGATIVE,
        default=0.0,
        help="relative std of friction over the table",
    )
    pushed.add_argument(
        "--json", action="store_true", default=SUPPRESS, help="print only JSON on stdout"
    )
    pushed.set_defaults(run=run)


def _add_circumstances(held: ArgumentParser) -> None:
    held.add_argument("--duration", type=_DURATION, default=30.0, help="s")
    held.add_argument("--regrasp", action="store_true", help="three fingers move at half-time")
    held.add_argument("--contact-breaks", type=_INTERRUPTIONS, default=0)
    held.add_argument("--pose-gaps", type=_INTERRUPTIONS, default=0)
    held.add_argument("--stagger", action="store_true", help="sensors sample at different phases")
    held.add_argument(
        "--frames",
        choices=["finger", "normal"],
        default="finger",
        help="fingers roll and contact frames show it, or there is no roll and only a normal",
    )
    held.add_argument("--no-force-std", action="store_true", help="leave the force noise unstated")


def run(args: Namespace) -> int:
    """Write the recording and its truth (`run.truth.json` beside `run.mcap`): both or none."""
    out = Path(args.out)
    truth = out.with_name(out.name.removesuffix(".mcap") + ".truth.json")
    refuse_existing(out)
    refuse_existing(truth)
    makers = {"held": _make_held, "pushed": _make_pushed, "joints": _make_joints}
    document, write = makers[args.form](args)
    with written_whole(truth) as part:
        part.write_text(json.dumps(document, indent=1))
        write(out)
    written = {"recording": str(out), "truth": str(truth)}
    print(json.dumps(written) if args.json else f"{out}, truth in {truth}")
    return 0


def _make_held(args: Namespace) -> tuple[dict[str, Any], Callable[[Path], object]]:
    """Make a recording of a held object; return its truth, and what writes it."""
    from tactile_dynamics_ros.synthetic.recordings import write_bag

    recording = _generate(args)
    return recording.truth(), partial(write_bag, recording.streams)


def _make_pushed(args: Namespace) -> tuple[dict[str, Any], Callable[[Path], object]]:
    """Make a recording of a pushed object; return its truth, and what writes it.

    Raises:
        BadInputError: an effect is unknown, or the speeds are in the wrong order.
    """
    from tactile_dynamics_ros.recording.pushed import PushedRecording
    from tactile_dynamics_ros.synthetic import pushed

    slowest, fastest = args.speed
    if slowest > fastest:
        raise BadInputError(f"--speed {slowest:g} {fastest:g}: expected LOW before HIGH, in m/s")
    hinged = pushed.JOINTED if args.kind == "jointed" else ()
    names = _known_names(args.effect, (*pushed.CATALOGUE, *hinged, *pushed.OUTSIDE))
    actions = pushed.ActionOptions(args.count, args.action, tuple(args.speed))
    options = pushed.PushOptions(args.kind, actions, variation=args.variation)
    made = pushed.generate([args.seed], dict.fromkeys(names, args.magnitude), options)[0]
    return made.truth(), PushedRecording(made.streams, args.out).to_bag


def _make_joints(args: Namespace) -> tuple[dict[str, Any], Callable[[Path], object]]:
    """Make a recording of an arm's joints; return its truth, and what writes it.

    Raises:
        BadInputError: an effect is unknown, or the URDF cannot be read.
    """
    from tactile_dynamics_ros.core.reading import read_text
    from tactile_dynamics_ros.core.robot.robot_file import load_robot
    from tactile_dynamics_ros.recording.joints import JointRecording
    from tactile_dynamics_ros.synthetic import joints
    from tactile_dynamics_ros.synthetic.recordings import EPOCH_NS

    urdf = read_text(Path(args.urdf), "a URDF") if args.urdf else load_robot("allegro_iiwa").urdf
    names = _known_names(args.effect, (*joints.CATALOGUE, *joints.OUTSIDE))
    payload = joints.Payload.draw(args.payload, args.seed) if args.payload else None
    options = joints.JointOptions(
        duration=args.duration, rate_hz=args.rate, payload=payload, repeat=args.repeat
    )
    made = joints.generate(urdf, args.seed, dict.fromkeys(names, args.magnitude), options)
    return made.truth(), JointRecording(made.streams, args.out, epoch_ns=EPOCH_NS).to_bag


def _known_names(given: str, known: tuple[str, ...]) -> list[str]:
    """Return the names in a list with commas.

    Raises:
        BadInputError: one is unknown.
    """
    names = [name.strip() for name in given.split(",") if name.strip()]
    unknown = [name for name in names if name.partition("[")[0] not in known]
    if unknown:
        raise BadInputError(f"--effect {given}: no '{unknown[0]}'; there are {', '.join(known)}")
    return names


def _generate(args: Namespace) -> HiddenRecording:
    """Make the recording that the arguments describe.

    Raises:
        BadInputError: an effect is unknown.
    """
    from tactile_dynamics_ros import synthetic

    names = _known_names(args.effect, (*synthetic.CATALOGUE, *synthetic.EVENTS, *synthetic.OUTSIDE))
    scenario = synthetic.ScenarioOptions(
        duration=args.duration,
        finger_roll=args.frames == "finger",
        regrasp=args.regrasp,
        contact_breaks=args.contact_breaks,
    )
    sensors = synthetic.SensorOptions(
        stagger=args.stagger,
        pose_gaps=args.pose_gaps,
        state_force_std=not args.no_force_std,
        frames=args.frames,
    )
    if args.magnitude is not None:
        sizes = dict.fromkeys(names, args.magnitude)
        return synthetic.generate(args.seed, sizes, scenario, sensors)
    targets = dict.fromkeys(names, args.whitened_rms)
    return synthetic.generate_at_whitened_rms(args.seed, targets, scenario, sensors)
