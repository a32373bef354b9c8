"""Add an effect that acts only in a regime, if it explains what none does that acts everywhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from tactile_dynamics_ros.core.discrepancy.challenges import is_outdone_by_law
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.border import (
    find_border,
    find_border_of,
    refine_border,
)
from tactile_dynamics_ros.core.discrepancy.regimes.search import Candidate, RegimeSearch
from tactile_dynamics_ros.core.discrepancy.screening import Score, screen
from tactile_dynamics_ros.core.discrepancy.search import (
    DiagnosisConfig,
    Step,
    explained_share,
    is_enough,
    is_hopeless,
    is_noise,
    reconsider_steps,
)
from tactile_dynamics_ros.core.discrepancy.selection import choose_effect
from tactile_dynamics_ros.core.discrepancy.trials import (
    CHANCE,
    at_home,
    in_place,
    reachable,
    rematch,
    try_effect,
)
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment, assess
from tactile_dynamics_ros.core.numerics.regime import Gate, split_label
from tactile_dynamics_ros.core.progress import tell

_CLEARLY = 3.0
"""Multiple of `indifference` by which an effect in a regime must do better than one everywhere: 30
of -2 log evidence, odds of e^15, beyond the price of all gates that were tried. Lower gates effects
that act everywhere."""
_MOST_CANDIDATES = 8
"""Effects with a condition that are refitted. Each costs a quick fit; the true one was among the
first four in all cases."""
_HALF = 0.5
"""Share of what effects that act everywhere leave, beyond noise, that one in a regime may leave at
most to be preferred to them. Nearer to 1 regimes are reported for what is next to nothing."""


def add_regional_effects(
    model: ResidualModel,
    first: Assessment,
    steps: Sequence[Step],
    accounted: bool,
    config: DiagnosisConfig,
) -> tuple[Step, ...]:
    """Effects of which the first acts in a regime, if they explain a residual better than others.

    It must have clearly more evidence than any effect that acts everywhere, with the price of the
    search; its regime, found in every second block, must predict the other blocks. Further effects
    are added while much remains, and borders that were found without them are found again. They
    must explain the residual together, or the first nine tenths of the excess error. Parameters
    that cannot be, as of a spring that pushes, can be in no regime either.

    Args:
        model: fitted.
        first: assessment of it.
        steps: effects that were found to act everywhere.
        accounted: whether these are the cause, as far as that is known.
        config: levels and depths.
    """
    if first.within_stated or (accounted and len(steps) == 1 and steps[0].after.white):
        return ()
    tell("looking for an effect that acts in a part of the recording")
    found: list[Step] = []
    present, assessment = model, first
    while len(found) < config.depth:
        step = _add_one(present, assessment, bool(found), config)
        if step is None:
            break
        found.append(step)
        if len(found) > 1:
            found = _with_new_borders(found, config)
        if is_enough(found, first, config) or is_hopeless(found, first, config):
            break
        present, assessment = found[-1].choice.model, found[-1].after
    if not all(found[-1].choice.model.is_possible(step.name) for step in found):
        return ()
    if len(found) > 1 and is_enough(found, first, config):
        return reconsider_steps(found, config)
    rivals = steps if accounted else ()
    return tuple(found[:1]) if found and _is_preferred(found[0], first, rivals, config) else ()


def _add_one(
    model: ResidualModel, before: Assessment, beside: bool, config: DiagnosisConfig
) -> Step | None:
    """One effect in a regime; beside one that is there already, also one that acts everywhere."""
    floor = before.structure.floor
    search = RegimeSearch.of(model, floor)
    found = [] if search is None else _promising(search, config)
    scores = _scores(model, search, found) if search is not None and found else []
    if not scores and not beside:
        return None
    choice = choose_effect(model, [*scores, *before.scores], floor)
    if choice is None or choice.best.criterion > choice.without - config.indifference:
        return None
    if not beside and split_label(choice.best.name)[1] is None:
        return None
    return Step(choice, assess(choice.model, config.significance))


def _with_new_borders(steps: Sequence[Step], config: DiagnosisConfig) -> list[Step]:
    """Steps in which the earlier regimes have the borders that they have beside the last effect."""
    found = [steps[-1]]
    for step in steps[:-1]:
        found.append(_with_new_border(step, found[-1], config))
    return found


def _with_new_border(step: Step, last: Step, config: DiagnosisConfig) -> Step:
    """A step as it is in the model of the last one, its border found again."""
    model, floor = last.choice.model, last.after.structure.floor
    name = step.name
    bare = model.without_effect(name)
    plain, regime = split_label(name)
    label = split_label(step.choice.best.label)[0]
    if regime is not None:
        [gate] = regime.gates
        condition = next(c for c in bare.conditions() if c.symbol == gate.symbol)
        border = find_border_of(bare, plain, label, condition, gate, floor)
        if border is not None:
            name = f"{plain}[{refine_border(bare, plain, label, border).gate}]"
    trial = try_effect(bare, screen(bare, bare.families([name]), floor), name, floor)
    fitted = trial.model.refined()
    own = in_place(trial, fitted, floor)
    choice = at_home(own, *rematch(fitted, name, [name], floor), floor)
    return Step(choice, assess(fitted, config.significance))


def _promising(search: RegimeSearch, config: DiagnosisConfig) -> list[Candidate]:
    """The best candidates, one for each effect and condition; none if chance may have made them."""
    ranked = search.candidates()
    best = ranked[0].criterion
    if best > search.criterion_everywhere() - _CLEARLY * config.indifference:
        return []
    near = [one for one in ranked if one.criterion <= reachable(best, 0.0) + CHANCE]
    families = {id(one.family): one.family for one in near[:_MOST_CANDIDATES]}
    if search.split_p_value(list(families.values())) > config.significance:
        return []
    unique: dict[tuple[str, str], Candidate] = {}
    for one in near:
        unique.setdefault((one.family.name, one.gate.symbol), one)
    return list(unique.values())[:_MOST_CANDIDATES]


def _scores(
    model: ResidualModel, search: RegimeSearch, candidates: Sequence[Candidate]
) -> list[Score]:
    """Scores of the candidates behind their own borders, with the price of the search.

    The border of the best is refined, and is that of all with the same condition.
    """
    conditions: dict[str, Condition] = {c.symbol: c for c in model.conditions()}
    gates: list[tuple[Candidate, Gate]] = []
    refined: dict[str, Gate] = {}
    for one in candidates:
        symbol, name = one.gate.symbol, one.family.name
        border = find_border(search.sums, one.family, conditions[symbol], one.gate, search.floor)
        if border is None:
            continue
        if not refined:
            border = refine_border(model, name, one.family.label, border)
            refined[symbol] = border.gate
        gate = refined.get(symbol, border.gate)
        gates.append((one, _start_of(gate) if one.family.event else gate))
    names = [f"{one.family.name}[{gate}]" for one, gate in gates]
    families = model.families(list(dict.fromkeys(names)))
    priced = [
        replace(family, choices=family.choices * search.gates.count(family)) for family in families
    ]
    return screen(model, priced, search.floor)


def _start_of(gate: Gate) -> Gate:
    """The gate of an event at the same border: it acts from there on."""
    return Gate(gate.symbol, gate.low if math.isfinite(gate.low) else gate.high)


def _is_preferred(
    step: Step, first: Assessment, steps: Sequence[Step], config: DiagnosisConfig
) -> bool:
    """Whether an effect in a regime explains enough, and more than those that act everywhere."""
    floor = step.after.structure.floor
    share = explained_share(first.rms, step.after.rms, floor)
    settled = is_enough([step], first, config)
    if not settled and share < config.mostly:
        return False
    if not is_noise(first, [step], config) and is_outdone_by_law(
        step, floor, config.indifference, of_any_size=False
    ):
        return False
    if not steps:
        return True
    left = max(steps[-1].after.rms ** 2 - floor**2, 0.0)
    return step.after.white or step.after.rms**2 - floor**2 < _HALF * left
