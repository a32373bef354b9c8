"""Where a model fails that is fitted to the rest of the recording, whatever causes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.sums import CellSums, Gates, gates_to_try
from tactile_dynamics_ros.core.discrepancy.screening import FEIGNED
from tactile_dynamics_ros.core.discrepancy.structure import window_index
from tactile_dynamics_ros.core.numerics.regime import Gate

Array = NDArray[np.float64]

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
    channels = len(model.residual) // len(conditions[0].values)
    cells = [slice(r.start // channels, r.stop // channels) for r in sums.rows]
    gates = gates_to_try(conditions, cells)
    if not gates.gates:
        return None
    counts = np.array([float(r.stop - r.start) for r in sums.rows])
    best, losses = _best(gates, sums, counts, np.ones(len(cells)))
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
