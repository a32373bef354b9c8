"""Causal whitening of residuals whose noise is correlated over a few samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import lapack

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.banded import BLOCK, VARIANCE_FLOOR


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


class StreamWhitener:
    """Forward substitution with the banded Cholesky factor of the residual's covariance.

    C = L L^T has block bandwidth b (windows of b + 1 poses overlap); the newest block row of L
    needs only the last b rows, so that memory and cost per sample are constant:
    L_k,k-b..k-1 = C_k,k-b..k-1 L_sub^-T, L_kk = chol(C_kk - sum L_kl L_kl^T).
    """

    def __init__(self, bandwidth: int, columns: int) -> None:
        """Start without memory.

        Args:
            bandwidth: b, block rows back to which the noise is correlated.
            columns: number of columns to whiten beside the residual.
        """
        self._band = bandwidth * BLOCK
        self._columns = columns + 1
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next residual shares no noise with earlier ones."""
        size = self._band
        self._noise = np.zeros((size, size + BLOCK))
        self._factor = np.eye(size)
        self._white = np.zeros((size, self._columns))

    def predict(
        self, pose_noise: Array, contact_covariance: Array, values: Array
    ) -> tuple[Array, Array]:
        """Whiten one block row, without making it part of the memory yet.

        Args:
            pose_noise: (6, 6 (b + 1)) response to the poses of the sample's window.
            contact_covariance: (6, 6) covariance of the noise of this sample alone.
            values: (6, m) columns, the residual last.

        Returns:
            The whitened columns (6, m) and L_k (6, 6 b + 6), its last block lower triangular.

        Raises:
            numpy.linalg.LinAlgError: the covariance is not positive definite.
        """
        past = pose_noise @ self._noise.T
        row, _ = lapack.dtrtrs(self._factor, past.T, lower=1)
        own = pose_noise @ pose_noise.T + contact_covariance - row.T @ row
        own.flat[:: BLOCK + 1] += VARIANCE_FLOOR
        diagonal, info = lapack.dpotrf(own, lower=1, clean=1)
        if info != 0:
            raise np.linalg.LinAlgError("covariance of a residual is not positive definite")
        white, _ = lapack.dtrtrs(diagonal, values - row.T @ self._white, lower=1)
        return white, np.concatenate([row.T, diagonal], axis=1)

    def commit(self, pose_noise: Array, factor_row: Array, white: Array) -> None:
        """Make a block row part of the memory, its whitened columns as they shall be remembered."""
        self._shift()
        tail = slice(self._band - BLOCK, None)
        self._noise[tail, : self._band] = pose_noise[:, BLOCK:]
        self._factor[tail] = factor_row[:, BLOCK:]
        self._white[tail] = white

    def skip(self) -> None:
        """Move on by one sample that gives no residual."""
        self._shift()
        tail = slice(self._band - BLOCK, None)
        self._noise[tail] = 0.0
        self._factor[tail] = 0.0
        self._factor[tail, tail] = np.eye(BLOCK)
        self._white[tail] = 0.0

    def _shift(self) -> None:
        self._noise[:-BLOCK, :-BLOCK] = self._noise[BLOCK:, BLOCK:].copy()
        self._factor[:-BLOCK, :-BLOCK] = self._factor[BLOCK:, BLOCK:].copy()
        self._white[:-BLOCK] = self._white[BLOCK:].copy()


class DelayedSubstitution:
    """Forward substitution for columns that become known later, with rows of L that were kept.

    Rows may have more columns than those before, which then had zeros in them.
    """

    def __init__(self, bandwidth: int, columns: int) -> None:
        """Start without memory; see `StreamWhitener`."""
        self._white = np.zeros((bandwidth * BLOCK, columns))

    def whiten(self, factor_row: Array, values: Array) -> Array:
        """Whiten the next block row, (6, m), without remembering it."""
        missing = values.shape[1] - self._white.shape[1]
        if missing > 0:
            self._white = np.pad(self._white, ((0, 0), (0, missing)))
        known = values - factor_row[:, :-BLOCK] @ self._white[:, : values.shape[1]]
        white, _ = lapack.dtrtrs(factor_row[:, -BLOCK:], known, lower=1)
        return np.asarray(white)

    def remember(self, white: Array) -> None:
        """Make whitened columns (6, m) part of the memory, the rest of them zero."""
        self._white[:-BLOCK] = self._white[BLOCK:].copy()
        self._white[-BLOCK:] = 0.0
        self._white[-BLOCK:, : white.shape[1]] = white
