"""Weights of hypotheses by what was measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

Array = NDArray[np.float64]

_LEAST_COUNT = 0.5
"""Share of the hypotheses that must go on counting after a step. What a measurement says beyond is
left out: with a tenth of them their covariance would be of ten points."""


def log_likelihood(lack: Array, covariance: Array) -> Array:
    """Logarithms (C,) of the likelihood of deviations (C, m)."""
    white = solve_triangular(np.linalg.cholesky(covariance), lack.T, lower=True)
    return np.asarray(-0.5 * np.sum(white**2, axis=0))


def tempered_weights(log_likelihood: Array) -> tuple[Array, float]:
    """Weights (C,) ~ likelihood^b with the largest b <= 1 for which enough hypotheses count.

    They count as 1 / sum w^2. With b below 1 a part of the measurement is left out, which is
    honest: no hypothesis is near enough to say what all of it means.
    """
    raised = log_likelihood - log_likelihood.max()

    def weights(power: float) -> Array:
        w = np.exp(power * raised)
        return np.asarray(w / w.sum())

    wanted = _LEAST_COUNT * len(raised)
    full = weights(1.0)
    if 1.0 / np.sum(full**2) >= wanted:
        return full, 1.0
    low, high = -12.0, 0.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if 1.0 / np.sum(weights(float(np.exp(middle))) ** 2) >= wanted:
            low = middle
        else:
            high = middle
    return weights(float(np.exp(low))), float(np.exp(low))
