"""Which effect is missing: score tests, refits, held-out validation, honest verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.assessment import Assessment, assess
from tactile_dynamics_ros.core.discrepancy.model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import best_by_effect, screen
from tactile_dynamics_ros.core.discrepancy.selection import Choice, choose_effect
from tactile_dynamics_ros.core.discrepancy.signature import (
    Line,
    Signature,
    describe_residual,
    find_line,
)
from tactile_dynamics_ros.core.discrepancy.validation import HeldOut, fits_equally, held_out


@dataclass(frozen=True)
class DiagnosisConfig:
    """Levels and depths of the diagnosis."""

    significance: float = parameter(0.01, "family-wise level of the adequacy test", "", 1e-9, 0.5)
    depth: int = parameter(3, "effects tried together before giving up", "", 1, 6)
    explained: float = parameter(
        0.95, "share of the excess error that counts as explained in any case", "", 0.5, 1.0
    )
    near_floor: float = parameter(
        1.12, "white RMS over its floor that counts as explained in any case", "", 1.0, 2.0
    )
    dominating: float = parameter(
        0.99,
        "share of the excess error by which one effect is the cause of most of it",
        "",
        0.9,
        1.0,
    )
    vibration: float = parameter(
        0.5,
        "share of the excess error in one line of the spectrum that makes a vibration",
        "",
        0.1,
        1.0,
    )
    first_progress: float = parameter(
        0.25, "share of the excess error that one effect must explain to go on", "", 0.0, 1.0
    )
    second_progress: float = parameter(
        0.8, "share of the excess error that two effects must explain to go on", "", 0.0, 1.0
    )
    indifference: float = parameter(
        10.0, "difference of -2 log evidence that does not decide", "", 0.0, 100.0
    )

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class Step:
    """One effect added to a model.

    Attributes:
        choice: the effect and its rivals.
        before: assessment of the model without it.
        after: assessment of the model with it.
    """

    choice: Choice
    before: Assessment
    after: Assessment

    @property
    def name(self) -> str:
        """The effect."""
        return self.choice.best.name


@dataclass(frozen=True)
class Diagnosis:
    """Outcome of `diagnose`.

    Attributes:
        verdict: adequate, missing_effect, ambiguous or unexplained.
        effect: the missing effect, or None.
        group: effects that the data cannot tell from it, itself first; empty where there is none.
        model: the model that was diagnosed.
        assessment: of that model.
        steps: the effects that were added one after the other to explain the residual.
        before: held-out error of the model.
        after: held-out error with the missing effect (of the model if there is none).
        floor: white RMS of the noise alone.
        separating_motion: plan of the motion that would tell the group apart, or None.
        signature: of a residual that no effect explains, or None.
    """

    verdict: str
    effect: str | None
    group: tuple[str, ...]
    model: ResidualModel
    assessment: Assessment
    steps: tuple[Step, ...]
    before: HeldOut
    after: HeldOut
    floor: float
    separating_motion: dict[str, Any] | None = None
    signature: Signature | None = None

    @property
    def remaining(self) -> float:
        """Held-out error with the missing effect, over the noise floor."""
        return self.after.rms / self.floor

    @property
    def explained_model(self) -> ResidualModel:
        """The model with the missing effect, or as it was."""
        return self.steps[0].choice.model if self.effect else self.model


def diagnose(
    model: ResidualModel,
    config: DiagnosisConfig | None = None,
    assessment: Assessment | None = None,
) -> Diagnosis:
    """Find out whether an effect is missing from a fitted model, and which.

    The residual is tested; if something is missing, effects are added until nothing is. One effect
    that leaves nothing, or dominates all else, is the answer. If several are needed, the first is
    the answer provided that together they explain the residual. Otherwise the cause is none of the
    known effects.

    Args:
        model: fitted.
        config: levels and depths.
        assessment: of the model, if there is one already.
    """
    config = config or DiagnosisConfig()
    first = assessment or assess(model, config.significance)
    before = held_out(model)
    if first.adequate:
        return Diagnosis(
            "adequate", None, (), model, first, (), before, before, first.structure.floor
        )
    steps = _explain(model, first, config)
    floor = min([first.structure.floor] + [s.after.structure.floor for s in steps])
    if not _accounts_for(model, steps, first, floor, config):
        return Diagnosis(
            "unexplained", None, (), model, first, steps, before, before, floor,
            signature=describe_residual(model),
        )  # fmt: skip
    step = steps[0]
    group, ambiguous = find_group(step.choice, config)
    after = held_out(step.choice.model)
    rivals = [r.model for r in step.choice.rivals if r.name in group]
    motion = step.choice.best.model.separating_motion(rivals) if rivals else None
    return Diagnosis(
        verdict="ambiguous" if ambiguous else "missing_effect",
        effect=step.name,
        group=group,
        model=model,
        assessment=first,
        steps=steps,
        before=before,
        after=after,
        floor=floor,
        separating_motion=motion,
    )


def _explain(model: ResidualModel, first: Assessment, config: DiagnosisConfig) -> tuple[Step, ...]:
    """Add effects until the residual is explained, nothing helps, or the depth is reached."""
    steps: list[Step] = []
    present, assessment = model, first
    while len(steps) < config.depth:
        step = add_effect(present, assessment, config)
        if step is None:
            break
        steps.append(step)
        present, assessment = step.choice.model, step.after
        floor = assessment.structure.floor
        share = explained_share(first.rms, assessment.rms, floor)
        hopeless = share < (config.first_progress if len(steps) == 1 else config.second_progress)
        settled = _settled(first, assessment, floor, config)
        if hopeless or settled or _dominates(steps, first, floor, config):
            break
    return tuple(steps)


def _dominates(
    steps: Sequence[Step], first: Assessment, floor: float, config: DiagnosisConfig
) -> bool:
    """Whether the first effect alone explains nearly all of an error, whatever causes the rest."""
    if not steps:
        return False
    return explained_share(first.rms, steps[0].after.rms, floor) >= config.dominating


def add_effect(model: ResidualModel, before: Assessment, config: DiagnosisConfig) -> Step | None:
    """Add the effect with the best evidence, if it has any.

    Where most of the error is a vibration that the motion does not have, only effects that can
    ring are tried.
    """
    floor, scores = before.structure.floor, before.scores
    line = _vibration(model, floor)
    if line is not None and line.share > config.vibration:
        scores = tuple(score for score in scores if score.family.rings)
    choice = choose_effect(model, scores, floor)
    if choice is None or choice.best.criterion > choice.without - config.indifference:
        return None
    return Step(choice, before, assess(choice.model, config.significance))


def _vibration(model: ResidualModel, floor: float) -> Line | None:
    """A line of the residual that the motion, if it is known, does not have."""
    residuals = model.residuals()
    return None if residuals.drivers is None else find_line(residuals, floor)


def _accounts_for(
    model: ResidualModel,
    steps: tuple[Step, ...],
    first: Assessment,
    floor: float,
    config: DiagnosisConfig,
) -> bool:
    """Whether the added effects are the cause.

    They explain the residual; a vibration that the motion does not have needs an effect that can
    ring; and what little is left is not the trace of another law. An effect that dominates need
    not explain the rest.
    """
    if _dominates(steps, first, floor, config):
        return True
    if not steps or not _settled(first, steps[-1].after, floor, config):
        return False
    if steps[-1].after.adequate:
        return True
    vibrates = _vibration(model, floor) is not None
    if vibrates and not any(step.choice.best.source.family.rings for step in steps):
        return False
    return not _follows_other_law(steps[-1], floor, config)


def _follows_other_law(step: Step, floor: float, config: DiagnosisConfig) -> bool:
    """Whether a law of named quantities explains most of what is left, better than any effect."""
    model = step.choice.model
    laws = best_by_effect(screen(model, model.library(), floor))
    effects = best_by_effect(step.after.scores)
    if not laws:
        return False
    left = float(model.residual @ model.residual) - floor**2 * len(model.residual)
    known = effects[0].criterion if effects else float("inf")
    return laws[0].gain > 0.5 * left and laws[0].criterion < known - config.indifference


def _settled(first: Assessment, after: Assessment, floor: float, config: DiagnosisConfig) -> bool:
    """Whether what is left is noise, or too little to speak of."""
    if after.adequate:
        return True
    share = explained_share(first.rms, after.rms, floor)
    return share >= config.explained and after.rms <= config.near_floor * floor


def explained_share(before: float, after: float, floor: float) -> float:
    """Share of the squared error above the floor that is gone, from three RMS values."""
    excess = before**2 - floor**2
    left = max(after**2 - floor**2, 0.0)
    return 1.0 - left / excess if excess > 0 else 0.0


def find_group(choice: Choice, config: DiagnosisConfig) -> tuple[tuple[str, ...], bool]:
    """Rivals that fit held-out blocks as well, and whether one of them is as plausible."""
    best = choice.best
    equal = [r for r in choice.rivals if fits_equally(best.held_out, r.held_out)]
    ambiguous = any(r.criterion < best.criterion + config.indifference for r in equal)
    names = (best.name, *(r.name for r in equal)) if equal else ()
    return names, ambiguous
