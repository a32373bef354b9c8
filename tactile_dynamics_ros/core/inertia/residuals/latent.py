"""Measured vector signals whose true values are unknowns of the estimation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.local_polynomial import LocalFunctional


@dataclass(frozen=True)
class LatentSignal:
    """K samples z_k ~ N(x_k, S_k S_k^T) of a 3-vector, read at N grid times by linear functionals.

    Attributes:
        functional: how the values and derivatives at the grid follow from the samples.
        noise_factor: (K, 3, 3) square roots S_k of the noise covariance.
        chart: (N, W, 3, 3) how what a functional reads moves with a sample, where that is not the
            sample itself; None if it is.
    """

    functional: LocalFunctional
    noise_factor: Array
    chart: Array | None = None

    @cached_property
    def steps(self) -> Array:
        """(N, W, 3, 3) how what is read moves with a standard deviation of each sample."""
        gathered = self.functional.gather(self.noise_factor)
        return gathered if self.chart is None else self.chart @ gathered


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """A = (de/dx) S: how the residuals at n times move with a standard deviation of each sample.

    Kept as its factors, which take a tenth of the memory of the matrix.

    Attributes:
        signal: of K samples.
        derivative: (n, O, 6, 3) of the residual by the value and the derivatives of the signal.
        rows: (n,) which of the signal's grid times these are.
    """

    signal: LatentSignal
    derivative: Array
    rows: NDArray[np.intp]

    def matrix(self) -> bsr_array:
        """A itself, (6 n, 3 K), block-sparse."""
        count, orders = self.derivative.shape[:2]
        per_sample = self._weights.swapaxes(1, 2) @ self.derivative.reshape(count, orders, 18)
        size = self._weights.shape[2]
        blocks = per_sample.reshape(count, size, 6, 3) @ self._steps
        pointer = np.arange(0, count * size + 1, size)
        shape = (6 * count, 3 * len(self.signal.noise_factor))
        return bsr_array((blocks.reshape(-1, 6, 3), self._indices.ravel(), pointer), shape=shape)

    def moved(self, standard: Array) -> Array:
        """A z, (6 n,): change of the residuals, samples moved by z (K, 3) standard deviations."""
        read = (self._steps @ standard[self._indices][..., None])[..., 0]
        change = np.einsum("noij,noj->ni", self.derivative, self._weights @ read)
        return np.asarray(change.ravel())

    def pulled_back(self, values: Array) -> Array:
        """A^T v, (K, 3), of values (6 n,)."""
        share = np.einsum("noij,ni->noj", self.derivative, values.reshape(-1, 6))
        read = self._weights.swapaxes(1, 2) @ share
        found = (self._steps.swapaxes(2, 3) @ read[..., None])[..., 0].reshape(-1, 3)
        places, count = self._indices.ravel(), len(self.signal.noise_factor)
        return np.stack([np.bincount(places, found[:, k], count) for k in range(3)], axis=1)

    @property
    def _weights(self) -> Array:
        """(n, O, W) of the samples in each window."""
        return self.signal.functional.weights[self.rows, : self.derivative.shape[1]]

    @property
    def _indices(self) -> NDArray[np.int64]:
        """(n, W) samples of each window."""
        return self.signal.functional.indices[self.rows]

    @property
    def _steps(self) -> Array:
        """(n, W, 3, 3) see `LatentSignal`."""
        return self.signal.steps[self.rows]


def isotropic_factor(count: int, std: float) -> Array:
    """Noise factors (count, 3, 3) of equal, independent axes."""
    return np.broadcast_to(std * np.eye(3), (count, 3, 3))
