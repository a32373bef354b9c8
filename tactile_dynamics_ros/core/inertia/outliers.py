"""Isolated spikes: single samples that no physical effect of the object explains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

Array = NDArray[np.float64]

_SPIKE = 7.0
_NEIGHBOURHOOD = 9
_MISFIT_WINDOW = 51
_MISFIT = 1.25


def isolated_outlier_variance(white_residual: Array, residual: Array) -> Array:
    """Extra residual variance for samples that stick out of their neighbourhood.

    A sample is a spike if its largest whitened component exceeds 7 and three times the median of
    the nine samples around it: a persisting misfit is left to the diagnosis.

    Args:
        white_residual: (6 N,).
        residual: (N, 6).

    Returns:
        (N,) variance to add, zero for ordinary samples.
    """
    size = np.abs(white_residual.reshape(-1, 6)).max(axis=1)
    typical = median_filter(size, _NEIGHBOURHOOD, mode="nearest")
    spike = (size > _SPIKE) & (size > 3.0 * typical)
    return np.asarray(np.where(spike, 10.0 * np.sum(residual**2, axis=1), 0.0))


def noise_share(white_residual: Array) -> Array:
    """Share of each white residual that is noise: one over the mean square around it, at most 1.

    Where something that the model lacks adds variance s^2 to white unit noise, the expected noise
    is r / (1 + s^2); the mean square of 51 samples estimates 1 + s^2.

    Args:
        white_residual: (6 N,).

    Returns:
        (6 N,) factors.
    """
    square = (white_residual.reshape(-1, 6) ** 2).mean(axis=1)
    local = uniform_filter1d(square, _MISFIT_WINDOW, mode="nearest")
    return np.repeat(np.where(local > _MISFIT, 1.0 / np.maximum(local, 1.0), 1.0), 6)
