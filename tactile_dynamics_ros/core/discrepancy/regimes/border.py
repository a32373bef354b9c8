"""Borders of a regime, sample by sample: searched, refined, and those of an event."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    Family,
    ResidualModel,
)
from tactile_dynamics_ros.core.discrepancy.regimes.search import RegimeSearch
from tactile_dynamics_ros.core.discrepancy.regimes.sums import CellSums
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.numerics.regime import Gate

_ROUNDS = 4
"""Fits of the coefficients, each followed by a search for the borders. They settle after two or
three; more only cost time."""
_SECOND_END = 20.0
"""Fall of -2 log evidence that a second border must bring: twice the log of the ten thousand rows
of half a minute, as each parameter pays. Lower cuts regimes at both ends where one suffices."""
_LEAST = 0.05
"""Least share of the instants inside and outside. Lower lets a few bad samples be a regime."""
_NOTHING = 15.0
"""Fall of the log likelihood from which a border cannot be there: e^-15. More only costs time."""
_MEMORY = 0.07
"""Time over which white residuals remember, s: half the window from which motion is read. What
begins at an instant is seen up to so much later, which widens borders by how far the condition
moves meanwhile, over the root of the number of crossings. Less claims borders that are known better
than they are."""
_DIGITS = 0.1
"""Step to which a border is rounded, in its standard deviations: names stay short and no border
moves by more than a tenth of it."""


@dataclass(frozen=True)
class Border:
    """A gate found sample by sample.

    Attributes:
        gate: its ends are rounded.
        std: of its ends, the larger of two, in the unit of the condition.
        share: of the instants inside.
    """

    gate: Gate
    std: float
    share: float


def find_border(
    sums: CellSums, family: Family, condition: Condition, start: Gate, floor: float
) -> Border | None:
    """Fit coefficients and borders in turn, from a gate that is about right.

    With coefficients c inside, an instant is inside if |r - U c|^2 < |r|^2; the best interval of
    the sorted condition is that with the largest sum of the difference (as for a change of the
    mean); that of an event has no upper end. None where no border is left: the family acts
    everywhere, or nowhere.

    Args:
        sums: of the model that lacks the family.
        family: what acts inside.
        condition: with one value for each instant.
        start: first guess.
        floor: white RMS of the noise alone.

    Source: Bai 1997, Econometric Theory 13 (change points by least squares, in turn).
    """
    values = condition.values
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    inside = start.inside(values)
    ends = (0, len(values))
    gain = np.zeros(len(values))
    for _ in range(_ROUNDS):
        gain = _gains(sums, family, inside)[order] / floor**2
        ends = _best_start(gain) if family.event else _best_interval(gain)
        now = np.zeros(len(values), dtype=bool)
        now[order[slice(*ends)]] = True
        if np.array_equal(now, inside):
            break
        inside = now
    low, high = (_end(ranked, gain, end, side) for end, side in zip(ends, (0, 1), strict=True))
    smears = [_smear(sums, values, end) for end, _ in (low, high) if math.isfinite(end)]
    if not smears:
        return None
    std = float(np.hypot(max(low[1], high[1]), max(smears)))
    gate = Gate(start.symbol, round_to(low[0], std), round_to(high[0], std))
    share = float(gate.inside(values).mean())
    return Border(gate, std, share) if _LEAST <= share <= 1.0 - _LEAST else None


def find_border_of(
    model: ResidualModel, name: str, label: str, condition: Condition, start: Gate, floor: float
) -> Border | None:
    """Border of one reading of an effect that a model lacks.

    None too where the model has the effect everywhere, and so does not offer it.

    Args:
        model: without the effect in its regime.
        name: of the effect, without a regime.
        label: of the reading, likewise.
        condition: with one value for each instant.
        start: first guess.
        floor: white RMS of the noise alone.
    """
    for family in model.families([name]):
        if family.label == label:
            return find_border(CellSums.of(model), family, condition, start, floor)
    return None


def _smear(sums: CellSums, values: Array, end: float) -> float:
    """How far a condition moves across a border while white residuals remember."""
    inside = values > end
    crossings = np.flatnonzero(inside[1:] != inside[:-1])
    time = sums.instants
    if not len(crossings):
        return 0.0
    rates = np.abs(values[crossings + 1] - values[crossings])
    rates = rates / np.maximum(time[crossings + 1] - time[crossings], 1e-9)
    return float(_MEMORY * np.median(rates) / np.sqrt(len(crossings)))


def _gains(sums: CellSums, family: Family, inside: NDArray[np.bool_]) -> Array:
    """(N,) |r|^2 - |r - U c|^2 of every instant, fitted to those inside."""
    columns = family.columns[:, list(family.kept)]
    channels = len(columns) // len(inside)
    mask = np.repeat(inside, channels)[:, None]
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    both = np.concatenate([sums.basis, mask * columns / scale], axis=1)
    normal = both.T @ both + 1e-9 * np.eye(both.shape[1])
    found = np.linalg.solve(normal, both.T @ sums.residual)
    kept = sums.basis.shape[1]
    left = sums.residual - sums.basis @ found[:kept]
    acts = columns / scale @ found[kept:]
    return np.asarray((left**2 - (left - acts) ** 2).reshape(-1, channels).sum(axis=1))


def _best_start(gain: Array) -> tuple[int, int]:
    """First and past-last place of the best interval that has no upper end."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    least = max(1, int(_LEAST * len(gain)))
    return least + int(np.argmin(total[least : len(gain) - least + 1])), len(gain)


def _best_interval(gain: Array) -> tuple[int, int]:
    """First and past-last place of the best interval; one-sided unless a second end pays."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    count = len(gain)
    least = max(1, int(_LEAST * count))
    below = least + int(np.argmax(total[least : count - least + 1]))
    above = _best_start(gain)[0]
    lowest = np.minimum.accumulate(total)
    reach = total[least:] - lowest[: len(total) - least]
    stop = least + int(np.argmax(reach))
    first = int(np.argmin(total[: stop - least + 1]))
    one = max((total[below], (0, below)), (total[-1] - total[above], (above, count)))
    two = total[stop] - total[first]
    is_inner = first > 0 and stop < count and stop - first <= count - least
    return (first, stop) if is_inner and two > one[0] + _SECOND_END else one[1]


def _end(ranked: Array, gain: Array, place: int, side: int) -> tuple[float, float]:
    """Value and standard deviation of one border; infinite and 0 where there is none.

    The likelihood of a border is that of the instants on either side of it.
    """
    count = len(ranked)
    if place in (0, count):
        return (-math.inf if side == 0 else math.inf), 0.0
    total = np.cumsum(gain)[:-1]
    height = 0.5 * (-total if side == 0 else total)
    near = _around(height, place - 1)
    steps, middle = np.diff(ranked)[near], 0.5 * (ranked[1:] + ranked[:-1])[near]
    weight = np.exp(height[near] - height[near].max()) * steps
    share = weight / max(float(weight.sum()), 1e-300)
    mean = float(share @ middle)
    return mean, float(np.sqrt(share @ ((middle - mean) ** 2 + steps**2 / 12.0)))


def _around(height: Array, peak: int) -> slice:
    """Places about a peak up to where it has fallen to nothing."""
    deep = height < height[peak] - _NOTHING
    before, after = np.flatnonzero(deep[:peak]), np.flatnonzero(deep[peak:])
    start = int(before[-1]) + 1 if len(before) else 0
    return slice(start, peak + int(after[0]) if len(after) else len(height))


def round_to(value: float, std: float) -> float:
    """Value with the digits that its standard deviation leaves."""
    if not math.isfinite(value) or not std > 0.0:
        return value
    return round(value, -math.floor(math.log10(_DIGITS * std)))


def place_event(model: ResidualModel, name: str, floor: float) -> tuple[str, float | None]:
    """Name of an event with the time at which it fits best, and the standard deviation of that, s.

    Args:
        model: fitted, without it.
        name: of the event, without a time.
        floor: white RMS of the noise alone.

    Raises:
        BadInputError: these contacts cannot show it, or the recording is too short.
    """
    search = RegimeSearch.of(model, floor, [name])
    found = search.candidates() if search is not None else []
    if search is None or not found:
        raise BadInputError(
            f"effect '{name}': no time can be found at which it happens in this recording; say it, "
            f"{name}[t>SECONDS], or leave it out"
        )
    best = found[0]
    condition = next(c for c in model.conditions() if c.symbol == best.gate.symbol)
    border = find_border(search.sums, best.family, condition, best.gate, floor)
    if border is None:
        return f"{name}[{best.gate}]", None
    refined = refine_border(model, name, best.family.label, border)
    return f"{name}[{refined.gate}]", refined.std


_REACH = 2.0
"""Standard deviations about a border within which it is looked for: white residuals that remember
move it by about one. Farther costs steps, nearer cuts the best."""
_STEPS = 7
"""Fits for each border: golden sections then leave a seventh of a standard deviation. More are
finer than a border is known."""


def refine_border(model: ResidualModel, name: str, label: str, border: Border) -> Border:
    """Move the ends of a gate to where the effect behind it explains most.

    White residuals near a border depend on what acted before: only columns that are made white
    behind the gate are exact there.

    Args:
        model: fitted, without the effect.
        name: of the effect, without regime.
        label: of the reading that acts, without regime.
        border: found sample by sample.
    """
    gate = border.gate
    for upper in (False, True):
        at = gate.high if upper else gate.low
        if math.isinf(at):
            continue

        def loss(value: float, upper: bool = upper, gate: Gate = gate) -> float:
            return -_gain(model, name, label, _moved(gate, value, upper))

        reach = _REACH * border.std
        found = minimize_scalar(
            loss,
            bounds=(at - reach, at + reach),
            method="bounded",
            options={"maxiter": _STEPS, "xatol": 1e-3 * reach},
        )
        if found.fun < loss(at):
            gate = _moved(gate, round_to(float(found.x), border.std), upper)
    return replace(border, gate=gate)


def _moved(gate: Gate, value: float, upper: bool) -> Gate:
    return replace(gate, high=value) if upper else replace(gate, low=value)


def _gain(model: ResidualModel, name: str, label: str, gate: Gate) -> float:
    """Fall of the squared residual with a reading of an effect behind a gate."""
    wanted = label.replace(name, f"{name}[{gate}]", 1)
    families = [f for f in model.families([f"{name}[{gate}]"]) if f.label == wanted]
    return max((score.gain for score in screen(model, families)), default=0.0)
