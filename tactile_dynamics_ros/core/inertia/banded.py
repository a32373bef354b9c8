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
        size = sensitivities[0].shape[0]
        products = [matrix @ matrix.T.tobsr(blocksize=(3, _BLOCK)) for matrix in sensitivities]
        band = _sum_bands([product.tobsr(blocksize=(_BLOCK, _BLOCK)) for product in products], size)
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


def _sum_bands(products: list[bsr_array], size: int) -> Array:
    """Lower band storage of the sum of block-sparse symmetric matrices.

    Block (row, column) goes to [column, j, 6 (row - column) + i], the columns of the band with
    their diagonal at j, which are shifted to the top at the end.
    """
    count = size // _BLOCK
    rows = [np.repeat(np.arange(count), np.diff(p.indptr)) for p in products]
    lags = [row - product.indices for row, product in zip(rows, products, strict=True)]
    reach = 1 + max(int(lag.max()) for lag in lags)
    blocks = np.zeros((count, reach, _BLOCK, _BLOCK))
    for product, lag in zip(products, lags, strict=True):
        below = lag >= 0
        blocks[product.indices[below], lag[below]] += product.data[below]
    columns = blocks.transpose(0, 3, 1, 2).reshape(count, _BLOCK, _BLOCK * reach)
    band = np.zeros((_BLOCK * reach, count, _BLOCK))
    for j in range(_BLOCK):
        band[: _BLOCK * reach - j, :, j] = columns[:, j, j:].T
    return band.reshape(_BLOCK * reach, size)
