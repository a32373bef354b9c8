"""Noise of contacts and poses as they scatter, beside what they state and what is configured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.residuals.contact_grid import POINT_STD_FLOOR
from tactile_dynamics_ros.core.inertia.residuals.motion import OVERSTATED
from tactile_dynamics_ros.core.numerics.noise import white_noise_std, white_pose_noise_std

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

_NOISE_FLOOR = (1e-5, 1e-6)
"""Noise of poses, rad and m, that is presumed at least: what is smoother than this was filtered or
generated, and would get unlimited weight. 0.6 mdeg and 1 um are far below any tracker. Higher
overstates the noise of good trackers in simulation and widens intervals; at zero poses without
noise make the weights overflow."""

_MOST_SCATTER = 20.0
"""Scatter of poses over what is assumed of them up to which it is noise: 1 cm and 1.1 deg are the
worst depth cameras. Higher takes poses in mm for noisy ones, lower doubts those cameras."""


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


class PoseScatter:
    """Scatter of the poses beside the noise that they state, or that is assumed of them.

    Assumed noise becomes that of the scatter. So does stated noise that is far above it: a
    tracker's covariance also covers slow errors, which differentiation does not see.
    """

    def __init__(self) -> None:
        self._seen = np.zeros(2)
        self._scale = np.ones((2, 2))

    def measure(
        self, time: Array, rotation: Array, position: Array, noise: Array, stated: Array
    ) -> None:
        """Take the scatter of N poses.

        Args:
            time: (N,) s.
            rotation: (N, 3, 3).
            position: (N, 3) m.
            noise: (N, 2, 3, 3) square roots of the covariances, stated or assumed.
            stated: (N,) 1 where they are stated, else 0.
        """
        seen = np.array(white_pose_noise_std(time, rotation, position))
        self._seen = np.maximum(seen, _NOISE_FLOOR)
        for kind in (0, 1):
            chosen = noise[stated == kind]
            if len(chosen):
                ratio = self._seen / np.median(_levels(chosen), axis=0)
                ratio = np.minimum(ratio, _MOST_SCATTER)
                far = ratio < OVERSTATED if kind else seen > 0.0
                self._scale[kind] = np.where(far, ratio, 1.0)

    def scaled(self, noise: Array, stated: Array) -> Array:
        """Noise (N, 2, 3, 3) of poses as it is to be believed; none is moved beyond the scatter."""
        scale = self._scale[stated.astype(int)]
        own = self._seen / _levels(noise)
        factor = np.clip(own, np.minimum(scale, 1.0), np.maximum(scale, 1.0))
        return np.asarray(factor[..., None, None] * noise)


def _levels(noise: Array) -> Array:
    """Standard deviations (N, 2) of rotation and position, means of the axes."""
    return np.asarray(np.sqrt(np.einsum("nsij,nsij->ns", noise, noise) / 3.0))
