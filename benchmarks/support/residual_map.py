"""Where the mechanics fail: residuals of pushes by direction, touched side, turn and speed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.sparse.fit import SparseFit
from tactile_dynamics_ros.core.planar.sparse.prediction import RESIDUALS
from tactile_dynamics_ros.core.planar.sparse.pushes import Pushes

_SECTORS = 4
"""Sectors of the direction of pushes on the support; grain of wood shows in two opposite ones."""
_FEWEST = 4
"""Pushes of which a mean is told at least; of fewer, the std among them is not known."""
_FALSE_ALARMS = 0.05
"""Probability that a map of sound mechanics has a mean that stands out."""


@dataclass(frozen=True)
class Deviation:
    """Mean residual of some of the pushes.

    Attributes:
        grouped_by: "direction", "side", "turn" or "speed". group: which of them, in words.
        residual: one of `RESIDUALS`. pushes: how many.
        mean: of the residual, in its unit. std_error: of the mean.
        stands_out: whether it is beyond what chance does in one of twenty maps.
    """

    grouped_by: str
    group: str
    residual: str
    pushes: int
    mean: float
    std_error: float
    stands_out: bool


def residual_map(fit: SparseFit) -> list[Deviation]:
    """Deviations of all groups, the most significant first."""
    found = []
    for grouped_by, group, chosen in _groups(fit.pushes):
        for k, name in enumerate(RESIDUALS):
            values = fit.residuals[chosen, k]
            values = values[np.isfinite(values)]
            if len(values) >= _FEWEST:
                error = float(values.std(ddof=1) / np.sqrt(len(values))) + 1e-12
                mean = float(values.mean())
                found.append(Deviation(grouped_by, group, name, len(values), mean, error, False))
    tail = _FALSE_ALARMS / max(1, len(found))
    chance = [2.0 * float(student.sf(abs(d.mean) / d.std_error, d.pushes - 1)) for d in found]
    order = np.argsort(chance)
    return [replace(found[k], stands_out=chance[k] < tail) for k in order]


def _groups(pushes: Pushes) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    way = pushes.path[:, -1] - pushes.path[:, 0]
    heading = np.arctan2(way[:, 1], way[:, 0])
    sector = np.round(heading / (2.0 * np.pi / _SECTORS)).astype(int) % _SECTORS
    for k in range(_SECTORS):
        yield "direction", f"{360 * k // _SECTORS} deg on the support", sector == k
    side = np.degrees(np.arctan2(-pushes.normal[:, 1], -pushes.normal[:, 0])).round() % 360
    for angle in np.unique(side):
        yield "side", f"outward normal {angle:.0f} deg", side == angle
    yield from _thirds("turn", "deg", np.degrees(pushes.end[:, 2] - pushes.start[:, 2]))
    if np.ptp(pushes.speed) > 0.3 * np.median(pushes.speed):
        yield from _thirds("speed", "mm/s", 1e3 * pushes.speed)


def _thirds(name: str, unit: str, value: Array) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    low, high = np.quantile(value, [1.0 / 3.0, 2.0 / 3.0])
    yield name, f"below {low:.2g} {unit}", value < low
    yield name, f"{low:.2g} to {high:.2g} {unit}", (value >= low) & (value <= high)
    yield name, f"above {high:.2g} {unit}", value > high
