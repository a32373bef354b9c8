"""How friction differs from place to place, judged beside what single effects could do.

Friction differs in two ways: along the way, as stick and slip have it, which each push meets anew;
and over the table, where all pushes over a place meet the same. The latter is a random field
that the support points of the object feel, each where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.diagnosis.fitted import FittedPushes
from tactile_dynamics_ros.core.planar.effects.regional import (
    STEP,
    acts_for_a_while,
    is_regional,
    plain_name,
)
from tactile_dynamics_ros.core.planar.properties.latent_model import Sharpness

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
lacquered unevenly. What lies between is reported as either: log evidence differs by less than 4."""
_CLEAR = 10.0
"""Log evidence by which a field has to beat the best single effect on an even table: on tables
made for tuning whose friction varies by 5 % it was 19 and more, on those with a slope less than 0.
Lower makes effects seem variation, higher variation a slope."""
_SMOOTH = 2.0
"""Log odds before the data against a field that is smooth over 100 mm: grain and wear are on all
tables, one in eight was wiped or lacquered unevenly. At 0 one of five hidden slopes is taken for
such a field."""
_STEEP = 2.0
"""Log evidence by which a slope must beat every field to be more than what tables vary by: on
tables with fields of 5 % it was -1.0 at most on eight made for tuning, and above 0.5 on one of
eight others; with a slope besides above 2 on four of nine. Lower makes fields seem slopes."""
_ALIKE = 1.0
"""Log evidence within which the smaller field is reported: over a few of its lengths a smooth field
of 14 % makes the same as one of 7 %, and the larger would be said of the table."""
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
        imitating: standard deviation of a field that could do what a slope of the friction does
            here, also where no field is presumed; 0 where none could.
        unsure: standard deviation of what the field may be beyond that, as likely as it is beside
            the effects of the model.
        regional: what acts in a regime and is clearly likelier than all else; empty where nothing.
        suspects: of each effect in a regime the likeliest on an even table, likeliest first.
    """

    along: float
    field: float = 0.0
    length: float = _LENGTHS[0]
    imitating: float = 0.0
    unsure: float = 0.0
    regional: str = ""
    suspects: tuple[str, ...] = ()

    @property
    def is_rougher_than_tables(self) -> bool:
        """Whether the field is larger than on real tables: then it may be what acts there."""
        return self.field >= _FIELDS[-1]

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
            f"of {1e3 * self.length:.0f} mm."
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

    def beside(self, sizes: Array, wanted: slice) -> _Gram:
        """Wanted columns beside others of which a Gaussian amount is there anyway.

        Args:
            sizes: (c,) standard deviations of those amounts.
            wanted: columns that remain.
        """
        kept = np.flatnonzero(sizes)
        scale = sizes[kept, None]
        root = _root(scale * self.columns[np.ix_(kept, kept)] * scale.T)
        told = solve_triangular(root, scale[:, 0] * self.share[kept], lower=True)
        across = solve_triangular(root, scale * self.columns[kept, wanted], lower=True)
        return _Gram(
            self.columns[wanted, wanted] - across.T @ across,
            self.share[wanted] - across.T @ told,
            self.square - float(told @ told),
            self.log_volume + _log_volume(root),
        )

    def evidence(self, part: slice) -> float:
        """Log probability (up to a constant) of r ~ N(0, I + C C^T) for some of the columns.

        Source: Patterson, Thompson 1971 (restricted likelihood), with proper priors.
        """
        root = _root(self.columns[part, part])
        explained = solve_triangular(root, self.share[part], lower=True)
        left = self.square - float(explained @ explained)
        return -0.5 * left - self.log_volume - _log_volume(root)


def _root(gram: Array) -> Array:
    """Lower triangular root of I + G."""
    return np.asarray(np.linalg.cholesky(gram + np.eye(len(gram))))


def _log_volume(root: Array) -> float:
    """Half of ln det of what has such a triangular root."""
    return float(np.sum(np.log(np.diag(root))))


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
    groups = [*(rows for _, rows in effects), always, *((rows, none) for rows in fields)]
    ends = np.cumsum([0, *(rows.shape[2] for rows, _ in groups)])
    motion = np.concatenate([rows for rows, _ in groups], axis=2)
    poses = np.zeros((*always[1].shape[:2], motion.shape[2]))
    told = np.concatenate([rows for _, rows in groups[: len(effects) + 1]], axis=2)
    poses[:, :, : told.shape[2]] = told
    parts = [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    own, common = parts[: len(effects)], parts[len(effects) :]
    tried = [("", slice(0, 0)), *zip((name for name, _ in effects), own, strict=True)]
    prices = _prices([name for name, _ in tried])
    found: dict[tuple[str, Table], float] = {}
    for along in VARIATIONS:
        if most and along > most.along:
            continue
        residual, columns, volume = white(along, motion, poses)
        gram = _Gram(columns.T @ columns, columns.T @ residual, float(residual @ residual), volume)
        for table, sizes in _tables(along, common):
            odds = _SMOOTH * (table.length == max(_LENGTHS))
            left = gram.beside(sizes, slice(0, common[0].start))
            for name, part in tried:
                value = left.evidence(part) - odds - prices[name]
                found[name, table] = max(found.get((name, table), -np.inf), value)
    allowed = {key: v for key, v in found.items() if not most or key[1].field <= most.field}
    suspects = most.suspects if most else _suspects(found)
    chosen = replace(_chosen(allowed), suspects=suspects)
    if most and not chosen.field:
        chosen = replace(chosen, imitating=most.imitating, length=most.length)
    chosen = replace(chosen, unsure=_unsure(found, chosen))
    return replace(chosen, regional=most.regional) if most else chosen


def _prices(names: Sequence[str]) -> dict[str, float]:
    """Log odds against each hypothesis in a regime: one of as many regimes as are tried."""
    plain = [plain_name(name) for name in names if is_regional(name)]
    return {
        name: float(np.log(plain.count(plain_name(name)))) if is_regional(name) else 0.0
        for name in names
    }


def _tables(along: float, parts: Sequence[slice]) -> Iterator[tuple[Table, Array]]:
    """Each table, and the sizes of all columns on it without an effect."""
    sizes = np.zeros(parts[-1].stop)
    sizes[parts[0]] = 1.0
    yield Table(along), sizes
    for length, part in zip(_LENGTHS, parts[-len(_LENGTHS) :], strict=True):
        for field in _FIELDS:
            wide = sizes.copy()
            wide[part] = field
            yield Table(along, field, length), wide


def _chosen(found: dict[tuple[str, Table], float]) -> Table:
    """The likeliest table.

    Fields are on all tables and imitate a slope, which is an effect only if it clearly beats them.
    A field alone that is likelier than any other effect on an even table is presumed; beside an
    effect it must beat those clearly.
    """
    steep = {key: value for key, value in found.items() if _is_by_place(key[0])}
    even, uneven = (
        {k: v for k, v in found.items() if k not in steep and bool(k[1].field) == differs}
        for differs in (False, True)
    )
    name, table = max(even, key=even.__getitem__)
    if not uneven:
        return table
    least, most = max(even.values()), max(uneven.values())
    slopes = {key: value for key, value in steep.items() if not key[1].field}
    likeliest = max(steep, key=steep.__getitem__, default=("", table))
    lead = max(steep.values(), default=-np.inf) - max(least, most)
    if lead > _STEEP:
        table = likeliest[1] if lead > _CLEAR else max(slopes, key=slopes.__getitem__)[1]
    alone = {key: value for key, value in uneven.items() if not key[0]}
    enough = max(alone.values()) > max(least + (0.0 if name else _CHANCE), most - _CLEAR)
    if lead <= _STEEP and (enough or most > least + _CLEAR):
        likely = alone if enough else uneven
        best = max(likely.values())
        alike = [table for (_, table), value in likely.items() if value > best - _ALIKE]
        table = min(alike, key=lambda table: table.field)
        return replace(table, imitating=table.field, regional=_regional(found))
    told = max((v for (name, _), v in slopes.items() if name == SLOPE), default=-np.inf)
    _, field = max(alone, key=alone.__getitem__)
    imitates = lead < _CLEAR and uneven["", field] > told - _CHANCE
    found_length = table.length if table.field else field.length
    imitating = field.field if imitates else 0.0
    return replace(table, imitating=imitating, length=found_length, regional=_regional(found))


def _unsure(found: dict[tuple[str, Table], float], chosen: Table) -> float:
    """Root of the mean square of all fields of that length by their chances, beyond the chosen."""
    tables = {
        table: value
        for (name, table), value in found.items()
        if not name and (not table.field or table.length == chosen.length)
    }
    value = np.array([*tables.values()])
    weight = np.exp(value - value.max())
    mean = float(weight @ np.square([table.field for table in tables]) / weight.sum())
    return float(np.sqrt(max(mean - chosen.field**2, 0.0)))


def _is_by_place(name: str) -> bool:
    """Whether an effect is friction that differs by place, as a field does."""
    return name == SLOPE or (plain_name(name) == STEP and is_regional(name))


def _regional(found: dict[tuple[str, Table], float]) -> str:
    """What acts in a regime and is clearly likelier than all that acts everywhere; or nothing."""
    best = max(found, key=found.__getitem__)[0]
    if not is_regional(best):
        return ""
    everywhere = max(v for (name, _), v in found.items() if not is_regional(name))
    return best if max(found.values()) > everywhere + _CLEAR else ""


def _suspects(found: dict[tuple[str, Table], float]) -> tuple[str, ...]:
    """Of each effect, on a part of the table or for a while, the likeliest on an even table."""
    even = {key: v for key, v in found.items() if is_regional(key[0]) and not key[1].field}
    ranked = sorted(even, key=even.__getitem__, reverse=True)
    kinds = {(plain_name(name), acts_for_a_while(name)): name for name, _ in reversed(ranked)}
    return tuple(dict.fromkeys(name for name, _ in ranked if name in kinds.values()))


def hidden_slope(columns: Array, basis: Array, residual: Array) -> float:
    """Largest slope that data leave possible (two standard deviations), over its std beforehand.

    Args:
        columns: (M, 2) white, per standard deviation beforehand.
        basis: (M, p) orthonormal, of all else that may differ.
        residual: (M,) white, of a fit with that.
    """
    left = columns - basis @ (basis.T @ columns)
    covariance = np.linalg.inv(left.T @ left + np.eye(2))
    told = np.abs(covariance @ (left.T @ residual))
    return float(np.max(told + 2.0 * np.sqrt(np.diag(covariance))))
