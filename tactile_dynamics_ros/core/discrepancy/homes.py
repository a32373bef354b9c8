"""Rivals judged where they are at home: at their own thorough fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.discrepancy.choice import Choice, rematch
from tactile_dynamics_ros.core.discrepancy.model import ResidualModel, instants
from tactile_dynamics_ros.core.discrepancy.structure import examine
from tactile_dynamics_ros.core.discrepancy.trials import CHANCE, Trial, evidence, square

_CLOSE = 1.05
_WHITE = 0.01
_SIMPLER = 0.5
_FAR = 1.06
_EQUAL = 0.4
"""Share of the lead of the best by which a rival must win at home to be its equal."""


@dataclass(frozen=True)
class _Home:
    """A rival thoroughly fitted, and all effects of a choice at its whitening.

    The signals that a thorough fit denoises follow its model, which puts all others at a
    disadvantage there.

    Attributes:
        model: with the rival. floor: white RMS of the noise alone. bare: the model without it.
        own: the rival as a trial there. others: the rest, best first.
    """

    model: ResidualModel
    floor: float
    bare: ResidualModel
    own: Trial
    others: tuple[Trial, ...]

    def lead(self, name: str) -> float:
        """By how much the rival beats an effect here."""
        found = [trial.criterion for trial in self.others if trial.name == name]
        return found[0] - self.own.criterion if found else np.inf


def _homes(
    choice: Choice, freedoms: tuple[float, float], least_p_value: float = 0.0
) -> Iterator[_Home]:
    """Homes of the rivals that fit nearly as well as the best, the simplest first.

    Args:
        choice: among them.
        freedoms: lowest and highest number of parameters beyond those of the best.
        least_p_value: of what a rival leaves being white noise.
    """
    names = [choice.best.name, *(rival.name for rival in choice.rivals)]
    limit = _CLOSE * square(choice.best.model)
    for rival in sorted(choice.rivals, key=lambda trial: trial.model.freedom):
        extra = rival.model.freedom - choice.best.model.freedom
        if square(rival.model) > limit or not freedoms[0] <= extra <= freedoms[1]:
            continue
        model = rival.model.refined()
        structure = examine(*instants(model))
        if structure.p_value < least_p_value:
            continue
        bare, trials = rematch(model, rival.name, names, structure.floor)
        own = [trial for trial in trials if trial.name == rival.name]
        if own:
            others = tuple(trial for trial in trials if trial is not own[0])
            yield _Home(model, structure.floor, bare, own[0], others)


def simplest(choice: Choice) -> Choice:
    """A rival with fewer parameters, if it leaves white noise and nobody beats it at home.

    Where the best leaves far more than noise, no simpler one that fits as well can leave noise.
    """
    floor = examine(*instants(choice.model)).floor
    if square(choice.model) > (_FAR * floor) ** 2 * len(choice.model.residual):
        return choice
    for home in _homes(choice, (-np.inf, -_SIMPLER), _WHITE):
        best = min((trial.criterion for trial in home.others), default=np.inf)
        if best > home.own.criterion - CHANCE:
            return Choice(home.model, home.own, home.others, evidence(home.bare, home.floor))
    return choice


def with_equals(choice: Choice) -> Choice:
    """The choice with rivals as simple as the best that it cannot be told from.

    They beat it at home about as clearly as they lose to it.
    """
    best, found = choice.best, []
    for home in _homes(choice, (-_SIMPLER, _SIMPLER)):
        [away] = choice.named([home.own.name])
        if home.lead(best.name) > max(0.0, _EQUAL * (away.criterion - best.criterion)):
            found.append(home.own.name)
    return replace(choice, equals=tuple(found))
