"""A recording with its fitted model, as compare, diagnose and explain ask about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.core.progress import tell

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
    from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
    from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.pushed import PushedRecording


@dataclass(frozen=True)
class Question:
    """A fitted model that is held against its data.

    Attributes:
        model: fitted.
        source: the recording, as reports name it.
        error: gives the field ``error`` of the document of `compare`.
        otherwise: gives the model with other noise, or None; asked where this one explains nothing.
        notes: gives sentences on what a model does not take as it is recorded.
        recording: of the object; None for a probed surface, whose slips are in the model.
    """

    model: Any
    source: str
    error: Callable[[], dict[str, Any]]
    otherwise: Callable[[], Any] = lambda: None
    notes: Callable[[Any], list[str]] = lambda model: []
    recording: Recording | PushedRecording | None = None

    def answer(self, ask: Callable[[Any], Any]) -> tuple[Any, tuple[str, ...]]:
        """Diagnose or explain; where that fails, once more with the noise that samples show.

        Returns:
            The answer, and notes on the models that were asked about.
        """
        from tactile_dynamics_ros.core.discrepancy.explanation import ask_twice

        answer, model = ask_twice(ask, self.model, self.otherwise)
        asked = [self.model] if model is self.model else [self.model, model]
        return answer, tuple(note for one in asked for note in self.notes(one))


def question_held(recording: Recording, effects: Sequence[Effect] = ()) -> Question:
    """Fit a rigid body with effects to a recording."""
    tell("fitting the rigid body")
    from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
    from tactile_dynamics_ros.core.inertia.diagnosis.readings import (
        fit_with_readings,
        model_with_seen_noise,
    )

    fitted = fit_with_readings(recording.streams, effects)
    model = question(recording.streams, effects, fitted)
    return Question(
        model,
        recording.source,
        lambda: dict(fitted.to_estimate().error.to_json()),
        lambda: model_with_seen_noise(model, recording.streams, effects),
        lambda asked: _notes(asked.fitted),
        recording,
    )


def question_friction(
    probe: Path, names: Sequence[str] = (), namespace: str | None = None
) -> Question:
    """Fit Coulomb friction, with the named effects, to the slips of a probe's recording."""
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
    from tactile_dynamics_ros.core.friction.slip_table import tabulate_slips
    from tactile_dynamics_ros.recording.probe_slips import read_slips

    slips = tabulate_slips(read_slips(probe, namespace))
    model = FrictionModel.fit(slips, list(names))
    return Question(model, str(probe), lambda: _friction_error(model))


def question_pushed(recording: PushedRecording, names: Sequence[str] = ()) -> Question:
    """Fit mass, friction and centre of mass of a pushed object, with the named effects."""
    tell("fitting friction and inertia")
    from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy

    model = PushDiscrepancy.of_streams(recording.streams, names)
    return Question(model, recording.source, lambda: _push_error(model), recording=recording)


def _push_error(model: PushDiscrepancy) -> dict[str, Any]:
    lacking = model.lacking()
    return {
        "whitened_rms": float(np.sqrt(np.mean(model.residual**2))),
        "force_rms_n": float(np.sqrt(np.mean(np.sum(lacking[:, :2] ** 2, axis=1)))),
        "torque_rms_nm": float(np.sqrt(np.mean(lacking[:, 2] ** 2))),
    }


def _notes(fitted: FittedModel) -> list[str]:
    """Return what was not taken as it is recorded."""
    from tactile_dynamics_ros.core.inertia.residuals.stated_noise import remark_on

    notes = [] if fitted.survey is None else [fitted.survey.remark]
    return notes + ([remark_on(fitted.restated)] if fitted.restated else [])


def _friction_error(model: FrictionModel) -> dict[str, Any]:
    force = model.residuals().physical
    return {
        "whitened_rms": float(np.sqrt(np.mean(model.residual**2))),
        "force_rms_n": float(np.sqrt(np.mean(force**2))),
        "torque_rms_nm": None,
    }
