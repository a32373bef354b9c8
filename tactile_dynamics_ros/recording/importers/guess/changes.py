"""When something changes at once in forces, whatever their axes and those of the pose are.

Each component of the force of a load on a sensor, however the sensor is mounted, the world lies and
the orientation is meant, is linear in the nine entries of the orientation, the accelerations in its
axes and those of turning. Where one such law does not explain before and after alike is a change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.recording.importers.guess.weight import Measured, Scene

Array = NDArray[np.float64]

_CLEARLY_LESS = 0.5
"""What two laws, before and after, leave at most of what one leaves, and one whose numbers drift
with time, RMS: a step of twice the noise. At 0.9 bends of a drift are taken for a change."""
_EDGE = 0.08
"""Share of a table at either end in which no change is looked for: 44 numbers need some rows."""
_COARSE = 10
"""Rows from one time that is tried to the next, before those between are; more may pass a short
stretch by, fewer cost time."""
_FEWEST = 300
"""Rows that a table needs: at 100 Hz some 3 s, over which a motion turns far enough."""


def find_change(measured: Measured) -> float | None:
    """Time, s, of the first row after a change of the forces; None without one, or if untold."""
    if measured.force_time is None or measured.time is None:
        return None
    scene = Scene(replace(measured, change=None))
    if len(scene.rows) < _FEWEST:
        return None
    time = measured.force_time[scene.rows]
    columns, force = _columns(scene), scene.force
    share = ((time - time[0]) / (time[-1] - time[0]))[:, None]
    whole = _left(columns, force)
    drifting = _left(np.hstack([columns, share * columns]), force)
    sums = _Sums.of(columns, force)
    first, last = int(_EDGE * len(time)), int((1.0 - _EDGE) * len(time))
    best = sums.best(np.arange(first, last, _COARSE))
    best = sums.best(np.arange(max(best - _COARSE, first), min(best + _COARSE, last) + 1))
    left = sums.left(np.array([best]))[0]
    if left > _CLEARLY_LESS**2 * min(whole, drifting):
        return None
    return float(time[best])


def _columns(scene: Scene) -> Array:
    """(n, 13 or 22) what each component of the force is linear in, of unit size."""
    parts = [np.ones((len(scene.rows), 1)), scene.rotation.reshape(-1, 9)]
    if scene.motion is not None:
        moved, rate, change = scene.motion
        parts += [moved, (skew(change) + skew(rate) @ skew(rate)).reshape(-1, 9)]
    columns = np.hstack(parts)
    size = np.sqrt(np.mean(columns**2, axis=0))
    return np.asarray(columns / np.where(size > 0.0, size, 1.0))


def _left(columns: Array, force: Array) -> float:
    """Sum of squares that a law leaves."""
    solution = np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.sum((force - columns @ solution) ** 2))


class _Sums:
    """Normal equations of all rows up to each."""

    def __init__(self, information: Array, aim: Array, squares: Array) -> None:
        self._information, self._aim, self._squares = information, aim, squares

    @classmethod
    def of(cls, columns: Array, force: Array) -> _Sums:
        """Sums over rows (n, k) and forces (n, 3)."""
        return cls(
            np.cumsum(columns[:, :, None] * columns[:, None, :], axis=0),
            np.cumsum(columns[:, :, None] * force[:, None, :], axis=0),
            np.cumsum(np.sum(force**2, axis=1)),
        )

    def best(self, rows: NDArray[np.int64]) -> int:
        """The row before which a change leaves least."""
        return int(rows[np.argmin(self.left(rows))])

    def left(self, rows: NDArray[np.int64]) -> Array:
        """Sums of squares (m,) that laws before and from each row leave."""
        before = (self._information[rows - 1], self._aim[rows - 1], self._squares[rows - 1])
        whole = (self._information[-1], self._aim[-1], self._squares[-1])
        after = tuple(a - b for a, b in zip(whole, before, strict=True))
        return _least(*before) + _least(*after)


def _least(information: Array, aim: Array, squares: Array) -> Array:
    """Sums of squares (m,) that the best numbers leave."""
    ridge = 1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None]
    solution = np.linalg.solve(information + ridge * np.eye(information.shape[1]), aim)
    return np.asarray(np.maximum(squares - np.sum(solution * aim, axis=(1, 2)), 0.0))
