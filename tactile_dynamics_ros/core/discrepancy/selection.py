"""Which effect explains a residual best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.discrepancy.choice import Choice, at_home, rematch
from tactile_dynamics_ros.core.discrepancy.homes import simplest
from tactile_dynamics_ros.core.discrepancy.model import Misfit, ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import Score, screen
from tactile_dynamics_ros.core.discrepancy.trials import (
    CHANCE,
    Trial,
    decisive,
    evidence,
    in_place,
    reachable,
    square,
    try_effect,
    try_effects,
)

_MOST_RIVALS = 4
_ROUNDS = 3
_QUICK_SLACK = 1.6
"""Of the squared error that may be left, what a quick fit may leave to be fitted thoroughly."""


def choose_effect(
    model: ResidualModel, scores: Sequence[Score], floor: float, needed: float = np.inf
) -> Choice | None:
    """Refit the effects that could compete, and the best one thoroughly.

    A thorough refit moves the denoised signals and the whitening, on which rivals must then be
    compared with it; should one of them win there, it is refitted in turn. Where the best leaves so
    much that it cannot be the answer, that is the end of it. An effect that explains the residual
    by noise that it makes much larger, as contacts half a metre away do with that of the forces, is
    passed over.

    Args:
        model: to be extended.
        scores: of all families.
        floor: white RMS of the noise alone.
        needed: white RMS that the best must reach.
    """
    trials = try_effects(model, scores, floor)
    if not trials:
        return None
    present = evidence(model, floor)
    slack = _QUICK_SLACK * (needed**2 - floor**2)
    if square(trials[0].model) > (floor**2 + slack) * len(model.residual):
        return _given_up(trials[0], trials[1:], present)
    reach = reachable(trials[0].criterion, present) + CHANCE
    names = [t.name for t in trials if t.criterion <= reach][: 1 + _MOST_RIVALS]
    best = trials[0]
    refined, before = best.model.refined(), Misfit.of(model)
    if before.is_drowned(Misfit.of(refined)):
        others = [score for score in scores if score.family.name != best.name]
        return choose_effect(model, others, floor, needed)
    if square(refined) > needed**2 * len(refined.residual):
        return _given_up(in_place(best, refined, floor), trials[1:], present)
    choice = _compete(best, refined, names, floor, before)
    return simplest(_sparser(choice, names, floor))


def _given_up(best: Trial, rivals: Sequence[Trial], without: float) -> Choice:
    return Choice(best.model, best, tuple(rivals), without, thorough=False)


def _compete(
    best: Trial, refined: ResidualModel, names: Sequence[str], floor: float, before: Misfit
) -> Choice:
    """Exchange the best for the rival that beats it where it is at home, while evidence grows.

    Args:
        best: effect.
        refined: thorough fit with it.
        names: of all that compete.
        floor: white RMS of the noise alone.
        before: without the effect.
    """
    tried = {best.label}
    while True:
        bare, trials = rematch(refined, best.name, names, floor)
        own, rival = in_place(best, refined, floor), trials[0]
        beaten = rival.criterion < own.criterion - decisive(refined, floor)
        if not beaten or rival.label in tried or len(tried) == _ROUNDS:
            break
        other = rival.model.refined()
        worse = in_place(rival, other, floor).criterion > own.criterion
        if worse or before.is_drowned(Misfit.of(other)):
            break
        best, refined = rival, other
        tried.add(best.label)
    return at_home(own, bare, trials, floor)


def _sparser(choice: Choice, names: Sequence[str], floor: float) -> Choice:
    """The same effect on fewer sensors, as long as evidence grows where that is at home.

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
        reading, most = best.source.family.reading, len(best.source.family.kept)
        scores = [
            score
            for score in screen(bare, bare.families([best.name]), floor)
            if score.family.reading == reading and len(score.family.kept) < most
        ]
        fewer = min(scores, key=lambda score: score.criterion, default=None)
        if fewer is None or fewer.criterion > reachable(best.criterion, choice.without):
            return choice
        trial = try_effect(bare, [fewer], best.name, floor)
        model = trial.model.refined()
        own = in_place(trial, model, floor)
        if own.criterion > best.criterion:
            return choice
        choice = at_home(own, *rematch(model, own.name, names, floor), floor)
