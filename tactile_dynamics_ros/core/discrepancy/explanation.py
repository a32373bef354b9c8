"""Add what is missing, step by step, until nothing is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, TypeVar

from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis, diagnose, find_group
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Convention, ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.finding import RegimeFinding, regime_of
from tactile_dynamics_ros.core.discrepancy.search import DiagnosisConfig, Step, reconsider_steps
from tactile_dynamics_ros.core.discrepancy.signature import Signature, describe_residual
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment
from tactile_dynamics_ros.core.discrepancy.verdict.judgement import Judgement
from tactile_dynamics_ros.core.discrepancy.verdict.validation import HeldOut, held_out

_READINGS = 2
"""Conventions as which a recording is read at most, each once. People mistake one, at times two; at
1 no pair is found, at 3 and more wrong readings that mend each other pass for an explanation."""


@dataclass(frozen=True)
class ExplanationStep:
    """One effect that was added.

    Attributes:
        name: the effect.
        error: held-out white RMS with it.
        group: effects that could not be distinguished from it.
    """

    name: str
    error: float
    group: tuple[str, ...]


@dataclass(frozen=True)
class Explanation:
    """Outcome of `explain`.

    Attributes:
        verdict: adequate or unexplained.
        effects: of the final model that the first one lacked.
        steps: in the order in which they were added.
        model: the final model.
        first: diagnosis of the first model, of the recording as it was read.
        last: diagnosis of the model with the effects that were named.
        before: held-out error of the first model.
        after: held-out error of the final model.
        floor: white RMS of the noise alone.
        signature: of what remains, if something does.
        conventions: as which the recording was read first, one after the other; where the verdict
            is unexplained, they may be wrong.
        in_turn: whether several readings fit in turn and none of them is to be believed.
    """

    verdict: str
    effects: tuple[str, ...]
    steps: tuple[ExplanationStep, ...]
    model: ResidualModel
    first: Diagnosis
    last: Diagnosis
    before: HeldOut
    after: HeldOut
    floor: float
    signature: Signature | None
    conventions: tuple[Convention, ...] = ()
    in_turn: bool = False

    @cached_property
    def regimes(self) -> dict[str, RegimeFinding]:
        """Where effects act that do not act everywhere, by name."""
        found = {name: regime_of(self.model, name) for name in self.effects}
        return {name: regime for name, regime in found.items() if regime is not None}

    @property
    def leaves_noise(self) -> bool:
        """Whether the residual of the final model is the white noise that was stated."""
        return self.last.leaves_noise


def explain(model: ResidualModel, config: DiagnosisConfig | None = None) -> Explanation:
    """Diagnose, add, refit and repeat until the model is adequate or nothing helps.

    A recording that fits once it is read another way is read so first. Several readings are
    believed only if they name different conventions and leave nothing for an effect to explain.
    Effects that lose their evidence when others are added are removed again, and those that another
    then betters are replaced.

    Args:
        model: fitted.
        config: levels and depths.
    """
    config = config or DiagnosisConfig()
    recorded = first = diagnose(model, config)
    read: list[Convention] = []
    while first.convention is not None:
        if not _may_read(first.convention, read):
            return _fits_in_turn(recorded, (*read, first.convention), config)
        read.append(first.convention)
        first = diagnose(first.convention.model, config)
    if len(read) > 1 and first.verdict != "adequate":
        return _fits_in_turn(recorded, tuple(read), config)
    found = _add_effects(first, config)
    return replace(found, before=recorded.before, conventions=tuple(read))


def _may_read(convention: Convention, read: Sequence[Convention]) -> bool:
    """Whether a recording may be read as one more convention."""
    return len(read) < _READINGS and convention.name not in [one.name for one in read]


def _fits_in_turn(
    recorded: Diagnosis, read: tuple[Convention, ...], config: DiagnosisConfig
) -> Explanation:
    """No explanation: readings fit one after the other, none of them is to be believed."""
    first = replace(
        recorded,
        verdict="unexplained",
        after=recorded.before,
        floor=recorded.assessment.structure.floor,
        signature=describe_residual(recorded.assessment),
        convention=None,
    )
    return replace(_summarise(first, first, (), config), conventions=read, in_turn=True)


def _add_effects(first: Diagnosis, config: DiagnosisConfig) -> Explanation:
    """Explanation of a recording that is read right."""
    diagnosis = first
    steps = first.steps if first.effect else ()
    for _ in range(config.depth):
        judgement = Judgement(steps[-1].after) if steps else None
        if not diagnosis.effect or judgement is None or judgement.adequate:
            break
        diagnosis = diagnose(steps[-1].choice.model, config, judgement)
        if diagnosis.effect:
            steps = reconsider_steps((*steps, *diagnosis.steps), config)
    return _summarise(first, diagnosis, steps, config)


def _summarise(
    first: Diagnosis,
    last: Diagnosis,
    steps: tuple[Step, ...],
    config: DiagnosisConfig,
) -> Explanation:
    if not steps:
        verdict = "adequate" if first.verdict == "adequate" else "unexplained"
        return Explanation(
            verdict, (), (), first.model, first, last, first.before, first.before, first.floor,
            first.signature,
        )  # fmt: skip
    explained = tuple(
        ExplanationStep(
            step.name,
            held_out(step.choice.model).rms,
            find_group(step, config, first.assessment.within_stated)[0],
        )
        for step in steps
    )
    model, final = steps[-1].choice.model, steps[-1].after
    floor = min(first.floor, final.structure.floor)
    left = not _is_adequate(model, final, last, config)
    return Explanation(
        verdict="unexplained" if left else "adequate",
        effects=tuple(step.name for step in steps),
        steps=explained,
        model=model,
        first=first,
        last=last,
        before=first.before,
        after=held_out(model),
        floor=floor,
        signature=describe_residual(final) if left else None,
    )


def _is_adequate(
    model: ResidualModel, assessment: Assessment, last: Diagnosis, config: DiagnosisConfig
) -> bool:
    """Whether the final model is adequate, as `compare` and `diagnose` would say of it."""
    judgement = Judgement(assessment)
    if judgement.adequate is not None:
        return judgement.adequate
    found = last if last.model is model else diagnose(model, config, judgement)
    return found.verdict == "adequate"


class Outcome(Protocol):
    """What a diagnosis and an explanation have in common."""

    @property
    def verdict(self) -> str:
        """One of adequate, convention, missing_effect, ambiguous and unexplained."""

    @property
    def leaves_noise(self) -> bool:
        """Whether the residual, with all that was added, is the white noise that was stated."""


Answer = TypeVar("Answer", bound=Outcome)
Model = TypeVar("Model", bound=ResidualModel)


def ask_twice(
    ask: Callable[[Model], Answer], model: Model, otherwise: Callable[[], Model | None]
) -> tuple[Answer, Model]:
    """Ask; if nothing explains the residual, ask about the same model with other noise.

    Args:
        ask: `diagnose` or `explain`.
        model: with the noise that is stated.
        otherwise: makes the model with the noise that samples show, or None.

    Returns:
        The answer, the second one only if it leaves nothing but noise, and the model asked about.
    """
    answer = ask(model)
    other = otherwise() if answer.verdict == "unexplained" else None
    again = None if other is None else ask(other)
    if other is None or again is None or not again.leaves_noise:
        return answer, model
    return again, other
