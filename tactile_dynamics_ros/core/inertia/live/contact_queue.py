"""Recent readings of one contact, read at the stamps of the poses."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property
from math import inf

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import (
    EMPTY,
    LOADED,
    SILENCE_PERIODS,
    SYNCHRONOUS,
)
from tactile_dynamics_ros.core.numerics.local_polynomial import (
    centred_weights,
    lagrange_weights,
    polynomial_weights,
    tapered_shares,
)

_LIMIT = 1024
"""Readings kept at least, and at most twice as many: 10 s at 100 Hz, 1 s at 1 kHz, far longer than
a pose is late. Fewer could lose what a pose still needs. More only hold memory."""
_LOADED_NEWTON = 0.3
"""Load from which the sudden absence of a contact is suspicious, N: ten times the noise of a sensor
of 0.03 N; what presses less moves no estimate of a body that a hand lifts. Lower, fingers that only
brushed the object withhold estimates for `_DOUBT_DURATION`; higher, a sensor that drops out in a
gentle grasp goes unnoticed."""
_DOUBT_DURATION = 10.0
"""How long the absence of a contact that pressed is suspicious, s: a sensor that drops out comes
back or is seen to by then, a finger that was lifted stays away. Shorter believes a sensor that is
silent for longer, longer withholds estimates after a finger was lifted."""
_FAST = 0.6
"""Period over that of the grid below which readings are averaged: there are at least 1.7 per step
of the grid then. Nearer to 1 jitter of a rate that equals the grid's would switch between averages
and interpolation; the batch estimator, which knows the whole stream, averages from 0.9."""
_PERIOD_GAIN = 0.05
"""Share by which the period follows the last step between readings: an average over 20 steps, 0.2 s
at 100 Hz. More follows single late messages, less is slow to notice another rate."""
_AVERAGED = 1.25
"""Half width of means in periods of the grid: their noise is about white on the grid, as the live
sum takes it to be. Recordings, whose whole covariance is known, are read over 1.5 periods, which
lets less noise pass; wider here would make the published intervals too small."""
_BENT = 4
"""Readings that a mean needs more of than this to be one by a parabola: one beyond its three
coefficients and the symmetry of the window. Fewer give a line's mean, which makes forces that bend
too small (0.3 % at 5 Hz over 8 ms)."""


@dataclass(frozen=True)
class ContactReading:
    """One contact at one instant, world axes; `lost` where loaded samples were dropped.

    Attributes:
        point: (3,) m.
        rotation: (3, 3) contact frame.
        force: (3,) N; torque: (3,) N m about the point.
        std: (3,) N, of an equivalent white noise at the rate of the poses; NaN if not stated.
        lost: the reading is missing although the contact is loaded before and after.
    """

    point: Array
    rotation: Array
    force: Array
    torque: Array
    std: Array
    lost: bool = False

    @property
    def load(self) -> float:
        """|force| + |torque|, as a measure of being loaded."""
        return float(np.linalg.norm(self.force) + np.linalg.norm(self.torque))

    @cached_property
    def in_contact(self) -> bool:
        """Whether anything is transmitted."""
        return bool(np.abs(self.force).sum() + np.abs(self.torque).sum() > EMPTY)


class ContactQueue:
    """Bounded queue of one contact's readings in order of their stamps."""

    def __init__(self, timeout: float) -> None:
        """Start empty; a silence longer than `timeout` means absence."""
        self._timeout = timeout
        self._times: list[float] = []
        self._readings: list[ContactReading] = []
        self._period = 0.0
        self._loaded = (-np.inf, 0.0)
        self.has_torque = False

    @property
    def newest(self) -> float:
        """Stamp of the newest reading."""
        return self._times[-1] if self._times else -np.inf

    @property
    def last_load(self) -> float:
        """Load of the newest reading."""
        return self._readings[-1].load if self._readings else 0.0

    def was_loaded(self, time: float) -> bool:
        """Whether the contact pressed within the last seconds before a time (s)."""
        when, load = self._loaded
        return load > _LOADED_NEWTON and time - when < _DOUBT_DURATION

    def append(self, time: float, reading: ContactReading) -> bool:
        """Add a reading; return False (and do not) if its stamp is not newer than the last."""
        if self._times and time <= self._times[-1]:
            return False
        if self._times:
            step = time - self._times[-1]
            if self._period == 0.0:
                self._period = step
            elif step < self._timeout:
                self._period += _PERIOD_GAIN * (step - self._period)
        self._times.append(time)
        self._readings.append(reading)
        if reading.in_contact:
            self._loaded = time, reading.load
        if len(self._times) > 2 * _LIMIT:
            del self._times[:_LIMIT], self._readings[:_LIMIT]
        return True

    def clear(self) -> None:
        """Forget the readings, not the period."""
        self._times.clear()
        self._readings.clear()

    def is_settled(self, time: float, grid_period: float, now: float) -> bool:
        """Whether the reading at `time` is decided: all that it needs came, or nothing will."""
        if self._is_fast(grid_period):
            came = self.newest >= time + _AVERAGED * grid_period
        else:
            came = abs(self.newest - time) <= SYNCHRONOUS or time <= max(
                self._times[-2:-1], default=-inf
            )
        return came or now - max(time, self.newest) > self._timeout

    def _is_fast(self, grid_period: float) -> bool:
        """Whether readings are averaged over periods of the grid."""
        return 0.0 < self._period < _FAST * grid_period

    def read(self, time: float, grid_period: float) -> ContactReading | None:
        """Reading at `time`: the sample, a mean by a tapered parabola, or an interpolation.

        Noise is stated as white noise of the grid with the same power at low frequency,
        std^2 = std_sample^2 T_sample / T_grid.

        Returns:
            None where the contact is absent.
        """
        right = bisect_left(self._times, time - SYNCHRONOUS)
        if right < len(self._times) and abs(self._times[right] - time) <= SYNCHRONOUS:
            return self._scaled(self._exact(right, grid_period), grid_period)
        if right == 0 or right == len(self._times):
            return None
        gap = self._times[right] - self._times[right - 1]
        before, after = self._readings[right - 1], self._readings[right]
        if gap > SILENCE_PERIODS * max(self._period, 1e-6) and gap > grid_period:
            loaded = min(
                np.linalg.norm(r.force) + np.linalg.norm(r.torque) for r in (before, after)
            )
            return _missing(before) if loaded > LOADED * self.last_load > 0 else None
        if not (before.in_contact and after.in_contact):
            nearer = before if time - self._times[right - 1] < 0.5 * gap else after
            return nearer if nearer.in_contact else None
        if self._is_fast(grid_period):
            return self._scaled(self._mean(time, grid_period), grid_period)
        return self._scaled(self._between(time, right), grid_period)

    def _between(self, time: float, right: int) -> ContactReading:
        """Interpolation: cubic through four readings in a row, else linear."""
        chosen = slice(right - 2, right + 2)
        times, readings = self._times[chosen], self._readings[chosen]
        even = len(times) == 4 and times[-1] - times[0] < 3 * SILENCE_PERIODS * self._period
        if not (even and all(reading.in_contact for reading in readings)):
            chosen = slice(right - 1, right + 1)
            times, readings = self._times[chosen], self._readings[chosen]
        weights = lagrange_weights(np.array([times]), np.array([time]))[0]
        return _mix(readings, weights)

    def _exact(self, index: int, grid_period: float) -> ContactReading | None:
        if self._is_fast(grid_period):
            return self._mean(self._times[index], grid_period)
        reading = self._readings[index]
        return reading if reading.in_contact else None

    def _mean(self, time: float, grid_period: float) -> ContactReading | None:
        half = _AVERAGED * grid_period
        chosen = slice(bisect_left(self._times, time - half), bisect_left(self._times, time + half))
        readings, offset = self._readings[chosen], np.array([self._times[chosen]]) - time
        held = np.array([reading.in_contact for reading in readings])
        if not held.any():
            return None
        shares = tapered_shares(offset, half) * held
        if held.all() and len(held) > _BENT:
            return _mix(readings, polynomial_weights(shares, offset, 2, orders=1)[0, 0])
        return _mix(readings, centred_weights(shares, offset)[0])

    def _scaled(self, reading: ContactReading | None, grid_period: float) -> ContactReading | None:
        if reading is None or self._period == 0.0:
            return reading
        ratio = float(np.sqrt(self._period / grid_period))
        if abs(ratio - 1.0) < 0.1:
            return reading
        return ContactReading(
            reading.point, reading.rotation, reading.force, reading.torque, ratio * reading.std
        )


def _mix(readings: list[ContactReading], weights: Array) -> ContactReading:
    middle = readings[int(np.argmax(weights))]
    values = np.array([[r.point, r.force, r.torque, r.std] for r in readings])
    point, force, torque, std = np.tensordot(weights, values, 1)
    return ContactReading(point, middle.rotation, force, torque, std)


def _missing(before: ContactReading) -> ContactReading:
    return ContactReading(
        before.point, before.rotation, before.force, before.torque, before.std, lost=True
    )
