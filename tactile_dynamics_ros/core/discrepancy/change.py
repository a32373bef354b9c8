"""Something that begins or ends at one time: known effects before or after it only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Family, ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import FEIGNED, Score, orthonormal
from tactile_dynamics_ros.core.discrepancy.structure import Index, window_rows, window_starts

_WINDOW = 0.5
"""Distance of the times that are tried, s, and what is left out to either side of each. Of 16
examples one has a change: half as long finds the same, with 1 s it is missed."""
_MARGIN = 0.1
"""Share of the recording at either end where no change is sought: few windows there fit anything.
Also the least length of a recording: forty windows, 20 s. With 0.05 and 0.2 the change of the
example was not reported."""
_MOST_COLUMNS = 6
"""Columns of families that are tried: a bias of two sensors, a force at a point. More would fit
half of a recording whatever happens there. 3 and 12 changed nothing in 16 examples."""
_MOST = 0.5
"""Share of the excess error that a change must explain to be reported: more than all else together.
At 0.25 nothing changed in 16 examples, at 1 nothing is ever reported."""
_CLEARLY = 20.0
"""Difference of -2 log evidence to the best effect that always acts: odds of e^10. The search over
times, sides and readings is paid for besides. 10 and 40 changed nothing in 16 examples."""


@dataclass(frozen=True)
class Change:
    """An effect that acts before or after one time only.

    Attributes:
        label: the effect that it looks like, with its reading.
        time: s, known to about half a second.
        ends: whether it acts before that time rather than after it.
        share: of the excess error that it explains.
        criterion: -2 log evidence beyond that of the rival that it was held against.
    """

    label: str
    time: float
    ends: bool
    share: float
    criterion: float

    def to_json(self) -> dict[str, Any]:
        """Part of `unexplained` in the document of `diagnose`."""
        return {"effect": self.label, "time": self.time, "ends": self.ends}


def find_change(
    bare: ResidualModel, rival: Array, price: float, floor: float = 1.0
) -> Change | None:
    """The change at one time with the best evidence.

    A family U that acts from one time on is [Q, 1(t > t_c) U], with Q what the model can explain.
    Windows of 0.5 s beside the time count for nobody, so that it need not be known better.

    Args:
        bare: fitted, without the effects of the rival.
        rival: (M,) residual at the same whitening that the change is held against.
        price: of the parameters of the rival, in units of -2 log evidence.
        floor: white RMS of the noise alone.
    """
    families = [f for f in bare.families() if len(f.kept) <= _MOST_COLUMNS]
    starts = window_starts(bare.time, _WINDOW)
    if len(starts) < 4.0 / _MARGIN or not families:
        return None
    sums = _Sums.of(bare, rival, starts)
    found = [change for family in families for change in sums.changes(family, floor, price)]
    return min(found, key=lambda change: change.criterion)


@dataclass
class _Sums:
    """Sums over windows, and over all but the two beside each time between windows.

    Attributes:
        basis: (M, p) Q, orthonormal. residual: (M,) r. windows: rows of each.
        time: (K,) between windows. inverse: (K, p, p) of Q^T Q. shares: (K, p) Q^T r.
        left: (K,) square of r beside Q. rival: (K,) square of the rival's residual.
        known: projections of columns by their array.
    """

    basis: Array
    residual: Array
    windows: list[slice]
    time: Array
    inverse: Array
    shares: Array
    left: Array
    rival: Array
    known: dict[int, tuple[Array, Array, Array]]

    @classmethod
    def of(cls, bare: ResidualModel, rival: Array, starts: Index) -> _Sums:
        basis, residual = orthonormal(bare.jacobian), bare.residual
        windows = window_rows(starts, len(residual))
        grams = _beside(np.stack([basis[rows].T @ basis[rows] for rows in windows]))
        shares = _beside(np.add.reduceat(basis * residual[:, None], starts, axis=0))
        square = _beside(np.add.reduceat(residual**2, starts))
        inverse = np.asarray(np.linalg.inv(grams), dtype=np.float64)
        explained = np.einsum("ki,kij,kj->k", shares, inverse, shares)
        others = _beside(np.add.reduceat(rival**2, starts))
        time, left = bare.time[starts][1:], square - explained
        return cls(basis, residual, windows, time, inverse, shares, left, others, {})

    def changes(self, family: Family, floor: float, price: float) -> list[Change]:
        """The best time at which a family begins, and at which it ends."""
        if id(family.columns) not in self.known:
            self.known[id(family.columns)] = self._project(family.columns)
        grams, crosses, shares = self.known[id(family.columns)]
        kept = list(family.kept)
        grams, crosses, shares = grams[:, kept][..., kept], crosses[:, kept], shares[:, kept]
        rows = len(self.residual)
        found = []
        for ends in (False, True):
            gain, freedom = self._gain(*(_side(part, ends) for part in (grams, crosses, shares)))
            left = self.left - gain
            searched = 2.0 * np.log(2.0 * len(self.time) * family.choices)
            beyond = (left - self.rival) / floor**2 + freedom * np.log(rows) + searched - price
            margin = int(_MARGIN * len(beyond))
            best = margin + int(np.argmin(beyond[margin : len(beyond) - margin]))
            noise = floor**2 * rows * (1.0 - 2.0 / len(self.windows))
            share = float(gain[best] / max(self.left[best] - noise, 1e-12))
            when, criterion = float(self.time[best]), float(beyond[best])
            found.append(Change(family.label, when, ends, min(share, 1.0), criterion))
        return found

    def _project(self, columns: Array) -> tuple[Array, Array, Array]:
        """U^T U (W, m, m), U^T Q (W, m, p) and U^T r (W, m), columns of unit length."""
        length = np.linalg.norm(columns, axis=0)
        unit = columns / np.where(length > 0.0, length, 1.0)
        parts = [(unit[w], self.basis[w], self.residual[w]) for w in self.windows]
        grams = np.stack([u.T @ u for u, _, _ in parts])
        crosses = np.stack([u.T @ q for u, q, _ in parts])
        return grams, crosses, np.stack([u.T @ r for u, _, r in parts])

    def _gain(self, grams: Array, crosses: Array, shares: Array) -> tuple[Array, Array]:
        """Fall of the squared residual at each time, and rank of the columns beside the model."""
        weighted = crosses @ self.inverse
        values, vectors = np.linalg.eigh(grams - weighted @ np.swapaxes(crosses, 1, 2))
        beside = shares - (weighted @ self.shares[..., None])[..., 0]
        sound = values > FEIGNED * np.trace(grams, axis1=1, axis2=2)[:, None]
        along = (np.swapaxes(vectors, 1, 2) @ beside[..., None])[..., 0]
        gain = np.where(sound, along**2 / np.where(sound, values, 1.0), 0.0)
        return gain.sum(axis=1), sound.sum(axis=1)


def _beside(windows: Array) -> Array:
    """Sums over all windows but the two beside each time between them."""
    return np.asarray(windows.sum(axis=0) - windows[:-1] - windows[1:])


def _side(windows: Array, ends: bool) -> Array:
    """Sums over the windows after each time, or before it, but the two beside it."""
    if ends:
        before = np.cumsum(windows, axis=0)
        return np.concatenate([np.zeros_like(before[:1]), before[:-2]])
    after = np.cumsum(windows[::-1], axis=0)[::-1]
    return np.concatenate([after[2:], np.zeros_like(after[:1])])


def clear_change(model: ResidualModel, scores: Sequence[Score], floor: float) -> Change | None:
    """A change that explains at least half of the excess error, and more than any effect could.

    Args:
        model: fitted.
        scores: of every effect.
        floor: white RMS of the noise alone.
    """
    if not scores:
        return None
    best = min(scores, key=lambda score: score.criterion)
    columns = best.family.columns[:, list(best.family.kept)]
    basis = orthonormal(np.concatenate([model.jacobian, columns], axis=1))
    rival = model.residual - basis @ (basis.T @ model.residual)
    price = best.freedom * np.log(len(rival)) + 2.0 * np.log(best.family.choices)
    change = find_change(model, rival, float(price), floor)
    if change is None or change.criterion > -_CLEARLY or change.share < _MOST:
        return None
    return change
