"""Noise of contacts as their readings scatter, beside what they state and what is configured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.residuals.contact_grid import POINT_STD_FLOOR
from tactile_dynamics_ros.core.numerics.noise import white_noise_std

Array = NDArray[np.float64]

_FORCE_STD_FLOOR, _TORQUE_STD_FLOOR = 1e-4, 1e-6
"""Scatter of a force, N, and of a torque, N m, from which it is taken for the sensor's noise; of
less what is configured stays. Below the resolution of tactile sensors (0.01 N), above rounding.
Higher, good sensors keep the configured noise, which makes their intervals too wide; at rounding a
simulation without noise gets unlimited weight."""
_LEAST_FORCE_STD = 1e-5
"""Standard deviation of a force that is a mistake as long as no scatter was seen, N: a hundredth of
the best force sensors' at 100 Hz. A simulation without noise is believed after half a second; at
1e-3 good sensors would wait, at 0 a noise of 1e-9 N is off by 90 deviations until then."""
_UNDERSTATED = 0.01
"""Stated over seen noise of a force from which the statement is no statement but a mistake. Sensors
state at least their noise; a hundredth of it is a unit that is off or zeros. Nearer to 1 honest
statements of quiet moments are thrown away."""


class SensorNoise:
    """Standard deviations (C,) of the readings of contacts, as configured until they are seen.

    Args:
        count: contacts.
        point: m, configured.
        force: N, configured.
        torque: N m, configured.
    """

    def __init__(self, count: int, point: float, force: float, torque: float) -> None:
        self.point, self.force = np.full(count, point), np.full(count, force)
        self.torque = np.full(count, torque)
        self._least_point = point
        self._measured, self._looked = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)

    def measure(self, slot: int, time: Array, point: Array, force: Array, torque: Array) -> None:
        """Take the scatter of one contact, N readings; of its point at least what is configured.

        Args:
            slot: of the contact.
            time: (N,) s.
            point: (N, 3) m.
            force: (N, 3) N.
            torque: (N, 3) N m.
        """
        self._looked[slot] = True
        seen_point, seen_force, seen_torque = (
            white_noise_std(time, values) for values in (point, force, torque)
        )
        if seen_point > POINT_STD_FLOOR:
            self.point[slot] = max(seen_point, self._least_point)
        if seen_force > _FORCE_STD_FLOOR:
            self.force[slot], self._measured[slot] = seen_force, True
        if seen_torque > _TORQUE_STD_FLOOR:
            self.torque[slot] = seen_torque

    @property
    def least_force(self) -> Array:
        """Standard deviation (C,) of a force, N, below which a statement is a mistake."""
        early = np.where(self._looked, 0.0, _LEAST_FORCE_STD)
        return np.where(self._measured, _UNDERSTATED * self.force, early)
