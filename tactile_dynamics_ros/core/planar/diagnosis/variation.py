"""How friction differs from place to place, judged beside what single effects could do.

Friction differs in two ways: along the way, as stick and slip have it, which each push meets anew;
and over the table, where all pushes over a place meet the same. The latter is a random field
that the support points of the object feel, each where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.diagnosis.fitted import FittedPushes
from tactile_dynamics_ros.core.planar.properties.push_model import Sharpness

Array = NDArray[np.float64]
Rows = tuple[Array, Array]
"""Changes of rows (N, D, c) of the motion and (P, 3, c) of poses."""

SLOPE = "friction_gradient"
"""The effect that a field over the table imitates where pushes go over a few of its lengths."""
VARIATION = "friction_variation"
"""Name for the field over the table, in groups; it is no effect that a model could have."""
VARIATIONS = (0.003, 0.01, 0.03, 0.06, 0.1, 0.14)
"""Relative variations along the way that are compared: real tables have up to 0.13, and one that
varies by more is not told from what acts there. A finer grid changes variances by a fifth."""
_FIELDS = (0.01, 0.02, 0.04, 0.07, 0.1, 0.14)
"""Relative standard deviations of the field over the table that are compared, likewise."""
_LENGTHS = (0.03, 0.1)
"""Distances over which the field stays alike, m: grain and wear, and a table that was wiped or
lacquered unevenly. What lies between is told as either: log evidence differs by less than 4."""
_CLEAR = 10.0
"""Log evidence by which a field has to beat the best single effect on an even table: on tables
made for tuning whose friction varies by 5 % it was 19 and more, on those with a slope less than 0.
Lower makes effects seem variation, higher variation a slope."""
_ALIKE = 1.0
"""Log evidence within which the smaller field is told: over a few of its lengths a smooth field of
14 % makes the same as one of 7 %, and the larger would be said of the table."""
_CHANCE = 3.0
"""Log evidence that chance makes, one in twenty: a field that is worse than an effect by no more
may as well be the cause."""
_MOST_SPOTS = 150
"""Spots of which a field is made at most; where pushes go farther the field is made smoother. The
time grows as the cube."""


@dataclass(frozen=True)
class Table:
    """How friction differs over a table, relative.

    Attributes:
        along: standard deviation along the way. field: standard deviation over the table.
        length: m over which the field stays alike.
        imitates_slope: whether a field could do what a slope of the friction does here.
    """

    along: float
    field: float = 0.0
    length: float = _LENGTHS[0]
    imitates_slope: bool = False

    @property
    def total(self) -> float:
        """Standard deviation at one place."""
        return float(np.hypot(self.along, self.field))

    @property
    def remark(self) -> str:
        """The field in a sentence; empty without one."""
        if not self.field:
            return ""
        return (
            f"Friction differs over the table by {100.0 * self.field:.0f} % or so, over distances "
            f"of {1e3 * self.length:.0f} mm; a slope of the friction would not be told from that."
        )


def field_rows(pushes: FittedPushes, sharp: Sharpness, length: float) -> Array:
    """Rows (N, D, K) by independent standard normal spots of a field with standard deviation 1.

    f(p) = sum_k z_k sqrt(2 / pi) exp(-|p - c_k|^2 / l^2) with the c_k a distance l apart has the
    covariance exp(-|p - q|^2 / (2 l^2)).

    Args:
        pushes: at their motion.
        sharp: how strictly the model is taken.
        length: m; larger where that takes too many spots.
    """
    feet = pushes.feet()
    spots, length = _spots(feet, length)
    shares = (
        np.sqrt(2.0 / np.pi) * np.exp(-np.sum((feet - spot) ** 2, axis=2) / length**2)
        for spot in spots
    )
    lack = pushes.lack_by_shares(sharp, shares)
    rows = np.zeros((len(pushes.intervals), *lack.shape[1:]))
    rows[pushes.middle] = lack / pushes.noise(sharp)[:, :, None]
    return rows


def _spots(feet: Array, length: float) -> tuple[Array, float]:
    """Centres (K, 2) of the spots near feet (R, n, 2), and their distance, m."""
    low = feet.min(axis=(0, 1))
    while True:
        cell = np.unique(np.round((feet.reshape(-1, 2) - low) / length).astype(int), axis=0)
        around = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        near = np.unique((cell[:, None] + around).reshape(-1, 2), axis=0)
        if len(near) <= _MOST_SPOTS:
            return low + length * near, length
        length *= 1.2


@dataclass(frozen=True, eq=False)
class _Gram:
    """What one whitening makes of the residual and of all columns: G = C^T C, C^T r, r^T r."""

    columns: Array
    share: Array
    square: float
    log_volume: float

    def evidence(self, sizes: Array) -> float:
        """Log probability (up to a constant) of r ~ N(0, I + C D^2 C^T), D the sizes (c,).

        Source: Patterson, Thompson 1971 (restricted likelihood), with proper priors.
        """
        kept = sizes > 0.0
        scale = sizes[kept]
        inner = scale[:, None] * self.columns[np.ix_(kept, kept)] * scale
        inner[np.diag_indices(len(inner))] += 1.0
        root = np.linalg.cholesky(inner)
        explained = float(np.sum(np.linalg.solve(root, scale * self.share[kept]) ** 2))
        volume = 2.0 * float(np.sum(np.log(np.diag(root)))) + 2.0 * self.log_volume
        return -0.5 * (self.square - explained + volume)


White = Callable[[float, Array, Array], tuple[Array, Array, float]]
"""From a variation along the way and rows: white residual (M,), columns (M, c), log volume."""


def likeliest_table(
    white: White,
    always: Rows,
    effects: Sequence[tuple[str, Rows]],
    field: Callable[[float], Array],
    most: Table | None = None,
) -> Table:
    """The variations of friction that are likeliest beside no effect or a single one.

    Effects have their plausible sizes, so that what they could do is no evidence for a variation;
    one at a time, since all together could do anything. A field is said only where it beats
    every effect on an even table clearly.

    Args:
        white: makes rows white.
        always: rows of what may differ anyway, per standard deviation.
        effects: name and rows of each, likewise.
        field: rows (N, 3, K) of a field of a length.
        most: table that none exceeds.
    """
    fields = [field(length) for length in _LENGTHS]
    none = np.zeros((*always[1].shape[:2], 0))
    groups = [always, *(rows for _, rows in effects), *((rows, none) for rows in fields)]
    ends = np.cumsum([0, *(rows.shape[2] for rows, _ in groups)])
    motion = np.concatenate([rows for rows, _ in groups], axis=2)
    poses = np.zeros((*always[1].shape[:2], motion.shape[2]))
    told = np.concatenate([rows for _, rows in groups], axis=2)
    poses[:, :, : told.shape[2]] = told
    parts = [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    names = ["", *(name for name, _ in effects)]
    found: dict[tuple[str, Table], float] = {}
    for along in VARIATIONS:
        if most and along > most.along:
            continue
        residual, columns, volume = white(along, motion, poses)
        gram = _Gram(columns.T @ columns, columns.T @ residual, float(residual @ residual), volume)
        for name, table, sizes in _hypotheses(along, parts, names):
            if most and table.field > most.field:
                continue
            key = (name, table)
            found[key] = max(found.get(key, -np.inf), gram.evidence(sizes))
    return replace(_chosen(found), imitates_slope=most.imitates_slope) if most else _chosen(found)


def _hypotheses(
    along: float, parts: Sequence[slice], names: Sequence[str]
) -> Iterator[tuple[str, Table, Array]]:
    """Each effect or none, on each table, and the sizes of all columns."""
    first = len(parts) - len(_LENGTHS)
    for k, name in enumerate(names):
        sizes = np.zeros(parts[-1].stop)
        sizes[parts[0]] = sizes[parts[k]] = 1.0
        yield name, Table(along), sizes
        for j, length in enumerate(_LENGTHS):
            for field in _FIELDS:
                wide = sizes.copy()
                wide[parts[first + j]] = field
                yield name, Table(along, field, length), wide


def _chosen(found: dict[tuple[str, Table], float]) -> Table:
    """The likeliest table, without a field unless that is clearly better."""
    even = max((key for key in found if not key[1].field), key=lambda key: found[key])
    uneven = max((k for k in found if k[1].field), key=lambda key: found[key], default=even)
    if found[uneven] > found[even] + _CLEAR:
        alike = [table for (_, table), v in found.items() if v > found[uneven] - _ALIKE]
        return min((table for table in alike if table.field), key=lambda table: table.field)
    slope = max((v for key, v in found.items() if key[0] == SLOPE), default=-np.inf)
    fields = [v for key, v in found.items() if not key[0] and key[1].field]
    alone = max(fields, default=-np.inf)
    table = even[1]
    return Table(table.along, imitates_slope=bool(alone > slope - _CHANCE))
