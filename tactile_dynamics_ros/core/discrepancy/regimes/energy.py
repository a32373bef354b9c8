"""Where the error of a model is larger than elsewhere, whatever causes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ttest_ind

from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel, instants
from tactile_dynamics_ros.core.discrepancy.regimes.gates import Gates, gates_to_try
from tactile_dynamics_ros.core.discrepancy.structure import (
    window_index,
    window_rows,
    window_starts,
)
from tactile_dynamics_ros.core.numerics.regime import Gate

Array = NDArray[np.float64]

_CELL = 0.1
"""Length of a cell, s, as of those from which effects in regimes are sought. Longer ones blur
places, shorter ones cost time."""
_BLOCK = 0.5
"""Length of the blocks of which one half finds the regime and the other tests it, s. Longer leaves
few blocks of a short regime, shorter lets what is correlated pass for independent."""
_FEWEST = 4
"""Blocks inside and outside at least: of fewer the scatter is unknown. More refuse short ones."""
_SIGNIFICANT = 1e-3
"""P-value from which a regime is told. Higher tells more of them by chance."""
_NOTABLE = 0.7
"""Share of the excess error that a regime must hold to be told: what fails everywhere alike has as
much in a regime as the share of time that it takes. Lower tells regimes of what follows speed."""


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
    """The regime that holds most of the error; None if there is none.

    The best gate parts the cells into two of different mean square with the greatest likelihood.
    Found in every second block, it must part the other blocks as well.

    Args:
        model: fitted.
        floor: white RMS of the noise alone.
    """
    conditions = model.conditions()
    if not conditions:
        return None
    time, white = instants(model)
    starts = window_starts(time, _CELL)
    cells = window_rows(starts, len(time))
    gates = gates_to_try(conditions, cells)
    if not gates.gates:
        return None
    square = np.add.reduceat((white**2).mean(axis=1), starts)
    counts = np.diff(np.append(starts, len(time))).astype(float)
    everything = np.ones(len(cells))
    best = _best(gates, square, counts, everything)
    inside = gates.inside[best] > 0.0
    excess = square - floor**2 * counts
    share = float(np.clip(excess[inside].sum() / max(excess.sum(), 1e-12), 0.0, 1.0))
    p_value = _split_p_value(gates, square, counts, window_index(time[starts], _BLOCK))
    condition = conditions[gates.of_condition[best]]
    taken = float(counts[inside].sum() / counts.sum())
    found = ErrorRegime(gates.gates[best], condition.name, condition.unit, share, taken, p_value)
    return found if p_value < _SIGNIFICANT and share > max(_NOTABLE, 0.5 + 0.5 * taken) else None


def _best(gates: Gates, square: Array, counts: Array, used: Array) -> int:
    """The gate with the greatest likelihood of two variances, larger inside."""
    weight = gates.inside * used
    inner, total = weight @ square, float(used @ square)
    count, whole = weight @ counts, float(used @ counts)
    within = inner / np.maximum(count, 1.0)
    without = (total - inner) / np.maximum(whole - count, 1.0)
    logs = [np.log(np.maximum(values, 1e-12)) for values in (within, without)]
    spread = count * logs[0] + (whole - count) * logs[1]
    return int(np.argmin(np.where(within > without, spread, np.inf)))


def _split_p_value(gates: Gates, square: Array, counts: Array, block: NDArray[np.int64]) -> float:
    """P-value that the blocks which did not find the gate are alike inside and outside.

    Logarithms of their mean squares are compared, so that few large errors do not decide.
    """
    inner: list[float] = []
    outer: list[float] = []
    for parity in (0, 1):
        used = (block % 2 == parity).astype(float)
        best = gates.inside[_best(gates, square, counts, used)]
        for number in np.unique(block[used == 0.0]):
            own = block == number
            for found, acts in ((inner, best), (outer, 1.0 - best)):
                if acts[own] @ counts[own] > 0.5 * counts[own].sum():
                    count = acts[own] @ counts[own]
                    mean = max(float(acts[own] @ square[own] / count), 1e-12)
                    found.append(float(np.log(mean) + 1.0 / count))
    if min(len(inner), len(outer)) < _FEWEST:
        return 1.0
    return float(ttest_ind(inner, outer, equal_var=False, alternative="greater").pvalue)
