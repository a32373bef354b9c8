"""Probe recordings for `compare | diagnose | explain`."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from tactile_dynamics_ros.api.questions import Question, question_friction
from tactile_dynamics_ros.core.errors import BadInputError


def add_model_argument(parser: ArgumentParser) -> None:
    """Add the choice between the models that a recording can be held against."""
    parser.add_argument(
        "--model",
        choices=("auto", "held", "pushed", "friction"),
        default="auto",
        help="rigid body in the hand, object on a support, or Coulomb friction of a probe; auto: "
        "by the topics",
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
