"""Measured vector signals whose true values are unknowns of the estimation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array

from tactile_dynamics_ros.core.numerics.local_polynomial import LocalFunctional

Array = NDArray[np.float64]

_ALL = slice(None)
"""All rows of a functional. A name for `:`, no choice."""


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

    def scaled_sensitivity(
        self, sensitivity: Array, rows: NDArray[np.intp] | slice = _ALL
    ) -> bsr_array:
        """Sparse d e / d x S: how the residuals move with one standard deviation of each sample.

        Args:
            sensitivity: (n, O, 6, 3) derivative of the residual with respect to the value and the
                derivatives of the signal at each grid time.
            rows: which of the N grid times these are.

        Returns:
            (6 n, 3 K) block-sparse matrix.
        """
        count, orders = sensitivity.shape[:2]
        weights = self.functional.weights[rows, :orders]
        per_sample = weights.swapaxes(1, 2) @ sensitivity.reshape(count, orders, 18)
        size = weights.shape[2]
        blocks = per_sample.reshape(count, size, 6, 3) @ self.steps[rows]
        pointer = np.arange(0, count * size + 1, size)
        columns = self.functional.indices[rows].ravel()
        shape = (6 * count, 3 * len(self.noise_factor))
        return bsr_array((blocks.reshape(-1, 6, 3), columns, pointer), shape=shape)


def isotropic_factor(count: int, std: float) -> Array:
    """Noise factors (count, 3, 3) of equal, independent axes."""
    return np.broadcast_to(std * np.eye(3), (count, 3, 3))
