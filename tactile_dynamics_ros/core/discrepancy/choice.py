"""An effect chosen, and its rivals on common ground with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.discrepancy.model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import orthonormal, screen
from tactile_dynamics_ros.core.discrepancy.trials import Trial, evidence, try_effects

_CONTAINED = 1e-3
"""Share of what the best explains that a rival may be unable to do and yet contains the best."""


@dataclass(frozen=True)
class Choice:
    """The best effect and its rivals, all fitted at the whitening of the best.

    Attributes:
        model: fitted with the best effect.
        best: the best effect as a trial on common ground with its rivals.
        rivals: the others, best first.
        without: `evidence` of the same model without the effect.
        dispersion: of the residual that remains, see `tempering`.
        equals: rivals that beat the best at their own whitening about as clearly as it beats them.
        thorough: whether all of them are; what leaves too much is not fitted further.
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
