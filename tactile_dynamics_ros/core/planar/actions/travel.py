"""How a straight way is gone from rest to rest: evenly or shaken, with a soft or a hard stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Travel:
    """A trapezoid of speed, and a shake on top of it that begins and ends at rest.

    s(t) = trapezoid + a / 2 (1 - cos 2 pi f t) for as many whole periods as the way lasts.

    Attributes:
        speed: m/s at most. acceleration: m/s^2 at the start.
        braking: m/s^2 at the stop; 0 as at the start.
        sway: a, m, from end to end of the shake. sway_hz: f, how often.
    """

    speed: float
    acceleration: float
    braking: float = 0.0
    sway: float = 0.0
    sway_hz: float = 0.0

    @property
    def stopping(self) -> float:
        """Deceleration at the end, m/s^2."""
        return self.braking or self.acceleration

    def peak(self, length: float) -> float:
        """Speed that is reached on a way, m/s; lower than the speed where the way is short."""
        harmonic = 2.0 / (1.0 / self.acceleration + 1.0 / self.stopping)
        return min(self.speed, float(np.sqrt(length * harmonic)))

    def duration(self, length: float) -> float:
        """Seconds that a way takes, m."""
        if length == 0.0:
            return 0.0
        top = self.peak(length)
        return length / top + 0.5 * top * (1.0 / self.acceleration + 1.0 / self.stopping)

    def braking_from(self, length: float) -> float:
        """Seconds after which the speed falls, of a way of a length, m."""
        return self.duration(length) - self.peak(length) / self.stopping

    def at(self, time: Array, length: float) -> Array:
        """Way (T,) m that is gone at times (T,) s since the start of one of a length, m."""
        if length == 0.0:
            return np.zeros_like(time)
        top, whole = self.peak(length), self.duration(length)
        t = np.clip(time, 0.0, whole)
        ramp, left = top / self.acceleration, whole - t
        way = top * (t - 0.5 * ramp)
        way = np.where(t < ramp, 0.5 * self.acceleration * t**2, way)
        way = np.where(left < top / self.stopping, length - 0.5 * self.stopping * left**2, way)
        if self.sway == 0.0:
            return np.asarray(way)
        periods = np.minimum(self.sway_hz * t, np.floor(self.sway_hz * whole))
        return np.asarray(way + 0.5 * self.sway * (1.0 - np.cos(2.0 * np.pi * periods)))
