"""Which effect explains a residual best, and which rivals fit as well."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Misfit,
    ResidualModel,
    instants,
)
from tactile_dynamics_ros.core.discrepancy.screening import Score, screen
from tactile_dynamics_ros.core.discrepancy.simpler import WHITE, simplest, sparser
from tactile_dynamics_ros.core.discrepancy.structure import examine
from tactile_dynamics_ros.core.discrepancy.trials import (
    CHANCE,
    Choice,
    Trial,
    at_home,
    decisive,
    evidence,
    in_place,
    reachable,
    rematch,
    square,
    try_effect,
    try_effects,
)
from tactile_dynamics_ros.core.progress import tell

_MOST_RIVALS = 4
"""Rivals that compete with the best at its thorough fit: a group has four names at most. 2 and 8
changed no verdict of 16 examples (7 synthetic probes, 9 slides of a block) nor of three held
objects; each costs a quick fit for every round."""
_ROUNDS = 3
"""Effects that may be the best in turn before the search keeps what it has: each costs a thorough
fit, the dearest step of all. 2 and 6 changed no verdict of the 16."""
_QUICK_SLACK = 1.6
"""Multiple of the squared error that may be left at most, up to which a quick fit is followed by a
thorough one, which moves whitening and signals and so finds more. 0.8 and 3.2 changed no verdict of
the 16 nor of three held objects; lower saves thorough fits."""
_REACH = 0.05
"""Share of the fall of the best within which effects are tried in exchange for one that is there:
a fifth of `REACH`, since a good one is present. 0.025 and 0.1 changed no verdict of the 16."""
_DROWNED = 3
"""Readings of an effect that are passed over for the noise that they make, before the effect is: an
offset of all contacts, of three and of two. Each costs a thorough fit; at 0 a finger whose points
are off by 2 cm was called the bias of three others."""


def choose_effect(
    model: ResidualModel,
    scores: Sequence[Score],
    floor: float,
    needed: float = np.inf,
    drowned: Sequence[str] = (),
) -> Choice | None:
    """Refit the effects that could compete, and the best one thoroughly.

    A thorough refit moves the denoised signals and the whitening, on which rivals must then be
    compared with it; should one of them win there, it is refitted in turn. Where the best
    leaves so much that it cannot be the answer, that is the end of it. A reading that explains
    the residual by noise that it makes much larger, as a long lever does with that of a force,
    is passed over: another of the same effect, of fewer contacts, may be the cause. So is an
    effect whose parameters cannot be, such as a spring that pushes; if the next best is clearly
    worse than it and leaves more than noise, there is no choice.

    Args:
        model: to be extended.
        scores: of all families.
        floor: white RMS of the noise alone.
        needed: white RMS that the best must reach.
        drowned: effects of the readings that were passed over, one name for each.
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
    tell(f"refitting all with {best.name}")
    refined, before = best.model.refined(), Misfit.of(model)
    if before.is_drowned(Misfit.of(refined)):
        drowned = (*drowned, best.name)
        label = None if drowned.count(best.name) > _DROWNED else best.source.family.label
        others = _without(scores, best.name, label)
        return choose_effect(model, others, floor, needed, drowned)
    if square(refined) > needed**2 * len(refined.residual):
        return _given_up(in_place(best, refined, floor), trials[1:], present)
    known = {score.family.name for score in scores}
    competed = _compete(best, refined, names, known, floor, before)
    choice = simplest(sparser(competed, names, floor))
    if choice.model.is_possible(choice.best.name):
        return choice
    others = _without(scores, choice.best.name)
    second = choose_effect(model, others, floor, needed, drowned)
    return None if second and _imitates(second, choice.best.name, floor) else second


def _without(scores: Sequence[Score], name: str, label: str | None = None) -> list[Score]:
    """Scores without those of one effect, or without that of one reading of it."""
    return [
        score
        for score in scores
        if score.family.name != name or (label is not None and score.family.label != label)
    ]


def _imitates(choice: Choice, impossible: str, floor: float) -> bool:
    """Whether an effect leaves what another that cannot be explains better, and that is no noise.

    The cause is neither of them then: the other is the nearest to it, and the effect imitates it.
    Where the effect leaves white noise, the other merely fits noise.

    Args:
        choice: the best effect that can be.
        impossible: name of the effect that was better, with parameters that cannot be.
        floor: white RMS of the noise alone.
    """
    if not choice.thorough or examine(*instants(choice.model)).p_value >= WHITE:
        return False
    bare = choice.model.without_effect(choice.best.name)
    own = in_place(choice.best, choice.model, floor)
    scores = screen(bare, bare.families([impossible]), floor)
    other = try_effect(bare, scores, impossible, floor)
    return other.criterion < own.criterion - max(CHANCE, decisive(choice.model, floor))


def _given_up(best: Trial, rivals: Sequence[Trial], without: float) -> Choice:
    return Choice(best.model, best, tuple(rivals), without, thorough=False)


def _compete(
    best: Trial,
    refined: ResidualModel,
    names: Sequence[str],
    known: Collection[str],
    floor: float,
    before: Misfit,
) -> Choice:
    """Exchange the best for a rival that beats it at its own refitted whitening, while that helps.

    What the refitted best may be, by its parameters, competes too, however badly it started: a
    table that leans starts from a centre of mass that a pull had to find first.

    Args:
        best: effect.
        refined: thorough fit with it.
        names: of all that compete.
        known: names of all effects that may be tried.
        floor: white RMS of the noise alone.
        before: without the effect.
    """
    tried = {best.label}
    while True:
        twins = [name for name in refined.imitators(best.name) if name in known]
        bare, trials = rematch(refined, best.name, [*names, *twins], floor)
        own, rival = in_place(best, refined, floor), trials[0]
        beaten = rival.criterion < own.criterion - decisive(refined, floor)
        if not beaten or rival.label in tried or len(tried) == _ROUNDS:
            break
        tell(f"refitting all with {rival.name}")
        other = rival.model.refined()
        worse = in_place(rival, other, floor).criterion > own.criterion
        if worse or before.is_drowned(Misfit.of(other)):
            break
        best, refined = rival, other
        tried.add(best.label)
    return at_home(own, bare, trials, floor)


def exchange(
    model: ResidualModel, added: Sequence[Trial], floor: float, indifference: float
) -> tuple[ResidualModel, tuple[Choice, ...]]:
    """Remove effects that the others make needless, replace those that another betters.

    Effects that were added first had to account for what was still missing then; with it in the
    model another effect, or another reading of the same, may fit better.

    Args:
        model: thoroughly fitted with all added effects.
        added: the effects that may be exchanged.
        floor: white RMS of the noise alone.
        indifference: difference of `evidence` that does not decide.

    Returns:
        The model and the choice of each of its effects beside the others.

    Source: Miller 2002, Subset Selection in Regression, 3.3 (sequential replacement).
    """
    present = list(added)
    changes = len(present)
    choices: list[Choice] = []
    while len(choices) < len(present):
        place = len(choices)
        bare = model.without_effect(present[place].name)
        own, without = in_place(present[place], model, floor), evidence(bare, floor)
        margin = max(indifference, decisive(model, floor))
        scores = screen(bare, bare.families(), floor)
        tried = try_effects(bare, scores, floor, _REACH, own.criterion)
        trials = [trial for trial in tried if trial.model.is_possible(trial.name)]
        if changes and len(present) > 1 and without < own.criterion + indifference:
            model = bare.refined()
            del present[place]
        elif changes and trials and trials[0].criterion < own.criterion - margin:
            present[place] = trials[0]
            model = trials[0].model.refined()
        else:
            rivals = tuple(trial for trial in trials if trial.name != own.name)
            choices.append(Choice(model, own, rivals, without))
            continue
        changes, choices = changes - 1, []
    return model, tuple(choices)
