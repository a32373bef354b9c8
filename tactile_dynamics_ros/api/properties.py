"""What the object is by a model, so that it can be reported before and after effects are added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.result import Rows
from tactile_dynamics_ros.core.discrepancy.verdict.wording import capitalise, join_names
from tactile_dynamics_ros.recording.joints import JointRecording
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.report.numbers import with_uncertainty

if TYPE_CHECKING:
    from tactile_dynamics_ros.api.questions import Question
    from tactile_dynamics_ros.core.discrepancy.model.residual_model import Convention
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
    from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
    from tactile_dynamics_ros.core.joints.model import JointsModel
    from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
    from tactile_dynamics_ros.recording import Recording


@dataclass(frozen=True)
class Properties:
    """What the object is by one model.

    Attributes:
        document: of `estimate` with that model.
        rows: name (starred where undetermined), value, standard deviation and unit of each number.
        remark: what it is by effects that cannot be told from those of the model; empty for none.
    """

    document: dict[str, Any]
    rows: Rows
    remark: str = ""

    @property
    def cells(self) -> dict[str, str]:
        """Value and interval by name, starred where this recording does not determine them."""
        return {
            row[0].removesuffix(" *"): " ± ".join(row[1:3]) + " *" * row[0].endswith(" *")
            for row in self.rows
        }

    @property
    def units(self) -> dict[str, str]:
        """Unit of each number by name."""
        return {row[0].removesuffix(" *"): row[3] for row in self.rows}


def properties_of(
    question: Question,
    model: Any,
    read: Sequence[Convention] = (),
    groups: Mapping[str, Sequence[str]] | None = None,
) -> Properties:
    """Tell what was recorded by a model of it.

    Args:
        question: that the model answers.
        model: with the effects that count.
        read: conventions as which the recording is read.
        groups: effects that cannot be told from one of the model, by that; of a held object its
            intervals hold them too.

    Raises:
        NotIdentifiableError: the iteration diverged, or a pushed object slides too little.
    """
    if question.recording is None:
        return _of_surface(model)
    if isinstance(question.recording, PushedRecording):
        return _of_pushed(question.recording, model)
    if isinstance(question.recording, JointRecording):
        return _of_joints(question.recording, model)
    return _of_held(question.recording, model, read, groups or {})


def _of_held(
    recording: Recording,
    model: HeldObjectModel,
    read: Sequence[Convention],
    groups: Mapping[str, Sequence[str]],
) -> Properties:
    """Estimate a held object with the effects of a model, in the readings that the data chose."""
    from tactile_dynamics_ros.api.estimates import Estimate
    from tactile_dynamics_ros.core.inertia.batch.knowledge import say_rivals
    from tactile_dynamics_ros.core.inertia.diagnosis.misreading import read_as
    from tactile_dynamics_ros.core.inertia.estimate import estimate, estimate_rivals

    streams = read_as(recording.streams, [convention.name for convention in read])
    fitted = estimate(streams, model.effects, fitted=model.fitted)
    rivals = estimate_rivals(streams, model.effect_names, groups)
    found = Estimate(
        replace(recording, streams=streams),
        fitted,
        uncorrected=None if model.effects else model.fitted,
        rivals=tuple(rivals.values()),
    )
    names = join_names(model.effect_names, "and")
    remark = say_rivals(fitted.to_estimate(), names, rivals) if rivals else ""
    return Properties(found.to_json(), found.body_rows(), remark)


def _of_pushed(recording: PushedRecording, model: PushDiscrepancy) -> Properties:
    """Estimate a pushed object with the effects of a model."""
    from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes

    found = EstimateOfPushes.of(recording, model.effect_names)
    return Properties(found.to_json(), found.body_rows())


def _of_joints(recording: JointRecording, model: JointsModel) -> Properties:
    """Tell payload and friction of an arm by a model that is fitted."""
    from tactile_dynamics_ros.api.joint_estimates import EstimateOfJoints
    from tactile_dynamics_ros.core.joints.estimate import JointsEstimate

    found = EstimateOfJoints(recording, JointsEstimate(model, recording.streams))
    return Properties(found.to_json(), found.body_rows())


def _of_surface(model: FrictionModel) -> Properties:
    """Return the coefficients of a probed surface."""
    table = model.parameters()["coulomb"]
    rows = [(n, *with_uncertainty(e["value"], e["std"]), e["unit"]) for n, e in table.items()]
    return Properties({"coulomb": table}, [tuple(row) for row in rows])


def before_and_after(alone: str, added: Sequence[str], known: Sequence[Properties]) -> Rows:
    """Return a table of what the object is, before and, if anything was added, after.

    Args:
        alone: what the model without the added effects is called.
        added: names of these effects.
        known: before and after, or before alone.
    """
    head = ("", alone, f"with {join_names(added, 'and')}")[: 1 + len(known)]
    body = [
        (name, *(one.cells.get(name, "") for one in known), unit)
        for name, unit in known[0].units.items()
    ]
    return [(*head, "unit"), *body]


def sentence_of(rows: Rows) -> str:
    """Return the first number of a table before and after in a sentence; empty without an after."""
    (_, *models, _), (name, *cells, unit) = rows[:2]
    if len(models) < 2:
        return ""
    before, after = (f"{cell.removesuffix(' *')} {unit}".rstrip() for cell in cells)
    return f"{capitalise(models[1])} the {name} is {after} instead of {before}."
