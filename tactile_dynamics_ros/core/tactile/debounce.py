"""A switch that ignores short interruptions, or an array of such switches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Debounced:
    """Switches that flip once their input has differed from them for some frames in a row.

    Args:
        frames: in a row that flip a switch; one number for all, or (...) of each.

    Attributes:
        on: (...) whether each is on.
        streak: (...) frames in a row in which the input has differed.
    """

    def __init__(self, frames: ArrayLike) -> None:
        self._frames = np.asarray(frames)
        self.reset()

    def reset(self) -> None:
        """Switch off and forget the past."""
        self.on: NDArray[np.bool_] = np.zeros(self._frames.shape, dtype=bool)
        self.streak: NDArray[np.int_] = np.zeros(self._frames.shape, dtype=int)

    def update(self, wanted: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each is on after a frame whose input is ``wanted`` (...)."""
        streak = np.where(wanted != self.on, self.streak + 1, 0)
        flips = streak >= self._frames
        self.on = self.on ^ flips
        self.streak = np.where(flips, 0, streak)
        return self.on
