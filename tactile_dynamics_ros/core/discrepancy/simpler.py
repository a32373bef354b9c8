"""Simpler readings and rivals of an effect: fewer sensors, fewer parameters, equals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    ResidualModel,
    instants,
)
from tactile_dynamics_ros.core.discrepancy.screening import Score, screen
from tactile_dynamics_ros.core.discrepancy.structure import examine
from tactile_dynamics_ros.core.discrepancy.trials import (
    CHANCE,
    Choice,
    Trial,
    at_home,
    dispersion,
    evidence,
    in_place,
    reachable,
    rematch,
    square,
    try_effect,
)
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import assess
from tactile_dynamics_ros.core.progress import tell

_CLOSE = 1.05
"""Squared residual over that of the best up to which rivals are refitted for themselves: each costs
a thorough fit. 1.025 and 1.1 changed no verdict of 16 examples (7 synthetic probes, 9 slides of a
block) nor of three held objects."""
WHITE = 0.01
"""P-value from which what a simpler rival leaves is white noise, as `significance` of the
diagnosis. 0.005 and 0.02 changed no verdict of the 16."""
_SIMPLER = 0.5
"""Effective parameters by which a rival must have fewer to be simpler: numbers of those that data
determine are no integers. 0.25 and 1 changed no verdict of the 16."""
_FAR = 1.06
"""RMS over the noise floor from which no simpler rival that fits as well (`_CLOSE`) can leave
noise: the floor is known to 1 %, and none is looked for. 1.03 and 1.12 changed no verdict of the 16
nor of three held objects."""
_EQUAL = 0.4
"""Share of the lead of the best, at its whitening, by which a rival must win at its own to be its
equal: both whitenings favour what was fitted there. At 1 the better of the two counts, at 0 whoever
wins at its own. 0.2 and 0.8 changed no verdict of the 16 nor of three held objects."""


def on_fewer_sensors(
    best: Trial, model: ResidualModel, floor: float, exchange: bool = False
) -> Trial:
    """The effect on as many sensors as evidence asks for, if all of them leave what they report.

    What remains then are errors that last, which more parameters of more sensors make smaller, and
    the body's with them: squares count less by the largest `dispersion` of the restrictions.

    Args:
        best: one reading of an effect.
        model: thoroughly fitted with it.
        floor: white RMS of the noise alone.
        exchange: whether what the effect contains may take its place, as a bias that of a drift.
    """
    own = in_place(best, model, floor)
    if not assess(model).within_stated:
        return own
    bare = model.without_effect(best.name)
    contained = best.source.family.contains if exchange else ""
    scores = _restrictions(bare, best, floor)
    scores += screen(bare, bare.families([contained]), floor) if contained else []
    scores.sort(key=lambda score: -score.criterion)
    tried = [own]
    for score in {(s.family.name, len(s.family.kept)): s for s in scores}.values():
        tell(f"restricting the effect to {score.family.label}")
        trial = try_effect(bare, [score], score.family.name, floor)
        refined = trial.model.refined()
        if assess(refined).within_stated:
            tried.append(replace(trial, model=refined))
    ratio = max(dispersion(trial.model, floor) for trial in tried)

    def tempered(trial: Trial) -> float:
        return evidence(trial.model, floor, trial.source.family.choices, ratio)

    return replace(min(tried, key=tempered), criterion=best.criterion)


def sparser(choice: Choice, names: Sequence[str], floor: float) -> Choice:
    """Restrict the effect to fewer sensors, as long as evidence grows at the refitted whitening.

    Signals that a thorough fit denoises follow its model: errors that it gives to sensors that have
    none look significant there.

    Args:
        choice: of one reading of an effect.
        names: of all that compete.
        floor: white RMS of the noise alone.
    """
    while True:
        best = in_place(choice.best, choice.model, floor)
        bare = choice.model.without_effect(best.name)
        fewer = min(
            _restrictions(bare, best, floor), key=lambda score: score.criterion, default=None
        )
        if fewer is None or fewer.criterion > reachable(best.criterion, choice.without):
            return choice
        trial = try_effect(bare, [fewer], best.name, floor)
        model = trial.model.refined()
        own = in_place(trial, model, floor)
        if own.criterion > best.criterion:
            return choice
        choice = at_home(own, *rematch(model, own.name, names, floor), floor)


def _restrictions(
    bare: ResidualModel, best: Trial, floor: float, otherwise: bool = False
) -> list[Score]:
    """Scores of an effect with fewer parameters: on fewer sensors, or in other readings of it."""
    family = best.source.family
    return [
        score
        for score in screen(bare, bare.families([best.name]), floor)
        if (score.family.reading != family.reading) == otherwise
        and len(score.family.kept) < len(family.kept)
    ]


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
    choice: Choice,
    rivals: Sequence[Trial],
    freedoms: tuple[float, float],
    least_p_value: float = 0.0,
) -> Iterator[_Home]:
    """Homes of the rivals that fit nearly as well as the best, the simplest first.

    Args:
        choice: among them.
        rivals: at the whitening of the best; another reading of it must be the better one at home.
        freedoms: lowest and highest number of parameters beyond those of the best.
        least_p_value: of what a rival leaves being white noise.
    """
    names = [choice.best.name, *(rival.name for rival in choice.rivals)]
    limit = _CLOSE * square(choice.best.model)
    for rival in sorted(rivals, key=lambda trial: trial.model.freedom):
        extra = rival.model.freedom - choice.best.model.freedom
        if square(rival.model) > limit or not freedoms[0] <= extra <= freedoms[1]:
            continue
        tell(f"comparing where {rival.label} is at home")
        model = rival.model.refined()
        structure = examine(*instants(model))
        if structure.p_value < least_p_value:
            continue
        bare, trials = rematch(model, rival.name, names, structure.floor)
        own = [trial for trial in trials if trial.name == rival.name]
        if own and (rival.name != choice.best.name or own[0].label == rival.label):
            others = tuple(trial for trial in trials if trial is not own[0])
            yield _Home(model, structure.floor, bare, own[0], others)


def _plainer(choice: Choice, floor: float) -> list[Trial]:
    """Other readings of the best effect that have fewer parameters, such as one common to all."""
    best = choice.best
    bare = choice.model.without_effect(best.name)
    scores = _restrictions(bare, best, floor, otherwise=True)
    readings = sorted({score.family.reading for score in scores})
    return [
        try_effect(bare, [s for s in scores if s.family.reading == reading], best.name, floor)
        for reading in readings
    ]


def simplest(choice: Choice) -> Choice:
    """Prefer a rival with fewer parameters that leaves white noise and wins at its own whitening.

    Where the best leaves far more than noise, no simpler one that fits as well can leave noise.
    """
    floor = examine(*instants(choice.model)).floor
    if square(choice.model) > (_FAR * floor) ** 2 * len(choice.model.residual):
        return choice
    rivals = (*choice.rivals, *_plainer(choice, floor))
    for home in _homes(choice, rivals, (-np.inf, -_SIMPLER), WHITE):
        best = min((trial.criterion for trial in home.others), default=np.inf)
        if best > home.own.criterion - CHANCE:
            return Choice(home.model, home.own, home.others, evidence(home.bare, home.floor))
    return choice


def with_equals(choice: Choice) -> Choice:
    """Name the rivals that are as simple as the best and cannot be distinguished from it.

    Each beats the best at its own whitening about as clearly as it loses at that of the best.
    """
    best, found = choice.best, []
    for home in _homes(choice, choice.rivals, (-_SIMPLER, _SIMPLER)):
        [away] = choice.named([home.own.name])
        if home.lead(best.name) > max(0.0, _EQUAL * (away.criterion - best.criterion)):
            found.append(home.own.name)
    return replace(choice, equals=tuple(found))
