"""Whitening by the Cholesky factor of a banded covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack
from scipy.sparse import bsr_array

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError

BLOCK = 6
"""Numbers of one sample: the six of a wrench residual, torque and force. With another number blocks
of the covariance would mix samples."""
VARIANCE_FLOOR = 1e-14
"""Variance added to each residual, N^2 and (N m)^2: 0.1 uN. Data without any noise (generated ones)
keep a covariance that is positive definite; those of sensors have at least 1e-8, so that it widens
nothing. Below 1e-16 of the squares of loads it would be lost in rounding."""
_SAFEGUARDS = (0.0, 1e-9, 1e-6)
"""Shares by which the diagonal of a covariance is raised, tried in turn until it has a Cholesky
factor: none first, so that covariances that rounding leaves positive definite are taken exactly.
1e-6 widens a residual's deviation by half a millionth; if that is not enough the noise is
inconsistent and the error says so. Larger ones widen what is stated; fewer refuse covariances that
rounding has spoilt."""


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
        signals = _Windows.of(sensitivities)
        for share in _SAFEGUARDS:
            band = _band_of_products(signals)
            band[0] = (1.0 + share) * (band[0] + extra_variance)
            factor, info = lapack.dpbtrf(band, lower=1, overwrite_ab=1)
            if info == 0:
                return cls(factor)
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

    def colour(self, white: Array) -> Array:
        """L white, (6 N,) -> the same shape."""
        return np.asarray(blas.dtbmv(len(self.band) - 1, self.band, white, lower=1))

    def _solve(self, values: Array, transpose: str) -> Array:
        columns = values.reshape(len(values), -1)
        solution, _ = lapack.dtbtrs(self.band, columns, uplo="L", trans=transpose)
        return np.asarray(solution).reshape(values.shape)


@dataclass(frozen=True)
class _Windows:
    """A matrix whose N block rows read windows of as many samples, which never go back.

    Attributes:
        start: (N,) first sample of each window.
        width: samples W of a window.
        rows: (N, 6, W c), c numbers of each sample.
    """

    start: NDArray[np.intp]
    width: int
    rows: Array

    @classmethod
    def of(cls, matrices: Sequence[bsr_array]) -> list[_Windows]:
        """Matrices that read the same windows are one matrix."""
        alike: dict[tuple[int, bytes], list[bsr_array]] = {}
        for matrix in matrices:
            width = int(matrix.indptr[1])
            alike.setdefault((width, matrix.indices[::width].tobytes()), []).append(matrix)
        return [cls._joined(width, group) for (width, _), group in alike.items()]

    @classmethod
    def _joined(cls, width: int, matrices: Sequence[bsr_array]) -> _Windows:
        start = matrices[0].indices[::width].astype(np.intp)
        rows = np.empty((len(start), BLOCK, width, 3 * len(matrices)))
        for k, matrix in enumerate(matrices):
            blocks = matrix.data.reshape(len(start), width, BLOCK, 3)
            rows[..., 3 * k : 3 * k + 3] = blocks.swapaxes(1, 2)
        return cls(start, width, rows.reshape(len(start), BLOCK, -1))

    @property
    def reach(self) -> int:
        """Rows ahead that share samples with a row, at most."""
        after = np.searchsorted(self.start, self.start + self.width)
        return int(np.max(after - np.arange(len(after)))) - 1

    def add_products(self, blocks: Array, lag: int) -> None:
        """Add row k times row (k + lag) transposed to `blocks` (N - lag, 6, 6)."""
        shift = self.start[lag:] - self.start[: len(self.start) - lag]
        numbers = self.rows.shape[2] // self.width
        for common in np.unique(shift[shift < self.width]):
            first = _as_slice(np.flatnonzero(shift == common))
            overlap = numbers * (self.width - int(common))
            before, after = self.rows[first], self.rows[lag:][first]
            blocks[first] += before[..., -overlap:] @ after[..., :overlap].swapaxes(1, 2)


def _as_slice(index: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """Rows as a slice, which costs no copy, where they follow each other."""
    first, end = int(index[0]), int(index[-1]) + 1
    return slice(first, end) if end - first == len(index) else index


def _band_of_products(signals: list[_Windows]) -> Array:
    """Lower band storage of sum A A^T.

    Column 6 k + j of a block column holds its blocks from the diagonal down; in the band it begins
    with the diagonal entry, j further down.
    """
    count = len(signals[0].start)
    reaches = [signal.reach for signal in signals]
    height = BLOCK * (1 + max(reaches))
    columns = np.zeros((count, BLOCK, height))
    for signal, reach in zip(signals, reaches, strict=True):
        for lag in range(reach + 1):
            below = slice(BLOCK * lag, BLOCK * (lag + 1))
            signal.add_products(columns[: count - lag, :, below], lag)
    for j in range(1, BLOCK):
        columns[:, j, :-j], columns[:, j, -j:] = columns[:, j, j:], 0.0
    return columns.reshape(count * BLOCK, height).T
