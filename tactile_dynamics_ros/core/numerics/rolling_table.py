"""A bounded table of rows whose recent part is always one contiguous slice."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RollingTable:
    """Columns of the last `capacity` rows, addressed by the row's running number."""

    def __init__(self, capacity: int, columns: dict[str, tuple[int, ...]]) -> None:
        """Reserve twice the capacity, so that rows move only once per `capacity` appends."""
        self._capacity = capacity
        self._columns = {name: np.zeros((2 * capacity, *shape)) for name, shape in columns.items()}
        self._base = 0
        self._end = 0

    @property
    def end(self) -> int:
        """Running number after the newest row."""
        return self._base + self._end

    @property
    def start(self) -> int:
        """Running number of the oldest row kept."""
        return max(self._base, self.end - self._capacity)

    def append(self, row: dict[str, Any]) -> None:
        """Add one row; every column must be given."""
        if self._end == 2 * self._capacity:
            self._move()
        for name, column in self._columns.items():
            column[self._end] = row[name]
        self._end += 1

    def rows(self, name: str, first: int, last: int) -> Array:
        """View of one column for the running numbers first <= k < last."""
        return self._columns[name][first - self._base : last - self._base]

    def clear(self) -> None:
        """Forget all rows; running numbers go on."""
        self._base, self._end = self.end, 0

    def _move(self) -> None:
        half = self._capacity
        for column in self._columns.values():
            column[:half] = column[half:]
        self._base += half
        self._end = half


def sliding_rows(rows: Array, width: int) -> Array:
    """View (N - width + 1, width, ...) of all stretches of `width` successive rows (N, ...)."""
    if len(rows) == width:
        return rows[None]
    shape = (len(rows) - width + 1, width, *rows.shape[1:])
    return as_strided(rows, shape, (rows.strides[0], *rows.strides), writeable=False)
