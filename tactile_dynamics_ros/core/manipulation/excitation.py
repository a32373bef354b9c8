"""Motions by which a held object's inertia is identifiable: Cartesian offsets over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_json

# time (s) -> (6,) [rotation vector (rad), translation (m)] in world axes, zero at start and end
CartesianOffsets = Callable[[float], Array]


@dataclass(frozen=True)
class ExcitationConfig:
    """Size and content of the default excitation."""

    duration: float = parameter(30.0, "length of the motion", "s", 1.0, 600.0)
    rotation: float = parameter(0.45, "largest turn about each axis", "rad", 0.0, 1.5)
    translation: float = parameter(0.05, "largest shift along each axis", "m", 0.0, 0.3)
    lowest_hz: float = parameter(0.15, "lowest frequency", "Hz", 0.01, 2.0)
    highest_hz: float = parameter(0.75, "highest frequency", "Hz", 0.02, 3.0)
    sines: int = parameter(3, "sines per axis", "", 1, 10)
    ramp: float = parameter(2.0, "time to fade in and out", "s", 0.1, 30.0)
    seed: int = parameter(0, "seed of the phases", "", 0, 2**31 - 1)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.lowest_hz >= self.highest_hz:
            raise BadInputError(
                f"ExcitationConfig: lowest_hz = {self.lowest_hz} must be below "
                f"highest_hz = {self.highest_hz}"
            )


class SumOfSines:
    """Sum of sines on all six axes with different frequencies, faded in and out.

    x_k(t) = w(t) A_k sum_j sin(2 pi f_kj t + phase_kj) / norm_k

    Args:
        config: size, frequencies and seed.
    """

    def __init__(self, config: ExcitationConfig | None = None) -> None:
        self.config = config or ExcitationConfig()
        count = self.config.sines
        grid = np.geomspace(self.config.lowest_hz, self.config.highest_hz, 6 * count)
        self._frequency = grid.reshape(count, 6).T
        rng = np.random.default_rng(self.config.seed)
        self._phase = rng.uniform(0.0, 2 * np.pi, (6, count))
        amplitude = np.repeat([self.config.rotation, self.config.translation], 3)
        time = np.linspace(0.0, self.config.duration, 2000)
        self._scale = np.ones(6)
        self._scale = amplitude / np.abs(self._sines(time)).max(axis=0)

    @property
    def duration(self) -> float:
        """Length of the motion, s."""
        return self.config.duration

    def __call__(self, time: float) -> Array:
        """Return the offset (6,) [rotation vector, translation] at ``time`` (s)."""
        ramp = min(self.config.ramp, 0.5 * self.duration)
        inside = min(time, self.duration - time) / ramp
        return np.asarray(_smooth(inside) * self._sines(np.array([time]))[0])

    def _sines(self, time: Array) -> Array:
        angle = 2 * np.pi * self._frequency * time[:, None, None] + self._phase
        return np.asarray(np.sin(angle).sum(axis=2) * self._scale)


class OffsetTable:
    """Offsets given as samples, interpolated linearly; zero outside.

    Args:
        time: (N,) s, increasing from zero.
        offsets: (N, 6) [rotation vector (rad), translation (m)], world axes.

    Raises:
        BadInputError: shapes differ, or time does not increase from zero.
    """

    def __init__(self, time: Array, offsets: Array) -> None:
        self._time = np.asarray(time, dtype=float)
        self._offsets = np.asarray(offsets, dtype=float)
        if self._offsets.shape != (len(self._time), 6):
            raise BadInputError(
                f"excitation: {self._offsets.shape} offsets for {len(self._time)} times, "
                "expected (N, 6)"
            )
        if len(self._time) < 2 or self._time[0] != 0.0 or (np.diff(self._time) <= 0).any():
            raise BadInputError("excitation: times must increase and start at 0")

    @classmethod
    def from_file(cls, path: Path) -> OffsetTable:
        """Read a motion that `tactile-dynamics excite` wrote: JSON with time and offsets.

        Raises:
            BadInputError: there is no such file, or it holds something else.
        """
        try:
            table = read_json(path, "a motion")
            return cls(np.array(table["time"], float), np.array(table["offsets"], float))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise BadInputError(
                f"motion {path}: expected JSON with 'time' and 'offsets', as "
                f"`tactile-dynamics excite --out` writes it ({error})"
            ) from error

    @property
    def duration(self) -> float:
        """Length of the motion, s."""
        return float(self._time[-1])

    def __call__(self, time: float) -> Array:
        """Return the offset (6,) at ``time`` (s)."""
        columns = self._offsets.T
        return np.array([np.interp(time, self._time, row, 0.0, 0.0) for row in columns])


def _smooth(fraction: float) -> float:
    """Quintic step from 0 to 1."""
    x = float(np.clip(fraction, 0.0, 1.0))
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
