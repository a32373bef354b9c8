"""Square-root information of a linear least-squares problem, and its honest inflation."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import lapack
from scipy.special import chdtri

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.residuals.systematic import (
    SYSTEMATIC_SIZE,
    PresumedErrors,
    with_gains,
)

_FEWEST_BLOCKS = 8
"""Blocks from which their scatter is compared with that of white noise: of eight the ratio of white
noise lies between 0.3 and 1.9 in nine of ten cases, and 2.5 is tolerated. Fewer tell nothing; more
leave misfit of the first seconds unseen."""
_CONFIDENCE = 0.99
"""Quantile of chi squared that the scatter must exceed to widen intervals: chance does in one of a
hundred. The batch estimator tolerates a fixed ratio (`uncertainty._TOLERATED_RATIO`). At 0.95 clean
data get wider intervals five times as often, by chance; at 0.999 correlated errors must be stronger
or last longer until they show."""


@lru_cache(maxsize=256)
def _tolerated_ratio(blocks: int) -> float:
    """Ratio of variances that white noise over so many blocks exceeds in one case of a hundred."""
    return float(chdtri(blocks, 1.0 - _CONFIDENCE) / blocks)


class SquareRootInformation:
    """|R x - d|^2 + const equals the sum of all squared whitened residuals so far.

    Exact whenever the residuals are linear in x; constant memory. Source: Bierman 1977, ch. 4.
    """

    def __init__(self, size: int) -> None:
        """Start without information on `size` unknowns."""
        self.size = size
        self._stack = np.zeros((size + 1, size + 1), order="F")
        self.rows = 0.0

    @property
    def factor(self) -> Array:
        """R, (n, n) upper triangular."""
        return self._stack[: self.size, : self.size]

    @property
    def target(self) -> Array:
        """d, (n,)."""
        return self._stack[: self.size, self.size]

    @property
    def squared_residual(self) -> float:
        """Sum of squares that no x explains."""
        return float(self._stack[self.size, self.size] ** 2)

    @property
    def whitened_rms(self) -> float:
        """RMS of the whitened residuals per degree of freedom; 1 at the noise floor."""
        freedom = self.rows - self.size
        return float(np.sqrt(self.squared_residual / freedom)) if freedom > 0 else 1.0

    def add(self, jacobian: Array, target: Array, count: float = 1.0) -> None:
        """Add rows |J x - t|^2, J (m, n), t (m,), each of which counts as so many."""
        rows = np.concatenate([jacobian, target[:, None]], axis=1)
        stacked = np.concatenate([self._stack, rows], axis=0)
        factored = lapack.dgeqrf(stacked)[0]
        self._stack = np.triu(factored[: self.size + 1])
        self.rows += count * len(target)


class BlockScores:
    """Sums over blocks of time of the normal equations, in bounded memory.

    A block's score g_b - H_b x at the estimate is the sum of its weighted whitened residuals. For
    white residuals its covariance is H_b; residuals that stay correlated make it larger. Blocks
    are merged in pairs when there are too many, so that correlation is seen at all time scales.
    """

    _LIMIT = 128

    def __init__(self, size: int, length: int) -> None:
        """Start empty; a block is `length` samples at first."""
        self._length = length
        self._hessians = np.zeros((self._LIMIT, size, size))
        self._gradients = np.zeros((self._LIMIT, size))
        self._filled = 0
        self._in_block = 0

    def add(self, jacobian: Array, target: Array) -> None:
        """Add one sample's whitened rows, J (6, n) and t (6,)."""
        if self._in_block == self._length:
            self._filled += 1
            self._in_block = 0
            if self._filled == self._LIMIT:
                self._merge()
        at = self._filled
        self._hessians[at] += jacobian.T @ jacobian
        self._gradients[at] += jacobian.T @ target
        self._in_block += 1

    def _merge(self) -> None:
        half = self._LIMIT // 2
        for table in (self._hessians, self._gradients):
            table[:half] = table[0::2] + table[1::2]
            table[half:] = 0.0
        self._filled = half
        self._length *= 2

    def inflation(self, state: Array, inverse: Array) -> Array:
        """Factors >= 1 by which variances grow because residuals are large or stay correlated.

        The influence of a block on the estimate is H^-1 (g_b - H_b x). The ratio of its variance
        over blocks to that of white residuals is taken at several block lengths; what white noise
        exceeds in one case of a hundred by chance is tolerated.

        Args:
            state: (n,) estimate x.
            inverse: (n, n) inverse of the total information, data and prior.

        Returns:
            (n,) factors for the variances of x.

        Source: Newey, West 1987, in block form.
        """
        count = self._filled
        hessians, gradients = self._hessians[:count], self._gradients[:count]
        factors = np.ones(len(state))
        if count < _FEWEST_BLOCKS:
            return factors
        influence = (gradients - hessians @ state) @ inverse
        expected = np.einsum("ij,jk,ki->i", inverse, hessians.sum(axis=0), inverse)
        while len(influence) >= _FEWEST_BLOCKS:
            ratio = np.sum(influence**2, axis=0) / np.maximum(expected, 1e-300)
            tolerated = _tolerated_ratio(len(influence))
            factors = np.where(ratio > tolerated, np.maximum(factors, ratio), factors)
            even = len(influence) // 2 * 2
            influence = influence[0:even:2] + influence[1:even:2]
        return factors


class LastingErrors:
    """Sums that tell how presumed lasting errors B would show and shift the estimate."""

    def __init__(self, size: int) -> None:
        """Start empty, for `size` parameters."""
        self._hessian = np.zeros((size, size))
        self._gradient = np.zeros(size)
        self._cross = np.zeros((size, SYSTEMATIC_SIZE))
        self._gram = np.zeros((SYSTEMATIC_SIZE, SYSTEMATIC_SIZE))
        self._target = np.zeros(SYSTEMATIC_SIZE)

    def add(self, jacobian: Array, target: Array, basis: Array) -> None:
        """Add one sample's white rows J (6, n), t (6,) and B (6, 9 + 12 C)."""
        missing = basis.shape[1] - len(self._target)
        if missing > 0:
            self._cross = np.pad(self._cross, ((0, 0), (0, missing)))
            self._gram = np.pad(self._gram, (0, missing))
            self._target = np.pad(self._target, (0, missing))
        self._hessian += jacobian.T @ jacobian
        self._gradient += jacobian.T @ target
        held = slice(basis.shape[1])
        self._cross[:, held] += jacobian.T @ basis
        self._gram[held, held] += basis.T @ basis
        self._target[held] += basis.T @ target

    def presume(
        self, state: Array, inverse: Array, mapping: Array, load: float, prior: Array | None
    ) -> PresumedErrors:
        """Find what lasting errors do to an estimate in other coordinates.

        Args:
            state: (n,) the estimate.
            inverse: (n, n) inverse of the information of data and prior on its coordinates.
            mapping: (n, n) derivative of the state by these.
            load: weight of the body, N.
            prior: (n, n) see `PresumedErrors.find`.
        """
        errors = with_gains(len(self._target))
        remaining = mapping.T @ (self._gradient - self._hessian @ state)
        cross = mapping.T @ self._cross @ errors
        score = errors.T @ (self._cross.T @ state - self._target) + cross.T @ (inverse @ remaining)
        gram = errors.T @ self._gram @ errors
        return PresumedErrors.find(inverse, cross, gram, score, load, prior)

    def in_target(self, errors: Array, factor: Array) -> Array:
        """What the constant ones of errors (q,) add to the target d of |R x - d|^2, R `factor`."""
        shift = self._cross[:, :SYSTEMATIC_SIZE] @ errors[:SYSTEMATIC_SIZE]
        return np.asarray(np.linalg.lstsq(factor.T, shift, rcond=None)[0])


def positive_part(information: Array, scale: Array) -> Array:
    """Nearest information without negative directions, measured in units of `scale`."""
    if lapack.dpotrf(information)[1] == 0:
        return information
    factor = np.linalg.cholesky(scale)
    half = np.linalg.solve(factor, information)
    values, vectors = np.linalg.eigh(np.linalg.solve(factor, half.T))
    root = factor @ vectors
    return np.asarray((root * np.maximum(values, 0.0)) @ root.T)
