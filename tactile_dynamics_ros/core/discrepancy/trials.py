"""Effects tried at a fixed whitening: quick fits, their evidence, and the one that is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel, instants
from tactile_dynamics_ros.core.discrepancy.screening import (
    Score,
    best_by_effect,
    orthonormal,
    screen,
)
from tactile_dynamics_ros.core.discrepancy.structure import window_index
from tactile_dynamics_ros.core.discrepancy.verdict.validation import HeldOut, held_out
from tactile_dynamics_ros.core.progress import tell

REACH = 0.25
"""Share of the fall of the best that a bound may lie behind to be worth a fit: bounds are of linear
families at the present signals, which fits move. 0.125 and 0.5 changed no verdict of 16 examples (7
synthetic probes, 9 slides of a block); more costs a quick fit for each."""
CHANCE = 12.0
"""Difference of `evidence` that chance may make: three parameters that fit noise lower the squares
by 12 in 7 of 1000 cases. 6 and 24 changed no verdict of the 16."""
_READINGS = 4
"""Readings of an effect that are fitted, the best by their scores: effects of the catalogue have
four at most. 2 and 8 changed no verdict of the 16."""
_DECISIVE = 0.1
"""Share of what a model leaves beyond noise by which another must be better to be worth a fit:
where neither is the cause, small differences mean nothing. 0.05 and 0.2 changed no verdict of the
16."""
_BLOCK = 5.0
"""Length of the blocks whose sums show how far errors last, s: longer than a stroke of the usual
motion, so that what follows it has no sum. 2.5 and 10 changed no verdict of the 16."""
_FEWEST_BLOCKS = 6
"""Blocks of a short recording at least: fewer say nothing of their variance. 3 and 12 changed no
verdict of the 16; it acts below 30 s only."""
_CONTAINED = 1e-3
"""Share of what the best explains that a rival may be unable to do and yet contains the best: twins
by theory leave rounding and what their priors hold back. Half and twice changed no verdict of 16
examples (7 synthetic probes, 9 slides of a block)."""


@dataclass(frozen=True)
class Trial:
    """One model with one effect more, fitted.

    Attributes:
        name: the effect.
        label: the reading of it.
        model: the fitted model.
        criterion: its `evidence`, comparable between trials at the same whitening.
        source: the score that it started from.
    """

    name: str
    label: str
    model: ResidualModel
    criterion: float
    source: Score

    @cached_property
    def held_out(self) -> HeldOut:
        """Held-out error."""
        return held_out(self.model)


def evidence(
    model: ResidualModel, floor: float, choices: int = 1, dispersion: float = 1.0
) -> float:
    """-2 log evidence of a model up to a constant of its whitening (Schwarz 1978).

    Args:
        model: fitted.
        floor: white RMS of the noise alone.
        choices: number of families searched.
        dispersion: by which squares and samples count less than those of white noise.
    """
    return (
        square(model) / floor**2 / dispersion
        + model.freedom * float(np.log(len(model.residual) / dispersion))
        + 2.0 * float(np.log(choices))
    )


def decisive(model: ResidualModel, floor: float) -> float:
    """Difference of `evidence` from which another effect is worth a thorough fit.

    Where far more than noise remains, neither is the cause, and small differences mean nothing.

    Args:
        model: fitted.
        floor: white RMS of the noise alone.
    """
    return _DECISIVE * max(square(model) / floor**2 - len(model.residual), 0.0)


def reachable(reached: float, without: float, share: float = REACH) -> float:
    """`evidence` of what lies behind the best by less than a share of its fall.

    Args:
        reached: `evidence` of the best.
        without: the same without an effect.
        share: of the difference.
    """
    return reached + share * max(without - reached, 0.0)


def square(model: ResidualModel) -> float:
    """Squared white residual."""
    return float(model.residual @ model.residual)


def in_place(trial: Trial, model: ResidualModel, floor: float) -> Trial:
    """The trial as it fits in a model that has its effect."""
    criterion = evidence(model, floor, trial.source.family.choices)
    return replace(trial, model=model, criterion=criterion)


def try_effects(
    model: ResidualModel,
    scores: Sequence[Score],
    floor: float,
    reach: float = REACH,
    reached: float = np.inf,
) -> list[Trial]:
    """Refit effects at the whitening of the model, best first.

    The score of a linear family bounds what its effect can reach; effects whose bound is far
    behind the best refit are left out.

    Args:
        model: to be extended.
        scores: of all families.
        floor: white RMS of the noise alone.
        reach: share of the fall of the best that a bound may lie behind.
        reached: `evidence` that an effect is known to reach.
    """
    present = evidence(model, floor)
    trials: list[Trial] = []
    for score in best_by_effect(scores):
        best = min([reached, *(trial.criterion for trial in trials)])
        if score.criterion > reachable(best, present, reach) + CHANCE:
            break
        tell(f"trying {score.family.name}")
        trials.append(try_effect(model, scores, score.family.name, floor))
    return sorted(trials, key=lambda trial: trial.criterion)


def try_effect(model: ResidualModel, scores: Sequence[Score], name: str, floor: float) -> Trial:
    """Fit the promising readings of one effect quickly; return the best.

    Args:
        model: to be extended.
        scores: of families, those of the effect among them.
        name: of the effect.
        floor: white RMS of the noise alone.
    """
    own = sorted((s for s in scores if s.family.name == name), key=lambda s: s.criterion)
    first = {s.family.reading: s for s in reversed(own)}
    picked = sorted(first.values(), key=lambda s: s.criterion)[:_READINGS]
    picked += [s for s in own[:2] if s not in picked]
    tried = []
    for score in picked:
        fitted = model.with_effect(score.family, score.coefficients)
        criterion = evidence(fitted, floor, score.family.choices)
        tried.append(Trial(name, score.family.label, fitted, criterion, score))
    return min(tried, key=lambda trial: trial.criterion)


@dataclass(frozen=True)
class Choice:
    """The best effect and its rivals, all fitted at the whitening of the best.

    Attributes:
        model: fitted with the best effect.
        best: the best effect as a trial on common ground with its rivals.
        rivals: the others, best first.
        without: `evidence` of the same model without the effect.
        dispersion: of the residual that remains, see `challenges.dispersion`.
        equals: rivals that beat the best at their own whitening about as clearly as it beats them.
        thorough: False if the search stopped early because the residual was far too large.
    """

    model: ResidualModel
    best: Trial
    rivals: tuple[Trial, ...]
    without: float
    dispersion: float = 1.0
    equals: tuple[str, ...] = ()
    thorough: bool = True

    def named(self, names: Sequence[str]) -> list[Trial]:
        """The rivals of these names."""
        return [rival for rival in self.rivals if rival.name in names]


def rematch(
    model: ResidualModel, present: str, names: Sequence[str], floor: float
) -> tuple[ResidualModel, list[Trial]]:
    """The model without its present effect, and all named effects tried at its whitening."""
    bare = model.without_effect(present)
    scores = screen(bare, bare.families(names), floor)
    return bare, try_effects(bare, scores, floor, np.inf)


def at_home(own: Trial, bare: ResidualModel, trials: Sequence[Trial], floor: float) -> Choice:
    """The choice of an effect, thoroughly fitted, and its rivals as they are tried there."""
    best = next((trial for trial in trials if trial.label == own.label), own)
    rivals = tuple(trial for trial in trials if trial.name != own.name)
    return Choice(own.model, best, rivals, evidence(bare, floor))


def contains(choice: Choice, rival: Trial) -> bool:
    """Whether a rival could do all that the best does, however precise the data were.

    That is so if what they predict differs by what the rival's parameters can make up for.
    """
    basis = orthonormal(rival.model.jacobian)
    differs = rival.model.residual - choice.best.model.residual
    left = differs - basis @ (basis.T @ differs)
    return float(left @ left) <= _CONTAINED * max(choice.without - choice.best.criterion, 0.0)


def dispersion(model: ResidualModel, floor: float) -> float:
    """Variance of sums of the residual over 5 s, over that of white noise; at least 1.

    Source: Wedderburn 1974, on quasi-likelihood; Newey & West 1987, on the block form.

    Args:
        model: fitted.
        floor: white RMS of the noise alone.
    """
    time, white = instants(model)
    length = min(_BLOCK, (time[-1] - time[0]) / _FEWEST_BLOCKS)
    index = window_index(time, max(length, 1e-9))
    counts = np.bincount(index)
    sums = np.stack([np.bincount(index, column) for column in white.T], axis=1)
    used = counts > 0
    ratio = np.mean(sums[used] ** 2 / counts[used, None]) / floor**2
    return max(1.0, float(ratio))
