"""Lines in the spectrum of a residual: vibrations that the motion does not have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from tactile_dynamics_ros.core.discrepancy.model import Residuals

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LONGEST_SILENCE = 2.0
"""Time without samples that spectra keep, s."""
_PADDING = 8
_SIDE_BAND = 0.5
_LINE_OVER_BAND = 12.0
_LINE_SHARE = 0.1
_FEWEST_CYCLES = 6.0
_DRIVEN_SHARE = 0.01
_PHYSICAL = 5.0
"""Of a line over its surroundings, before the residual is made white."""


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
        for frame in ("body", *residuals.frames)
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
    """Values (N, D) of the channels in a frame, ``body`` or an unknown one being their own."""
    turn = residuals.frames.get(frame or "body")
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
