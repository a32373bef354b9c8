"""What a residual looks like that no known effect explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from tactile_dynamics_ros.core.discrepancy.assessment import noise_floor
from tactile_dynamics_ros.core.discrepancy.change import Change, clear_change
from tactile_dynamics_ros.core.discrepancy.model import Family, ResidualModel, Residuals
from tactile_dynamics_ros.core.discrepancy.screening import Score, best_by_effect, screen
from tactile_dynamics_ros.core.discrepancy.structure import examine

Array = NDArray[np.float64]

_LONGEST_SILENCE = 2.0
"""Time without samples that spectra keep, s."""
_PADDING = 8
_SIDE_BAND = 0.5
_LINE_OVER_BAND = 12.0
_LINE_SHARE = 0.1
_FEWEST_CYCLES = 6.0
_DRIVEN_SHARE = 0.01
_CHANNEL_SHARE = 0.15
_CORRELATED = 0.1
_FORMULA_SHARE = 0.5
_FORMULA_TERMS = 3
_FORMULA_COLUMNS = 3
_BURST_SHARE = 0.6
_BURST_TIME = 0.2


@dataclass(frozen=True)
class Signature:
    """Properties of an unexplained residual.

    Attributes:
        channels: those that carry the excess error.
        frame: in which it is simplest, or None.
        frequency_hz: of a line in its spectrum, or None.
        correlates_with: the named quantity that explains most, or None.
        share: of the excess error that this quantity explains.
        formula: a sparse law in named quantities that explains at least half of it, or None.
        intervals: times (start, end) in s of bursts, if the error comes in bursts.
        change: the time at which it begins or ends, if there is one.
    """

    channels: tuple[str, ...]
    frame: str | None
    frequency_hz: float | None
    correlates_with: str | None
    share: float
    formula: str | None
    intervals: tuple[tuple[float, float], ...]
    change: Change | None = None

    def to_json(self) -> dict[str, Any]:
        """The part `unexplained` of the document of `diagnose`."""
        return {
            "channels": list(self.channels),
            "frequency_hz": self.frequency_hz,
            "correlates_with": self.correlates_with,
            "formula": self.formula,
            "frame": self.frame,
            "share_of_excess": self.share,
            "intervals": [list(interval) for interval in self.intervals],
            "change": self.change.to_json() if self.change else None,
        }


def describe_residual(model: ResidualModel) -> Signature:
    """Describe what is left over by spectrum, frame, bursts and sparse regression."""
    residuals = model.residuals()
    floor = noise_floor(model)
    line = find_line(residuals, floor)
    frequency = line.hz if line else None
    scores = screen(model, model.library(), floor)
    total = float(model.residual @ model.residual)
    excess = max(total - floor**2 * len(model.residual), 1e-12)
    best = best_by_effect(scores)
    share = min(1.0, best[0].gain / excess) if best else 0.0
    named = best[0] if best and share > _CORRELATED else None
    frame = line.frame if line else (named.family.frame or None if named else None)
    return Signature(
        channels=failing_channels(residuals, frame, floor),
        frame=frame,
        frequency_hz=frequency,
        correlates_with=named.family.name if named else None,
        share=share if named else 0.0,
        formula=_find_formula(model, scores, floor, excess),
        intervals=_bursts(residuals, floor),
        change=clear_change(model, floor),
    )


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
    motion has too, or that hold little of the excess error, do not count.
    """
    lines = [
        line
        for frame, white in in_frames(residuals).items()
        if (line := strongest_line(frame, residuals.time, white, floor)) is not None
    ]
    if not lines:
        return None
    line = max(lines, key=lambda found: found.strength)
    drivers = residuals.drivers
    if drivers is not None and _is_driven(residuals.time, drivers, line.hz):
        return None
    return line


def in_frames(residuals: Residuals) -> dict[str, Array]:
    """White residuals in every frame, ``body`` being that of the channels."""
    turned = {
        name: (matrix @ residuals.white[..., None])[..., 0]
        for name, matrix in residuals.frames.items()
    }
    return {"body": residuals.white, **turned}


def strongest_line(frame: str, time: Array, white: Array, floor: float) -> Line | None:
    """The line of white residuals (N, D) that stands out most from its surroundings, if any.

    Misfit of the motion is stronger at times than a vibration, but spread over a band.
    """
    hz, power, resolution = _fine_spectrum(time, white)
    power = np.where(hz < _FEWEST_CYCLES * resolution, 0.0, power)
    around = int(2.0 * max(_SIDE_BAND, 10.0 * resolution) / (hz[1] - hz[0])) | 1
    surroundings = median_filter(power, around, mode="nearest")
    peak = int(np.argmax(power / np.maximum(np.maximum(surroundings, np.median(power)), 1e-300)))
    distance = np.abs(hz - hz[peak])
    width = 2.5 * resolution
    beside = (distance < max(_SIDE_BAND, 4.0 * width)) & (distance > width)
    level = max(float(np.mean(power[beside])), float(np.median(power)) / np.log(2.0), 1e-300)
    noise = floor**2 * power.size
    share = float(power[distance <= width].sum()) / max(float(power.sum()) - noise, 1e-300)
    strength = float(power[peak]) / level
    if strength < _LINE_OVER_BAND or 0.0 < share < _LINE_SHARE:
        return None
    return Line(frame, float(hz[peak]), strength, share)


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


def failing_channels(residuals: Residuals, frame: str | None, floor: float) -> tuple[str, ...]:
    """Channels (with the frame, where not the body's) with a good part of the excess error."""
    white = in_frames(residuals).get(frame or "body", residuals.white)
    excess = np.maximum(np.mean(white**2, axis=0) - floor**2, 0.0)
    if not np.any(excess > 0):
        excess = np.mean(white**2, axis=0)
    picked = np.flatnonzero(excess > _CHANNEL_SHARE * excess.max())
    order = picked[np.argsort(-excess[picked])]
    return tuple(residuals.channels[k] for k in order)


def _bursts(residuals: Residuals, floor: float) -> tuple[tuple[float, float], ...]:
    """Times of the bursts if most of the excess error comes in a small part of the time."""
    bursts = examine(residuals.time, residuals.white).bursts
    if not len(bursts):
        return ()
    inside = np.any(
        (residuals.time[:, None] >= bursts[:, 0]) & (residuals.time[:, None] < bursts[:, 1]), axis=1
    )
    excess = residuals.white**2 - floor**2
    share = float(excess[inside].sum() / max(float(excess.sum()), 1e-12))
    if share < _BURST_SHARE or inside.mean() > _BURST_TIME:
        return ()
    return _joined(bursts)


def _joined(bursts: Array) -> tuple[tuple[float, float], ...]:
    breaks = np.flatnonzero(bursts[1:, 0] > bursts[:-1, 1] + 1e-6) + 1
    return tuple((float(run[0, 0]), float(run[-1, 1])) for run in np.split(bursts, breaks))


def _find_formula(
    model: ResidualModel, scores: Sequence[Score], floor: float, excess: float
) -> str | None:
    """Forward selection of short terms until half of the excess error is explained."""
    short = [s for s in scores if s.family.symbols and len(s.family.kept) <= _FORMULA_COLUMNS]
    chosen: list[Family] = []
    explained, coefficients = 0.0, np.zeros(0)
    for _ in range(_FORMULA_TERMS):
        others = [s.family for s in short if all(s.family is not f for f in chosen)]
        options = [_joint(model, [*chosen, family], floor) for family in others]
        if not options:
            break
        score, families = max(options, key=lambda option: option[0].gain)
        if score.gain - explained < _CORRELATED * excess:
            break
        chosen, explained, coefficients = families, score.gain, score.coefficients
    if explained < _FORMULA_SHARE * excess:
        return None
    return _write_formula(chosen, coefficients)


def _joint(
    model: ResidualModel, families: list[Family], floor: float
) -> tuple[Score, list[Family]]:
    columns = np.concatenate([f.columns[:, list(f.kept)] for f in families], axis=1)
    joint = Family("formula", "formula", "formula", columns, tuple(range(columns.shape[1])))
    return screen(model, [joint], floor)[0], families


def _write_formula(families: list[Family], coefficients: Array) -> str:
    symbols = [symbol for family in families for symbol in family.symbols]
    terms = [f"{c:.3g} {s}" for c, s in zip(coefficients, symbols, strict=True)]
    return " + ".join(terms).replace("+ -", "- ")
