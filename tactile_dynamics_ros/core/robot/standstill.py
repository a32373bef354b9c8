"""Since when a robot stands still, from its joint positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STILL = 0.005
"""Joint motion, rad (m where joints slide), up to which a robot stands still: 4 mm of a fingertip
0.8 m from the joint, a third of the motion of the object that ends a probe. Less takes noise and
the settling of drives for motion, more takes a slow motion for rest."""


class Standstill:
    """Follows joint positions, and says since when none has moved by more than 0.005 rad.

    Attributes:
        since: s, stamp since which the robot stands still; infinity before the first positions.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Know nothing."""
        self._place: Array | None = None
        self.since = np.inf

    def update(self, time: float, positions: Array) -> None:
        """Take positions (J,) at a time, s, not decreasing."""
        if self._place is None or np.max(np.abs(positions - self._place)) > _STILL:
            self._place, self.since = np.array(positions), time
