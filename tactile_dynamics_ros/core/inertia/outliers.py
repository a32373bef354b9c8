"""What in a residual is noise: isolated spikes, and the share that its spectrum tells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

Array = NDArray[np.float64]

_SPIKE = 7.0
_NEIGHBOURHOOD = 9
_FRAME = 128
_MISFIT = 1.7


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


def expected_noise(white_residual: Array) -> Array:
    """Noise that is expected in a white residual, given its spectrum around each time.

    Where something that the model lacks adds variance s^2 to white unit noise, the expected noise
    is r / (1 + s^2). The power of frames of 128 samples estimates 1 + s^2 by frequency: what a
    model lacks follows the motion, which is slower than most of the noise.

    Args:
        white_residual: (6 N,).

    Returns:
        (6 N,) of no more power than the residual.

    Source: Wiener 1949.
    """
    rows = white_residual.reshape(-1, 6)
    length = min(_FRAME, 2 * (len(rows) // 2))
    window = hann(length, sym=False)
    transform = ShortTimeFFT(window, length // 2, fs=1.0)
    spectra = transform.stft(rows, axis=0)
    power = np.mean(np.abs(spectra) ** 2, axis=1, keepdims=True) / np.sum(window**2)
    power = uniform_filter(power, (3, 1, 3), mode="nearest")
    share = np.where(power > _MISFIT, 1.0 / np.maximum(power, 1.0), 1.0)
    noise = transform.istft(spectra * share, k1=len(rows), f_axis=0)
    return np.asarray(noise).reshape(-1)
