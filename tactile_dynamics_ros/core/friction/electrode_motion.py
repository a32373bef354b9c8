"""How much the electrodes of a fingertip change from frame to frame, over their noise at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES
from tactile_dynamics_ros.core.tactile.signal_change import check_frame

Array = NDArray[np.float64]

_SMOOTHING = 0.3
"""Share by which smoothed electrodes follow a frame: an average of about three frames, 30 ms at 100
Hz. More lets noise in (the excess at rest then scatters by more than 0.2), less delays an alarm."""


class ElectrodeMotion:
    """Excess of the electrodes' step between smoothed frames over its level at rest.

    x = (rms_e(s_t - s_{t-3}) / level at rest) - 1, with s the smoothed counts: 0 at rest with a
    scatter of about 0.2, larger where the skin moves.
    """

    def __init__(self) -> None:
        self._level = 3.0
        self._smooth: Array | None = None
        self._past: list[Array] = []

    def tare(self, raw: ArrayLike) -> None:
        """Take frames (K, 44) without contact as rest."""
        self._smooth, self._past = None, []
        steps = [self._step(frame) for frame in np.atleast_2d(check_frame(raw))]
        if len(steps) > 5:
            self._level = max(float(np.median(steps[5:])), 0.3)

    def update(self, raw: ArrayLike) -> float:
        """Return the excess for the next frame (44,)."""
        return self._step(check_frame(raw)) / self._level - 1.0

    def _step(self, counts: Array) -> float:
        electrodes = counts[ELECTRODES]
        last = electrodes if self._smooth is None else self._smooth
        self._smooth = last + _SMOOTHING * (electrodes - last)
        self._past = [*self._past[-3:], self._smooth]
        return float(np.sqrt(np.mean((self._past[-1] - self._past[0]) ** 2)))
