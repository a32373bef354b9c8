"""Joint positions of the last moments, read at any time in between."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class JointHistory:
    """Interpolates joint positions between messages.

    Args:
        length: number of messages kept.
    """

    def __init__(self, length: int = 100) -> None:
        self._samples: deque[tuple[float, Array]] = deque(maxlen=length)

    @property
    def newest(self) -> float:
        """Time of the newest positions, s; minus infinity if there are none."""
        return self._samples[-1][0] if self._samples else -np.inf

    def add(self, time: float, positions: Array) -> None:
        """Keep positions at a time that is later than all before."""
        self._samples.append((time, positions))

    def clear(self) -> None:
        """Forget everything."""
        self._samples.clear()

    def at(self, time: float) -> Array | None:
        """Return positions at `time`, interpolated linearly; None outside what is kept."""
        if not self._samples or not self._samples[0][0] <= time <= self.newest:
            return None
        later = self._samples[-1]
        for earlier in reversed(self._samples):
            if earlier[0] <= time:
                break
            later = earlier
        span = later[0] - earlier[0]
        if span <= 0.0:
            return earlier[1]
        share = (time - earlier[0]) / span
        return np.asarray(earlier[1] + share * (later[1] - earlier[1]))
