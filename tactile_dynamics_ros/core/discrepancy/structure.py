"""Structure of a residual along time: windows, spectrum, bursts and lines."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import fdtrc

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Residuals

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_BANDS = 24
"""Bands of the spectrum at most, each wider than the one below: excess at a few low frequencies is
not drowned by noise, nor is a flat one missed. With 12 one of 16 examples (7 synthetic probes, 9
slides of a block), a linear drag that leaves a trace of a cubic one, becomes `unexplained`; with 48
none changes."""
_FEWEST_BINS = 4
"""Frequencies of a band at least; the lowest bands have as many. 2 and 8 move the edges, which
finds the same trace of a cubic drag."""
_BURST = 10
"""Samples that are summed to find bursts: 0.1 s at 100 Hz. 5 and 20 changed no verdict of the 16;
the bursts of one of them were not told any more."""
_TOLERATED_POWER = 0.05
"""Excess of power over the level that counts as noise: levels are read from the spectrum, and the
noise of real sensors is white to a few per cent only. 0.025 and 0.1 changed nothing in the 16."""
_STATED_FREEDOM = 8.0
"""Degrees of freedom that what the sensors report counts as, beside what the spectrum shows: a
variance known to 50 %, so the RMS to 25 % (`_NOISE_TOLERANCE` of the assessment). It matters for
the fifty slips of a probe, not for thousands of samples. 4 and 16 changed nothing in the 16."""
_LONGEST_SILENCE = 2.0
"""Time without samples that spectra keep as zeros, s; longer ones, as between stretches, are
closed, or zeros would make up most of the spectrum. 1 and 4 changed nothing in the 16."""
_PADDING = 8
"""Multiple to which a spectrum is filled with zeros, so that a line is found between frequencies:
to a sixteenth of the resolution. 4 and 16 changed its frequency by 0.01 Hz at most."""
_SIDE_BAND = 0.5
"""Half width of the surroundings of a line, Hz, or ten times the resolution if that is more. 0.25
and 1 changed nothing in the 16."""
_LINE_OVER_BAND = 12.0
"""Power of a line over its surroundings from which it is one: of six channels of white noise the
sum exceeds it in one of 1e24 frequencies, of one channel in 6 of a million. 6 and 24 changed
nothing in the 16."""
_LINE_SHARE = 0.1
"""Share of the excess error that a line must hold to be reported: a tenth, since less is a detail
of a broad spectrum. 0.05 and 0.2 changed nothing in the 16 examples."""
_FEWEST_CYCLES = 6.0
"""Cycles in a recording from which a line is looked for: slower ones are drifts. At 12 a line at
0.34 Hz in 30 s was not told any more, at 3 nothing changed."""
_DRIVEN_SHARE = 0.01
"""Share of the motion's power near a line from which the motion has driven it. 0.005 and 0.02
changed nothing in the 16. Much lower, noise of the motion excuses a line that vibrates by itself;
much higher, lines that a gentle motion drives count as vibration of their own."""
_PHYSICAL = 5.0
"""Power over the surroundings that a line must have before the residual is made white. Lines that
only whitening makes have none there; others are weaker than in white units, where the worst samples
count less. 2.5 and 10 changed nothing in the 16."""


def window_index(time: Array, length: float) -> Index:
    """Number of the window of each row, counted from the first time."""
    return np.asarray((time - time[0]) // length, dtype=np.int64)


def window_starts(time: Array, length: float) -> Index:
    """First row of every window that is not empty."""
    index = window_index(time, length)
    return np.flatnonzero(np.concatenate([[True], np.diff(index) != 0])).astype(np.int64)


def window_rows(starts: Index, count: int) -> list[slice]:
    """Rows of every window, of `count` rows in all."""
    return [slice(*ends) for ends in pairwise([*starts.tolist(), count])]


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
    """Differences between a residual and white noise.

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
    """P-values of every band, for all channels together and for each channel alone."""
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


@dataclass(frozen=True)
class Line:
    """A line in a spectrum.

    Attributes:
        frame: in which it is narrowest.
        hz: interpolated frequency.
        strength: power over the mean power around it.
        share: of the excess error that it holds.
    """

    frame: str
    hz: float
    strength: float
    share: float


def find_line(residuals: Residuals, floor: float = 1.0) -> Line | None:
    """A narrow line in the spectrum, if there is one.

    A vibration fixed to a frame is one line there and a widened one elsewhere. Lines that the
    motion has too, that hold little of the excess error, or that the residual has only when it is
    made white do not count: where poses and forces have rates of their own, the weight of samples
    changes at the difference of these rates, and so does any misfit that is made white.
    """
    lines = [
        line
        for frame in (residuals.frame, *residuals.frames)
        if (line := _line_in(frame, residuals, floor)) is not None
    ]
    if not lines:
        return None
    line = max(lines, key=lambda found: found.strength)
    drivers = residuals.drivers
    if drivers is not None and _is_driven(residuals.time, drivers, line.hz):
        return None
    return line if _is_physical(residuals, line) else None


def _line_in(frame: str, residuals: Residuals, floor: float) -> Line | None:
    white = in_frame(residuals, residuals.white, frame)
    return strongest_line(frame, residuals.time, white, floor)


def in_frame(residuals: Residuals, values: Array, frame: str | None) -> Array:
    """Values (N, D) of the channels in one of `frames`; any other name is their own."""
    turn = residuals.frames.get(frame or "")
    return values if turn is None else np.asarray((turn @ values[..., None])[..., 0])


def strongest_line(frame: str, time: Array, white: Array, floor: float) -> Line | None:
    """The line of white residuals (N, D) that stands out most from its surroundings, if any.

    Misfit of the motion is stronger at times than a vibration, but spread over a band.
    """
    hz, power, resolution = _fine_spectrum(time, white)
    power = np.where(hz < _FEWEST_CYCLES * resolution, 0.0, power)
    around = int(2.0 * max(_SIDE_BAND, 10.0 * resolution) / (hz[1] - hz[0])) | 1
    surroundings = median_filter(power, around, mode="nearest")
    peak = int(np.argmax(power / np.maximum(np.maximum(surroundings, np.median(power)), 1e-300)))
    line, beside = _line_and_surroundings(hz, float(hz[peak]), resolution)
    level = max(float(np.mean(power[beside])), float(np.median(power)) / np.log(2.0), 1e-300)
    noise = floor**2 * power.size
    share = float(power[line].sum()) / max(float(power.sum()) - noise, 1e-300)
    strength = float(power[peak]) / level
    if strength < _LINE_OVER_BAND or 0.0 < share < _LINE_SHARE:
        return None
    return Line(frame, float(hz[peak]), strength, share)


def _line_and_surroundings(hz: Array, at: float, resolution: float) -> tuple[Mask, Mask]:
    """Which frequencies belong to a line, and which to the band around it."""
    distance, width = np.abs(hz - at), 2.5 * resolution
    around = (distance < max(_SIDE_BAND, 4.0 * width)) & (distance > width)
    return distance <= width, around


def _fine_spectrum(time: Array, values: Array) -> tuple[Array, Array, float]:
    """Frequencies, power summed over columns (1 per column for unit white noise), resolution.

    Lost samples are zeros; long silences, as between stretches of a recording, are closed.
    """
    steps = np.diff(time)
    period = float(np.median(steps))
    closed = np.where(steps > _LONGEST_SILENCE, period, steps)
    place = np.round(np.append(0.0, np.cumsum(closed)) / period).astype(int)
    count = int(place[-1]) + 1
    window = np.hanning(count)[place, None]
    size = int(2 ** np.ceil(np.log2(count * _PADDING)))
    tapered = np.zeros((count, values.shape[1]))
    tapered[place] = (values - values.mean(axis=0)) * window
    transform = np.fft.rfft(tapered, size, axis=0)
    power = (np.abs(transform) ** 2).sum(axis=1) / (np.sum(window**2) * values.shape[1])
    hz = np.asarray(np.fft.rfftfreq(size, period), dtype=np.float64)
    return hz, np.asarray(power, dtype=np.float64), 1.0 / (count * period)


def _is_driven(time: Array, drivers: Array, hz: float) -> bool:
    """Whether the motion has a line of its own at a frequency."""
    scaled = drivers / np.maximum(drivers.std(axis=0), 1e-12)
    frequencies, power, resolution = _fine_spectrum(time, scaled)
    near = np.abs(frequencies - hz) <= 2.0 * resolution
    return float(power[near].sum()) > _DRIVEN_SHARE * float(power.sum())


def _is_physical(residuals: Residuals, line: Line) -> bool:
    """Whether the residual has a line before it is made white."""
    values = in_frame(residuals, residuals.physical, line.frame)
    scaled = values / np.maximum(values.std(axis=0), 1e-12)
    hz, power, resolution = _fine_spectrum(residuals.time, scaled)
    there, beside = _line_and_surroundings(hz, line.hz, resolution)
    return float(power[there].max()) > _PHYSICAL * float(np.mean(power[beside]))
