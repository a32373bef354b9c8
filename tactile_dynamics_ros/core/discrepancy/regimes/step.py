"""Find where a model fails, and add an effect that acts only there.

An effect in a regime is added if it explains what none does that acts everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.challenges import is_outdone_by_law
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.border import (
    find_border,
    find_border_of,
    refine_border,
)
from tactile_dynamics_ros.core.discrepancy.regimes.search import Candidate, RegimeSearch
from tactile_dynamics_ros.core.discrepancy.regimes.sums import CellSums, Gates, gates_to_try
from tactile_dynamics_ros.core.discrepancy.screening import FEIGNED, Score, screen
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
from tactile_dynamics_ros.core.discrepancy.structure import window_index
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


_BLOCK = 0.5
"""Length of the blocks of which one half finds the regime and the other tests it, s. Longer leaves
few blocks of a short regime, shorter lets what is correlated pass for independent."""
_FEWEST = 4
"""Blocks inside and outside at least: of fewer the scatter is unknown. More refuse short ones."""
_SIGNIFICANT = 1e-2
"""P-value from which a regime is reported, as that of the adequacy test. Higher tells more of them
by chance, lower none of recordings of a few seconds."""
_CONTRAST = 1.2
"""Mean square inside over that outside from which a regime is reported: what a fit has not seen is
a few per cent larger in any case. Lower tells regimes of motion that the rest does not have."""
_NOTABLE = 0.7
"""Share of the excess error that a regime must hold to be reported: what fails everywhere alike has
as much in a regime as the share of time that it takes. Lower tells regimes of what follows
speed."""


@dataclass(frozen=True)
class ErrorRegime:
    """A regime in which the error is larger than elsewhere.

    Attributes:
        gate: where.
        name: of the condition. unit: of it.
        share_of_error: of the excess error that lies inside. share_of_time: that it takes.
        p_value: that the half of the blocks which did not find it shows as much by chance.
    """

    gate: Gate
    name: str
    unit: str
    share_of_error: float
    share_of_time: float
    p_value: float


def find_error_regime(model: ResidualModel, floor: float) -> ErrorRegime | None:
    """The regime that holds most of the error of a fit to the rest; None if there is none.

    The best gate parts the cells into two of different mean square with the greatest likelihood,
    where the model is fitted to the cells outside: what happens inside cannot spoil it. Found in
    every second block, the gate must part the other blocks as well.

    Args:
        model: fitted.
        floor: white RMS of the noise alone.
    """
    conditions = model.conditions()
    if not conditions:
        return None
    sums = CellSums.of(model)
    gates = gates_to_try(model, conditions, sums)
    if not gates.gates:
        return None
    counts = np.array([float(r.stop - r.start) for r in sums.rows])
    best, losses = _best(gates, sums, counts, np.ones(len(sums.rows)))
    inside = gates.inside[best] > 0.0
    excess = losses - floor**2 * counts
    share = float(np.clip(excess[inside].sum() / max(excess.sum(), 1e-12), 0.0, 1.0))
    within, without = (losses[own].sum() / counts[own].sum() for own in (inside, ~inside))
    taken = float(counts[inside].sum() / counts.sum())
    if within < _CONTRAST * without or share < max(_NOTABLE, 0.5 + 0.5 * taken):
        return None
    p_value = _split_p_value(gates, sums, counts)
    condition = conditions[gates.of_condition[best]]
    found = ErrorRegime(gates.gates[best], condition.name, condition.unit, share, taken, p_value)
    return found if p_value < _SIGNIFICANT else None


def _best(gates: Gates, sums: CellSums, counts: Array, used: Array) -> tuple[int, Array]:
    """The gate with the greatest likelihood of two variances, larger inside, and losses (W,)."""
    losses = _losses(gates, sums, used)
    inner_weight, outer_weight = gates.inside * used, (1.0 - gates.inside) * used
    spread = np.zeros(len(losses))
    means = []
    for weight in (inner_weight, outer_weight):
        number = weight @ counts
        mean = np.sum(weight * losses, axis=1) / np.maximum(number, 1.0)
        spread += number * np.log(np.maximum(mean, 1e-12))
        means.append(mean)
    best = int(np.argmin(np.where(means[0] > means[1], spread, np.inf)))
    return best, losses[best]


def _losses(gates: Gates, sums: CellSums, used: Array) -> Array:
    """Squared residuals (G, W) of every cell under a fit to the used cells outside each gate."""
    size = sums.share.shape[1]
    outside = (1.0 - gates.inside) * used
    own = (outside @ sums.own.reshape(len(used), -1)).reshape(-1, size, size)
    found = np.linalg.solve(own + FEIGNED * np.eye(size), (outside @ sums.share)[..., None])[..., 0]
    bent = np.stack([np.sum((found @ cell) * found, axis=1) for cell in sums.own], axis=1)
    return np.asarray(sums.square - 2.0 * found @ sums.share.T + bent)


def _split_p_value(gates: Gates, sums: CellSums, counts: Array) -> float:
    """P-value that the blocks which did not find the gate are alike inside and outside.

    Logarithms of their mean squares are compared, so that few large errors do not decide.
    """
    block = window_index(sums.time, _BLOCK)
    inner: list[float] = []
    outer: list[float] = []
    for parity in (0, 1):
        used = (block % 2 == parity).astype(float)
        best, losses = _best(gates, sums, counts, used)
        for found, acts in ((inner, gates.inside[best]), (outer, 1.0 - gates.inside[best])):
            for number in np.unique(block[used == 0.0]):
                own = block == number
                count = float(acts[own] @ counts[own])
                if count > 0.5 * counts[own].sum():
                    mean = max(float(acts[own] @ losses[own] / count), 1e-12)
                    found.append(float(np.log(mean) + 1.0 / count))
    if min(len(inner), len(outer)) < _FEWEST:
        return 1.0
    return _welch_p_value(np.array(inner), np.array(outer))


def _welch_p_value(larger: Array, smaller: Array) -> float:
    """One-sided p-value of Welch's t-test; scipy.stats, which has it too, takes long to import."""
    variances = [np.var(sample, ddof=1) / len(sample) for sample in (larger, smaller)]
    total = sum(variances)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (larger.mean() - smaller.mean()) / np.sqrt(total)
        sizes = (len(larger), len(smaller))
        freedom = total**2 / sum(v**2 / (n - 1) for v, n in zip(variances, sizes, strict=True))
    return float(stdtr(np.nan_to_num(freedom, nan=1.0), -t))
