"""Wrist force/torque sensor of the OptoForce HEX-E class: filter, noise, drift, saturation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter

Array = NDArray[np.float64]

RANGE = np.array([10.0, 10.0, 6.5, 200.0, 200.0, 200.0])
"""Nominal range [torque N m, force N]."""

RESOLUTION = np.array([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4])


@dataclass(frozen=True)
class WristSensorConfig:
    """Errors of the sensor.

    Source: HEX-E v2 noise-free resolution 0.2 N (xy), 0.8 N (z), 0.010 and 0.002 N m, a sixth of it
    as standard deviation with the 15 Hz filter; drift of the same order as reported over minutes.
    """

    force_noise_xy: float = parameter(0.035, "noise of lateral force", "N", 0.0, 10.0)
    force_noise_z: float = parameter(0.13, "noise of axial force", "N", 0.0, 10.0)
    torque_noise_xy: float = parameter(1.7e-3, "noise of bending torque", "N m", 0.0, 1.0)
    torque_noise_z: float = parameter(3.5e-4, "noise of axial torque", "N m", 0.0, 1.0)
    force_drift: float = parameter(5e-3, "random walk of force", "N/sqrt(s)", 0.0, 1.0)
    torque_drift: float = parameter(1e-4, "random walk of torque", "N m/sqrt(s)", 0.0, 1.0)
    filter_hz: float = parameter(15.0, "low-pass of the sensor", "Hz", 0.1, 1000.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class WristSensor:
    """Reports a wrench [torque, force] with the sensor's dynamics and errors.

    Args:
        config: errors.
        seed: of noise and drift.
    """

    def __init__(self, config: WristSensorConfig | None = None, seed: int = 0) -> None:
        self.config = config = config or WristSensorConfig()
        self._rng = np.random.default_rng([seed, 13])
        torque = [config.torque_noise_xy, config.torque_noise_xy, config.torque_noise_z]
        force = [config.force_noise_xy, config.force_noise_xy, config.force_noise_z]
        self.noise = np.array(torque + force)
        self._walk = np.array([config.torque_drift] * 3 + [config.force_drift] * 3)
        self._drift = np.zeros(6)
        self._filtered: Array | None = None

    def read(self, wrench: Array, dt: float) -> tuple[Array, bool]:
        """Return the reported wrench (6,) [torque, force] and whether it is saturated.

        Args:
            wrench: (6,) true [torque, force], sensor frame.
            dt: time since the last reading, s.
        """
        wrench = np.asarray(wrench, dtype=float)
        if self._filtered is None:
            self._filtered = wrench.copy()
        share = 1.0 - np.exp(-2.0 * np.pi * self.config.filter_hz * dt)
        self._filtered = self._filtered + share * (wrench - self._filtered)
        self._drift = self._drift + self._walk * np.sqrt(dt) * self._rng.standard_normal(6)
        reported = self._filtered + self._drift + self.noise * self._rng.standard_normal(6)
        limited = np.clip(reported, -RANGE, RANGE)
        saturated = bool(np.any(limited != reported))
        return np.rint(limited / RESOLUTION) * RESOLUTION, saturated
