"""What in a residual is noise: isolated spikes, and the share that its spectrum tells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter

Array = NDArray[np.float64]

_SPIKE = 7.0
"""Largest of six white numbers of a sample from which it may be a spike: noise exceeds 7 in 1.5
samples of 10^11. Lower takes noise of long recordings out; of what lies below a Huber weight (live)
or the diagnosis takes care."""
_NEIGHBOURHOOD = 9
"""Samples over whose median a spike must stand out threefold: 90 ms at 100 Hz. What lasts longer
than half of it is misfit, and left to the diagnosis. Fewer samples let two spikes in a row hide
each other, more let a misfit of a tenth of a second pass for spikes."""
_FRAME = 128
"""Samples of a frame whose spectrum tells noise from misfit: 1.28 s at 100 Hz, lines of 0.8 Hz.
Shorter frames do not resolve the motion (0.5 to 2 Hz) from noise, longer ones blur when a misfit
begins."""
_MISFIT = 1.7
"""Power of white numbers, averaged over six channels and nine neighbouring cells of the spectrum,
from which a cell holds more than noise: white noise exceeds 1.7 in 1.3 cells of a thousand. At 1.35
it would be 3 %, and that much noise of clean recordings would count as misfit."""


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
    half = min(_FRAME // 2, len(rows) // 2)
    window = np.sin(np.pi * np.arange(2 * half) / (2 * half)) ** 2
    spectra = np.fft.rfft(_frames(rows, half) * window[:, None], axis=1)
    power = np.mean(np.abs(spectra) ** 2, axis=2) / np.sum(window**2)
    power = uniform_filter(power, 3, mode="nearest")
    share = np.where(power > _MISFIT, 1.0 / np.maximum(power, 1.0), 1.0)
    dual = window / (window**2 + np.roll(window, half) ** 2)
    noise = np.fft.irfft(spectra * share[..., None], 2 * half, axis=1) * dual[:, None]
    return _overlapped(noise, len(rows)).reshape(-1)


def _frames(rows: Array, half: int) -> Array:
    """Frames (F, 2 half, 6) of rows (N, 6), each half a frame after the last; zeros beyond."""
    count = -(-(len(rows) - 1) // half)
    padded = np.zeros(((count + 2) * half, rows.shape[1]))
    padded[half : half + len(rows)] = rows
    halves = padded.reshape(count + 2, half, -1)
    return np.concatenate([halves[:-1], halves[1:]], axis=1)


def _overlapped(frames: Array, count: int) -> Array:
    """Sum (count, 6) of overlapping frames, where the rows of `_frames` were."""
    half = frames.shape[1] // 2
    total = np.zeros((len(frames) + 1, half, frames.shape[2]))
    total[:-1] += frames[:, :half]
    total[1:] += frames[:, half:]
    return total.reshape(-1, frames.shape[2])[half : half + count]
