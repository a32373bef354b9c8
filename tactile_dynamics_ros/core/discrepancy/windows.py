"""Windows and interleaved blocks along time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def window_index(time: Array, length: float) -> Index:
    """Number of the window of each row, counted from the first time."""
    return np.asarray((time - time[0]) // length, dtype=np.int64)


def window_starts(time: Array, length: float) -> Index:
    """First row of every window that is not empty."""
    index = window_index(time, length)
    return np.flatnonzero(np.concatenate([[True], np.diff(index) != 0])).astype(np.int64)


def window_rows(starts: Index, count: int) -> list[slice]:
    """Rows of every window, of `count` rows in all."""
    return [slice(*ends) for ends in pairwise([*starts.tolist(), count])]
