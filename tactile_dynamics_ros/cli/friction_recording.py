"""Probe recordings for `compare | diagnose | explain`."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel


@dataclass(frozen=True)
class Question:
    """A fitted model that is held against its data.

    Attributes:
        model: fitted.
        source: the recording, as reports name it.
        error: gives the field ``error`` of the document of `compare`.
        otherwise: gives the model with other noise, or None; asked where this one explains nothing.
    """

    model: Any
    source: str
    error: Callable[[], dict[str, Any]]
    otherwise: Callable[[], Any] = lambda: None


def add_model_argument(parser: ArgumentParser) -> None:
    """Add the choice between the models that a recording can be held against."""
    parser.add_argument(
        "--model",
        choices=("auto", "held", "friction"),
        default="auto",
        help="rigid body in the hand, or Coulomb friction of a probe; auto: by the topics",
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


def question_friction(args: Namespace) -> Question:
    """Fit Coulomb friction, with the named effects, to the slips of a recording."""
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
    from tactile_dynamics_ros.core.friction.slip_table import tabulate_slips
    from tactile_dynamics_ros.recording.probe_slips import read_slips

    if len(args.bag) > 1:
        raise BadInputError(
            f"{len(args.bag)} recordings, some of a friction probe; ask about one at a time"
        )
    [bag] = args.bag
    names = [name.strip() for name in args.effects.split(",") if name.strip()]
    slips = tabulate_slips(read_slips(Path(bag), args.namespace))
    model = FrictionModel.fit(slips, names)
    return Question(model, str(bag), lambda: _error_of(model))


def _error_of(model: FrictionModel) -> dict[str, Any]:
    force = model.residuals().physical
    return {
        "whitened_rms": float(np.sqrt(np.mean(model.residual**2))),
        "force_rms_n": float(np.sqrt(np.mean(force**2))),
        "torque_rms_nm": None,
    }
