"""Sums of a fitted model over short cells of time, from which any gate is fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    Family,
    ResidualModel,
    instants,
)
from tactile_dynamics_ros.core.discrepancy.screening import FEIGNED, orthonormal
from tactile_dynamics_ros.core.discrepancy.structure import window_rows, window_starts
from tactile_dynamics_ros.core.numerics.regime import Gate

_CELL = 0.1
"""Length of a cell, s: motion of 2 Hz turns by a fifth of a swing in it, so that a condition has
one value; white rows mix neighbours over the same time. Twice as long blurs places, half as long
costs twice the sums."""
_MOST_CELLS = 600
"""Cells of a long recording at most: a minute of the above. More cost time in proportion."""


@dataclass(frozen=True)
class Columns:
    """Sums of one array of columns U, scaled to unit length, over W cells.

    Attributes:
        scale: (m,) lengths of the columns.
        own: (W, m, m) U^T U. cross: (W, m, p) U^T Q. share: (W, m) U^T r.
    """

    scale: Array
    own: Array
    cross: Array
    share: Array


@dataclass(frozen=True)
class Fits:
    """Fits of one family behind G gates to some of the cells.

    Attributes:
        gain: (G,) fall of the squared residual.
        by_family: (G, m) coefficients of the scaled columns.
        by_model: (G, p) coefficients of Q.
    """

    gain: Array
    by_family: Array
    by_model: Array


@dataclass
class CellSums:
    """Sums of a model over W cells.

    Attributes:
        basis: (M, p) Q, orthonormal columns of what the model can explain.
        residual: (M,) r.
        rows: rows of each cell.
        time: (W,) s, when each cell begins. instants: (N,) s.
        own: (W, p, p) Q^T Q. share: (W, p) Q^T r. square: (W,) r^T r.
        known: sums of columns by their array.
    """

    basis: Array
    residual: Array
    rows: list[slice]
    time: Array
    instants: Array
    own: Array
    share: Array
    square: Array
    known: dict[int, Columns] = field(default_factory=dict)

    @classmethod
    def of(cls, model: ResidualModel) -> CellSums:
        """Sums of a fitted model."""
        basis, residual = orthonormal(model.jacobian), model.residual
        span = float(model.time[-1] - model.time[0])
        starts = window_starts(model.time, max(_CELL, span / _MOST_CELLS))
        rows = window_rows(starts, len(residual))
        own = np.stack([basis[r].T @ basis[r] for r in rows])
        share = np.add.reduceat(basis * residual[:, None], starts, axis=0)
        square = np.add.reduceat(residual**2, starts)
        return cls(
            basis, residual, rows, model.time[starts], instants(model)[0], own, share, square
        )

    def columns(self, family: Family) -> Columns:
        """Sums of the columns that belong to a family."""
        key = id(family.columns)
        if key not in self.known:
            length = np.linalg.norm(family.columns, axis=0)
            unit = family.columns / np.where(length > 0.0, length, 1.0)
            parts = [(unit[r], self.basis[r], self.residual[r]) for r in self.rows]
            self.known[key] = Columns(
                length,
                np.stack([u.T @ u for u, _, _ in parts]),
                np.stack([u.T @ q for u, q, _ in parts]),
                np.stack([u.T @ r for u, _, r in parts]),
            )
        found, kept = self.known[key], list(family.kept)
        return Columns(
            found.scale[kept],
            found.own[:, kept][..., kept],
            found.cross[:, kept],
            found.share[:, kept],
        )

    def fit(self, columns: Columns, inside: Array, used: Array) -> Fits:
        """Fit [Q, gate U] to some of the cells, for many gates at once.

        Args:
            columns: U.
            inside: (G, W) gates.
            used: (W,) 1 for cells to fit, else 0.
        """
        count, size = columns.share.shape
        weight = inside * used
        own = (weight @ columns.own.reshape(count, -1)).reshape(-1, size, size)
        cross = (weight @ columns.cross.reshape(count, -1)).reshape(len(weight), size, -1)
        share = weight @ columns.share
        base = np.tensordot(used, self.own, 1)
        inverse = np.linalg.inv(base + FEIGNED * np.eye(len(base)))
        start = inverse @ (used @ self.share)
        weighted = cross @ inverse
        beside = own - weighted @ np.swapaxes(cross, 1, 2)
        left = share - cross @ start
        ridge = FEIGNED * np.maximum(np.trace(own, axis1=1, axis2=2), 1e-300)
        beside = beside + ridge[:, None, None] * np.eye(size)
        by_family = np.linalg.solve(beside, left[..., None])[..., 0]
        by_model = start - (np.swapaxes(weighted, 1, 2) @ by_family[..., None])[..., 0]
        return Fits(np.sum(left * by_family, axis=1), by_family, by_model)

    def losses(self, columns: Columns, inside: Array, fits: Fits) -> Array:
        """Squared residuals (W,) of every cell under the fit of one gate (W,)."""
        q, c = fits.by_model[0], fits.by_family[0]
        plain = self.square - 2.0 * self.share @ q + np.einsum("i,wij,j->w", q, self.own, q)
        added = np.einsum("i,wij,j->w", c, columns.own, c) - 2.0 * columns.share @ c
        added = added + 2.0 * np.einsum("i,wij,j->w", c, columns.cross, q)
        return np.asarray(plain + inside * added)


_SHARE = 0.05
"""Distance of the thresholds that are tried, as a share of the recording: what lies between is
found afterwards sample by sample. Half as far doubles the work, twice as far misses regimes of less
than a fifth of the recording."""
_LEAST = 0.1
"""Least share of the recording in a regime and outside of it: few cells fit anything. Lower finds
shorter regimes and more that are none."""
_CLOCK = "t"
"""Symbol of the condition of which intervals are tried from the start, since what is hung on is
also taken off. Intervals of the others are found from a threshold, sample by sample."""


@dataclass(frozen=True)
class Gates:
    """Gates with the cells that lie inside.

    Attributes:
        gates: G of them.
        inside: (G, W) 1 for cells inside, else 0.
        of_condition: index of the condition of each gate.
        starts: (G,) whether a gate is open from a time on, as for what changes at that time.
    """

    gates: tuple[Gate, ...]
    inside: Array
    of_condition: NDArray[np.int64]
    starts: NDArray[np.bool_]

    def tried(self, family: Family) -> NDArray[np.bool_]:
        """(G,) gates that a family is tried behind: an event begins at a time and does not end."""
        return self.starts if family.event else np.ones(len(self.gates), dtype=bool)

    def count(self, family: Family) -> int:
        """Number of gates that a family is tried behind."""
        return int(np.sum(self.tried(family)))


def gates_to_try(model: ResidualModel, conditions: Sequence[Condition], sums: CellSums) -> Gates:
    """Thresholds at every twentieth of each condition that has a symbol, and intervals of time.

    Args:
        model: fitted.
        conditions: with one value for each instant.
        sums: of the model, over cells.
    """
    channels = len(model.residual) // len(conditions[0].values)
    cells = [slice(r.start // channels, r.stop // channels) for r in sums.rows]
    gates: list[Gate] = []
    inside: list[NDArray[np.bool_]] = []
    owner: list[int] = []
    for index, condition in enumerate(conditions):
        if not condition.symbol:
            continue
        means = np.array([condition.values[cell].mean() for cell in cells])
        for gate in _gates_of(condition.symbol, means):
            held = gate.inside(means)
            if _LEAST <= held.mean() <= 1.0 - _LEAST:
                gates.append(gate)
                inside.append(held)
                owner.append(index)
    shape = (len(gates), len(cells))
    starts = np.array([gate.symbol == _CLOCK and math.isinf(gate.high) for gate in gates])
    within = np.reshape(inside, shape).astype(float)
    return Gates(tuple(gates), within, np.array(owner, dtype=int), starts)


def _gates_of(symbol: str, means: Array) -> list[Gate]:
    shares = np.arange(_LEAST, 1.0 - _LEAST + 1e-9, _SHARE)
    edges = np.unique(np.quantile(means, shares)).tolist()
    found = [Gate(symbol, high=edge) for edge in edges] + [Gate(symbol, low=e) for e in edges]
    if symbol == _CLOCK:
        ends = [-math.inf, *np.quantile(means, [_SHARE]).tolist(), *edges]
        found += [Gate(symbol, a, b) for k, a in enumerate(ends[1:]) for b in edges[k + 1 :]]
    return found
