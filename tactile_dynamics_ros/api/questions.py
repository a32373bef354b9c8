"""A recording with its fitted model, as compare, diagnose and explain ask about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.core.discrepancy.comparison import Comparison, compare
from tactile_dynamics_ros.core.discrepancy.verdict.judgement import FAR, Judgement, judge
from tactile_dynamics_ros.core.progress import tell

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
    from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
    from tactile_dynamics_ros.core.joints.model import JointsModel
    from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
    from tactile_dynamics_ros.core.planar.properties.linked_fit import PairFit
    from tactile_dynamics_ros.core.planar.properties.push_model import PushFit
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.joints import JointRecording
    from tactile_dynamics_ros.recording.pushed import PushedRecording


@dataclass(frozen=True)
class Question:
    """A fitted model that is held against its data, once for every verb.

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
    recording: Recording | PushedRecording | JointRecording | None = None

    @cached_property
    def judgement(self) -> Judgement:
        """Whether the model is adequate, by tests of its residual."""
        return judge(self.model)

    @cached_property
    def comparison(self) -> Comparison:
        """Whether the model is adequate, and where it fails."""
        return compare(self.model, self.judgement)

    @cached_property
    def whitened_rms(self) -> float:
        """Error of the model over the stated noise."""
        return float(self.error()["whitened_rms"])

    @property
    def fits(self) -> bool:
        """Whether tests find nothing against the model, but what a search might name."""
        return self.judgement.adequate is not False

    @property
    def misfit(self) -> str:
        """What to do about a model that is not clearly adequate, in a sentence; else empty."""
        if self.judgement.adequate:
            return ""
        error = f"the error is {self.whitened_rms:.2f} times the noise"
        if self.fits:
            return f"{error}, yet an effect may be seen in it: ask `tactile-dynamics diagnose`"
        return (
            f"the model does not fit: {error}; `tactile-dynamics diagnose` looks for what is "
            "missing"
        )

    @property
    def is_far(self) -> bool:
        """Whether the model fits so badly that its numbers are no answer."""
        return not self.fits and self.whitened_rms > FAR

    def answer(self, ask: Callable[[Any], Any]) -> tuple[Any, tuple[str, ...]]:
        """Diagnose or explain; where that fails, once more with the noise that samples show.

        Returns:
            The answer, and notes on the models that were asked about.
        """
        from tactile_dynamics_ros.core.discrepancy.explanation import ask_twice

        answer, model = ask_twice(ask, self.model, self.otherwise)
        asked = [self.model] if model is self.model else [self.model, model]
        return answer, tuple(note for one in asked for note in self.notes(one))


def question_held(
    recording: Recording, effects: Sequence[Effect] = (), fitted: FittedModel | None = None
) -> Question:
    """Fit a rigid body with effects to a recording.

    Args:
        recording: what was measured.
        effects: of the model.
        fitted: fit of the model to the recording as it is, if there is one already.
    """
    tell("fitting the rigid body")
    from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
    from tactile_dynamics_ros.core.inertia.diagnosis.readings import model_with_seen_noise

    model = question(recording.streams, effects, fitted)
    return Question(
        model,
        recording.source,
        lambda: dict(model.fitted.to_estimate().error.to_json()),
        lambda: model_with_seen_noise(model, recording.streams, effects),
        lambda asked: _notes(asked.fitted),
        recording,
    )


def question_friction(
    probe: Path, names: Sequence[str] = (), namespace: str | None = None
) -> Question:
    """Fit Coulomb friction, with the named effects, to the slips of a probe's recording."""
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
    from tactile_dynamics_ros.core.friction.slip_log import tabulate_slips
    from tactile_dynamics_ros.recording.probe_slips import read_slips

    slips = tabulate_slips(read_slips(probe, namespace))
    model = FrictionModel.fit(slips, list(names))
    return Question(model, str(probe), lambda: _friction_error(model))


def question_pushed(
    recording: PushedRecording,
    names: Sequence[str] = (),
    fit: PushFit | PairFit | None = None,
) -> Question:
    """Fit mass, friction and centre of mass of a pushed object, with the named effects.

    Args:
        recording: what was measured.
        names: of the effects of the model.
        fit: of that model, if there is one already.

    Raises:
        BadInputError: an effect is unknown or has no law for two parts, or nothing is touched.
        NotIdentifiableError: it slides too little to judge a model, or what two parts are to each
            other is not known.
    """
    tell("fitting friction and inertia")
    from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy

    model = PushDiscrepancy.of_streams(recording.streams, names, fit)
    return Question(model, recording.source, lambda: _push_error(model), recording=recording)


def question_joints(
    recording: JointRecording,
    names: Sequence[str] = (),
    without: JointRecording | None = None,
    known_load: float | None = None,
) -> Question:
    """Fit links, payload and friction of an arm, with the named effects, to its joint torques.

    Args:
        recording: what was measured.
        names: of the effects of the model.
        without: the same arm without the payload.
        known_load: mass of the payload, kg, if it was weighed.

    Raises:
        BadInputError: an effect is unknown, or the URDF is of another arm.
        NotIdentifiableError: the recording is too short.
    """
    tell("fitting links, friction and payload")
    from tactile_dynamics_ros.core.joints.estimate import fit

    empty = None if without is None else without.streams
    model = fit(recording.streams, names, empty, known_load=known_load)
    return Question(model, recording.source, lambda: _joints_error(model), recording=recording)


def _joints_error(model: JointsModel) -> dict[str, Any]:
    torque = model.residuals().physical
    return {
        "whitened_rms": float(np.sqrt(np.mean(model.residual**2))),
        "force_rms_n": None,
        "torque_rms_nm": float(np.sqrt(np.mean(torque**2))),
    }


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
