"""Whitening by the Cholesky factor of a banded covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.sparse import bsr_array

from tactile_dynamics_ros.core.errors import NotIdentifiableError

Array = NDArray[np.float64]

_BLOCK = 6
_SAFEGUARDS = (0.0, 1e-9, 1e-6)


@dataclass(frozen=True)
class BandedWhitener:
    """Lower Cholesky factor L of C = L L^T in LAPACK band storage."""

    band: Array

    @classmethod
    def from_sensitivities(
        cls, sensitivities: list[bsr_array], extra_variance: Array
    ) -> BandedWhitener:
        """Factor C = sum_s A_s A_s^T + diag(extra_variance).

        Args:
            sensitivities: (6 N, 3 K) block-sparse matrices A.
            extra_variance: (6 N,) positive.

        Raises:
            NotIdentifiableError: C is not positive definite, even with small numbers added.
        """
        band = _sum_bands([_lags(matrix) for matrix in sensitivities])
        band[0] += extra_variance
        diagonal = band[0].copy()
        for share in _SAFEGUARDS:
            band[0] = (1.0 + share) * diagonal
            factor, info = lapack.dpbtrf(band, lower=1)
            if info == 0:
                return cls(np.asfortranarray(factor))
        raise NotIdentifiableError(
            "the noise of the recording cannot be whitened: stamps come in bursts, or poses or "
            f"forces repeat (row {info}); check the stamps of the streams"
        )

    def whiten(self, values: Array) -> Array:
        """L^-1 values, (6 N, ...) -> the same shape."""
        return self._solve(values, "N")

    def whiten_transposed(self, values: Array) -> Array:
        """L^-T values, (6 N, ...) -> the same shape."""
        return self._solve(values, "T")

    def _solve(self, values: Array, transpose: str) -> Array:
        columns = values.reshape(len(values), -1)
        solution, _ = lapack.dtbtrs(self.band, columns, uplo="L", trans=transpose)
        return np.asarray(solution).reshape(values.shape)


def _lags(matrix: bsr_array) -> list[Array]:
    """Blocks (N - d, 6, 6) of A A^T, rows k = d .. N - 1 with rows k - d, for d = 0, 1, ...

    Every row of A reads a window of as many samples, the windows never go back.
    """
    width = int(matrix.indptr[1])
    start = matrix.indices[::width]
    rows = matrix.data.reshape(len(start), width, _BLOCK, 3).transpose(0, 2, 1, 3)
    rows = rows.reshape(len(start), _BLOCK, 3 * width)
    found: list[Array] = []
    for lag in range(len(start)):
        shift = start[lag:] - start[: len(start) - lag]
        if not (shift < width).any():
            break
        blocks = np.zeros((len(shift), _BLOCK, _BLOCK))
        for common in np.unique(shift[shift < width]):
            later = _as_slice(np.flatnonzero(shift == common))
            overlap = 3 * (width - int(common))
            after, before = rows[lag:][later][..., :overlap], rows[later][..., -overlap:]
            blocks[later] = after @ before.swapaxes(1, 2)
        found.append(blocks)
    return found


def _as_slice(index: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """The same rows as a slice, which costs no copy, if they follow each other."""
    first, end = int(index[0]), int(index[-1]) + 1
    return slice(first, end) if end - first == len(index) else index


def _sum_bands(signals: list[list[Array]]) -> Array:
    """Lower band storage of the sum of block-banded matrices, each by its `_lags`.

    Entry (i, j) of the blocks at lag d lies on diagonal 6 d + i - j.
    """
    reach, count = max(map(len, signals)), len(signals[0][0])
    band = np.zeros((_BLOCK * reach, count, _BLOCK))
    for lag in range(reach):
        blocks = sum(lags[lag] for lags in signals if lag < len(lags))
        for i in range(_BLOCK):
            for j in range(_BLOCK if lag else i + 1):
                band[_BLOCK * lag + i - j, : count - lag, j] = blocks[:, i, j]
    return band.reshape(_BLOCK * reach, count * _BLOCK)
