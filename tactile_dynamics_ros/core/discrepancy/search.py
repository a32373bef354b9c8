"""Add effects until the residual is explained, and reconsider earlier ones beside later ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.selection import choose_effect, exchange
from tactile_dynamics_ros.core.discrepancy.structure import Line, find_line
from tactile_dynamics_ros.core.discrepancy.trials import Choice
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment, assess
from tactile_dynamics_ros.core.progress import tell


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
    mostly: float = parameter(
        0.9,
        "share of the excess error by which an effect is named although something remains",
        "",
        0.5,
        1.0,
    )
    complete: float = parameter(
        0.995,
        "share of the excess error by which several effects are its cause, whatever is left",
        "",
        0.9,
        1.0,
    )
    beyond_stated: float = parameter(
        0.8,
        "share of the excess error that must go where lasting errors of the sensors remain",
        "",
        0.0,
        1.0,
    )
    beside_stated: float = parameter(
        0.6,
        "the same where the error is within the uncertainty that the sensors report",
        "",
        0.0,
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
        0.65, "share that two effects must explain to be reconsidered together", "", 0.0, 1.0
    )
    third_progress: float = parameter(
        0.95, "share that reconsidered effects must explain for one more to be tried", "", 0.0, 1.0
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
        choice: the effect and its rivals; beside the effects of all steps if there are several.
        after: assessment of the model with it.
    """

    choice: Choice
    after: Assessment

    @property
    def name(self) -> str:
        """The effect."""
        return self.choice.best.name


def find_effects(
    model: ResidualModel, first: Assessment, config: DiagnosisConfig
) -> tuple[Step, ...]:
    """Add effects until the residual is explained, nothing helps, or the depth is reached.

    In an error within the uncertainty that the sensors report, at most one effect can be made out.

    Args:
        model: to be extended.
        first: assessment of it.
        config: levels and depths.
    """
    steps: tuple[Step, ...] = ()
    present, assessment = model, first
    for _ in range(1 if first.within_stated else config.depth):
        tell(f"looking for effect {len(steps) + 1}")
        needed = _needed(first, assessment, config) if steps else np.inf
        choice = add_effect(present, assessment, config, needed)
        if choice is None:
            break
        steps = (*steps, Step(choice, assess(choice.model, config.significance)))
        if not choice.thorough or is_hopeless(steps, first, config):
            break
        if len(steps) == 2 or (len(steps) > 2 and is_enough(steps, first, config)):
            steps = reconsider_steps(steps, config)
        present, assessment = steps[-1].choice.model, steps[-1].after
        floor = assessment.structure.floor
        if is_enough(steps, first, config) or dominates(steps, first, floor, config):
            break
        share = explained_share(first.rms, assessment.rms, floor)
        if len(steps) > 1 and share < config.third_progress:
            break
    return steps


def reconsider_steps(steps: Sequence[Step], config: DiagnosisConfig) -> tuple[Step, ...]:
    """Exchange effects that others better; put those first without which most is missing.

    The models of all steps but the last are quick fits to the whitening of the last.

    Args:
        steps: the effects that were added one after the other.
        config: levels.
    """
    floor = steps[-1].after.structure.floor
    added = [step.choice.best for step in steps]
    model, choices = exchange(steps[-1].choice.model, added, floor, config.indifference)
    order = sorted(choices, key=lambda choice: choice.without)
    found: list[Step] = []
    for choice in order:
        found.insert(0, Step(replace(choice, model=model), assess(model, config.significance)))
        model = model.without_effect(choice.best.name)
    return tuple(found)


def is_hopeless(steps: Sequence[Step], first: Assessment, config: DiagnosisConfig) -> bool:
    """Whether the effects explain so little that more of them would be guesses.

    Effects that hide each other explain little one by one: the first may stay if the screening
    promises that another beside it explains most.
    """
    after = steps[-1].after
    floor = after.structure.floor
    share = explained_share(first.rms, after.rms, floor)
    if len(steps) > 1:
        return share < config.second_progress
    if share >= config.first_progress:
        return False
    gain = max((score.gain for score in after.scores), default=0.0)
    left = np.sqrt(max(after.rms**2 - gain / len(steps[-1].choice.model.residual), 0.0))
    return explained_share(first.rms, float(left), floor) < config.second_progress


def dominates(
    steps: Sequence[Step], first: Assessment, floor: float, config: DiagnosisConfig
) -> bool:
    """Whether the first effect alone explains nearly all of an error, whatever causes the rest."""
    if not steps:
        return False
    return explained_share(first.rms, steps[0].after.rms, floor) >= config.dominating


def _needed(first: Assessment, before: Assessment, config: DiagnosisConfig) -> float:
    """White RMS that several effects must reach together."""
    floor = before.structure.floor
    excess = max(first.rms**2 - floor**2, 0.0)
    return float(np.sqrt(floor**2 + (1.0 - config.second_progress) * excess))


def add_effect(
    model: ResidualModel,
    before: Assessment,
    config: DiagnosisConfig,
    needed: float = np.inf,
) -> Choice | None:
    """Add the effect with the best evidence, if it has any.

    Where most of the error is a vibration that the motion does not have, only effects are tried
    that can ring, or that would explain nearly all of it: the system itself may vibrate.
    """
    floor, scores = before.structure.floor, before.scores
    line = find_vibration(model, floor)
    if line is not None and line.share > config.vibration:
        enough = config.explained * (before.rms**2 - floor**2) * len(model.residual)
        scores = tuple(score for score in scores if score.family.rings or score.gain > enough)
    choice = choose_effect(model, scores, floor, needed)
    if choice is None or choice.best.criterion > choice.without - config.indifference:
        return None
    return choice


def find_vibration(model: ResidualModel, floor: float) -> Line | None:
    """A line of the residual that the motion, if it is known, does not have."""
    residuals = model.residuals()
    return None if residuals.drivers is None else find_line(residuals, floor)


def is_settled(
    first: Assessment, steps: Sequence[Step], floor: float, config: DiagnosisConfig
) -> bool:
    """Whether what all steps leave is noise, or too little to speak of."""
    if is_noise(first, steps, config):
        return True
    after = steps[-1].after
    share = explained_share(first.rms, after.rms, floor)
    return share >= config.explained and after.rms <= config.near_floor * floor


def is_noise(first: Assessment, steps: Sequence[Step], config: DiagnosisConfig) -> bool:
    """Whether what all steps leave is white, or within the uncertainty that the sensors report.

    Where it was the latter before, only effects that are no errors of sensors can have done it.
    Errors of sensors of two kinds together, beside those that these report, imitate anything.
    """
    after = steps[-1].after
    if after.white:
        return True
    if not after.within_stated:
        return False
    share = explained_share(first.rms, after.rms, after.structure.floor)
    lasting = sum(step.choice.best.source.family.lasting for step in steps)
    if not first.within_stated:
        return lasting <= 1 and share >= config.beyond_stated
    return not lasting and share >= config.beside_stated


def is_enough(steps: Sequence[Step], first: Assessment, config: DiagnosisConfig) -> bool:
    """`is_settled` with the floor of the last step."""
    return is_settled(first, steps, steps[-1].after.structure.floor, config)


def explained_share(before: float, after: float, floor: float) -> float:
    """Share of the squared error above the floor that is gone, from three RMS values."""
    excess = before**2 - floor**2
    left = max(after**2 - floor**2, 0.0)
    return 1.0 - left / excess if excess > 0 else 0.0
