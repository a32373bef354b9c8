"""Is the residual white noise? Spectrum and bursts, without knowing what could be missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

Array = NDArray[np.float64]

_BANDS = 24
_FEWEST_BINS = 4
_BURST = 10
_TOLERATED_POWER = 0.05
_STATED_FREEDOM = 8.0


@dataclass(frozen=True)
class Spectrum:
    """Periodogram of white residuals, 1 on average where nothing is missing.

    Attributes:
        hz: (K,) frequencies without zero.
        power: (K, D).
    """

    hz: Array
    power: Array


@dataclass(frozen=True)
class Structure:
    """What distinguishes a residual from white noise.

    Attributes:
        p_value: that white noise looks like this, corrected for the number of tests.
        floor: white RMS of the noise alone, from the median of the spectrum.
        peak_hz: frequency of the strongest line, or None.
        bursts: times (n, 2) in s of short stretches that stick out.
    """

    p_value: float
    floor: float
    peak_hz: float | None
    bursts: Array


def periodogram(time: Array, white: Array) -> Spectrum:
    """Spectrum of (N, D) residuals at an even rate (gaps are closed)."""
    period = float(np.median(np.diff(time)))
    count = len(white)
    transform = np.fft.rfft(white - white.mean(axis=0), axis=0)[1:]
    hz = np.asarray(np.fft.rfftfreq(count, period)[1:], dtype=np.float64)
    return Spectrum(hz, np.abs(transform) ** 2 / count)


def noise_floors(spectrum: Spectrum) -> Array:
    """White RMS of the noise by channel: the median of exponential variates is ln 2 their mean."""
    return np.asarray(np.sqrt(np.median(spectrum.power, axis=0) / np.log(2.0)))


def noise_floor(spectrum: Spectrum) -> float:
    """White RMS of the noise of all channels."""
    return float(np.sqrt(np.mean(noise_floors(spectrum) ** 2)))


def examine(time: Array, white: Array) -> Structure:
    """Test bands of the spectrum, single lines and short bursts against white noise.

    The level of each channel is taken from its own spectrum, so that a misstated noise level is
    no structure. It is known as well as a variance of nu = 2 K ln(2)^2 degrees of freedom (that of
    the median of K exponential variates), so that powers over it have F distributions. Of few
    samples it says little: what was stated counts as 8 degrees of freedom (25 % of the RMS).

    Args:
        time: (N,) s.
        white: (N, D).
    """
    spectrum = periodogram(time, white)
    seen = 2.0 * len(spectrum.hz) * np.log(2.0) ** 2
    known = seen + _STATED_FREEDOM
    level = (seen * noise_floors(spectrum) ** 2 + _STATED_FREEDOM) / known
    scaled = spectrum.power / level
    band_p = _band_p_values(scaled, known)
    line_p, line = _line(spectrum.hz, scaled, known)
    burst_p, bursts = _bursts(time, white / np.sqrt(level), known)
    smallest = min(3.0 * float(band_p.min()) * len(band_p), 3.0 * line_p, 3.0 * burst_p, 1.0)
    return Structure(
        p_value=smallest,
        floor=noise_floor(spectrum),
        peak_hz=line if line_p < 1e-3 else None,
        bursts=bursts,
    )


def band_edges(count: int) -> NDArray[np.int64]:
    """Edges of bands that widen with frequency, at least four bins each."""
    edges = np.geomspace(_FEWEST_BINS, count, _BANDS + 1).astype(np.int64)
    edges = np.unique(np.concatenate([[0], edges]))
    return np.asarray(edges[np.concatenate([[True], np.diff(edges) >= _FEWEST_BINS])])


def _band_p_values(scaled: Array, known: float) -> Array:
    """Of every band, for all channels together and for each channel alone."""
    edges = band_edges(len(scaled))
    sums = np.add.reduceat(scaled, edges[:-1], axis=0)
    bins = np.diff(np.append(edges[:-1], len(scaled)))
    channels, mean = scaled.shape[1], sums / bins[:, None] / (1.0 + _TOLERATED_POWER)
    together = fdtrc(2.0 * bins * channels, known * channels, mean.mean(axis=1))
    alone = fdtrc(2.0 * bins[:, None], known, mean)
    return np.concatenate([together, alone.ravel()])


def _line(hz: Array, scaled: Array, known: float) -> tuple[float, float]:
    """P-value and frequency of the strongest line, single channels and their sum."""
    channels = scaled.shape[1]
    total = scaled.sum(axis=1)
    p_total = float(fdtrc(2 * channels, known * channels, total.max() / channels)) * len(hz)
    p_single = float(fdtrc(2, known, scaled.max())) * scaled.size
    if p_total <= p_single:
        return min(1.0, p_total), float(hz[np.argmax(total)])
    return min(1.0, p_single), float(hz[np.argmax(scaled.max(axis=1))])


def _bursts(time: Array, white: Array, known: float) -> tuple[float, Array]:
    """P-value of the largest energy in 10 samples, and the stretches that stick out."""
    count = len(white) // _BURST
    energy = (white[: count * _BURST] ** 2).sum(axis=1).reshape(count, _BURST).sum(axis=1)
    freedom = _BURST * white.shape[1]
    mean = energy / freedom / (1.0 + _TOLERATED_POWER)
    p_values = fdtrc(freedom, known * white.shape[1], mean) * count
    found = np.flatnonzero(p_values < 1e-3)
    starts = time[found * _BURST]
    ends = time[np.minimum((found + 1) * _BURST, len(time) - 1)]
    return float(min(1.0, p_values.min())), np.stack([starts, ends], axis=1)
