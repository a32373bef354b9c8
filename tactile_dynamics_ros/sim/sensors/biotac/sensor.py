"""Several BioTacs read at once: forces on the object in, frames of 44 raw counts out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.tactile.electrodes import (
    CHANNELS,
    ELECTRODES,
    FULL_SCALE,
    PAC,
    PDC,
    TAC,
    TDC,
)
from tactile_dynamics_ros.sim.sensors.biotac.configuration import BioTacConfig
from tactile_dynamics_ros.sim.sensors.biotac.creep import ViscoelasticLoad
from tactile_dynamics_ros.sim.sensors.biotac.signals import (
    VibrationChannel,
    electrode_counts,
    static_pressure,
    thermistor_counts,
)
from tactile_dynamics_ros.sim.sensors.biotac.skin import (
    fluid_thickness,
    indent,
    outward_normal,
    sensed_share,
)
from tactile_dynamics_ros.sim.sensors.biotac.unit import draw_units

Array = NDArray[np.float64]


class BioTacArray:
    """``count`` individual BioTacs that are sampled together, each with its own state.

    Args:
        count: number of sensors (4 on the hand: index, middle, ring, thumb).
        config: constants of the model.
        seed: of all noise.
        unit_seed: of the units' individual constants; that of the noise if None.
    """

    def __init__(
        self,
        count: int,
        config: BioTacConfig | None = None,
        seed: int = 0,
        unit_seed: int | None = None,
    ) -> None:
        self.config = config or BioTacConfig()
        self._rng = np.random.default_rng(seed)
        units = np.random.default_rng([seed if unit_seed is None else unit_seed, 1])
        self.units = draw_units(count, self.config, units)
        self._load = ViscoelasticLoad(count, self.config)
        self._vibration = VibrationChannel(count, self.config, self._rng)
        self._point = np.tile([-6e-3, 0.0, -7e-3], (count, 1))
        self._wander = self.config.wander * self._rng.standard_normal((count, 19))
        self._wander *= self.units.loudness[:, None]
        std = self.config.temperature_wander
        start = self.config.core_temperature - self.config.cold_start
        self._temperature = start + std * self._rng.standard_normal(count)

    def measure(
        self,
        force: Array,
        point: Array,
        slip_speed: Array | float = 0.0,
        curvature: Array | float = 0.0,
        dt: float = 0.01,
    ) -> NDArray[np.uint16]:
        """Advance by ``dt`` and return one frame of raw counts.

        Args:
            force: (U, 3) force of each finger on the object, sensor frame, N (zero: no contact).
            point: (U, 3) contact point, sensor frame, m (ignored without contact).
            slip_speed: (U,) tangential speed of the object over the skin, m/s.
            curvature: (U,) curvature of the object at the contact, 1/m.
            dt: time since the last frame, s.

        Returns:
            (U, 44) 12-bit counts: E1..E19, PDC, TDC, TAC, PAC0..PAC21.
        """
        count = len(self._point)
        press, traction = self._split(
            np.asarray(force, dtype=float), np.asarray(point, dtype=float)
        )
        load = self._load.follow(np.column_stack([press, traction]), dt)
        bend = np.broadcast_to(np.asarray(curvature, dtype=float), (count,))
        patch = indent(load[:, 0], load[:, 1:], self._point, bend, self.units, self.config)
        pressure = static_pressure(patch, self.units, self.config)
        speed = np.broadcast_to(np.asarray(slip_speed, dtype=float), (count,))
        cooling = self._advance_temperature(press, dt)
        frame = np.empty((count, CHANNELS))
        frame[:, ELECTRODES] = self._electrodes(fluid_thickness(patch, self.units, self.config), dt)
        frame[:, PDC] = self.units.pressure_rest + pressure
        hiss = self.config.pressure_noise * self.units.loudness
        frame[:, PDC] += hiss * self._rng.standard_normal(count)
        frame[:, TDC] = thermistor_counts(self._temperature) + self._rng.standard_normal(count)
        frame[:, TAC] = self.units.heat_flux_rest + 1600.0 * cooling
        frame[:, TAC] += 2.0 * self._rng.standard_normal(count)
        frame[:, PAC] = self._vibration.sample(pressure, speed, press)
        frame[:, PAC] += self.units.vibration_rest[:, None]
        return np.clip(np.rint(frame), 0, FULL_SCALE).astype(np.uint16)

    def _split(self, force: Array, point: Array) -> tuple[Array, Array]:
        """Return press (U,) and traction (U, 3) on the skin and remember the contact points."""
        touching = np.linalg.norm(force, axis=1) > 0.0
        self._point = np.where(touching[:, None], point, self._point)
        normal = outward_normal(self._point)
        sensed = sensed_share(self._point)
        press = np.maximum(np.sum(force * normal, axis=1), 0.0)
        traction = -(force - press[:, None] * normal)
        return sensed * press, sensed[:, None] * traction

    def _advance_temperature(self, press: Array, dt: float) -> Array:
        """Let the core's temperature wander and cool under contact; return its rate (U,) K/s."""
        config = self.config
        decay = dt / config.temperature_time
        shake = config.temperature_wander * np.sqrt(2 * decay)
        before = self._temperature
        drift = decay * (config.core_temperature - before)
        drift = drift - config.contact_cooling * np.tanh(press) * dt * np.exp(-np.abs(drift) / 0.01)
        self._temperature = before + drift + shake * self._rng.standard_normal(len(before))
        return np.asarray(drift / dt)

    def _electrodes(self, thickness: Array, dt: float) -> Array:
        """Return electrode counts with temperature, slow wander and white noise."""
        config = self.config
        keep = np.exp(-dt / config.wander_time)
        loudness = self.units.loudness[:, None]
        kick = config.wander * loudness * np.sqrt(1.0 - keep**2)
        self._wander = keep * self._wander + kick * self._rng.standard_normal(self._wander.shape)
        warm = self.units.temperature_slope * (self._temperature - 30.0)[:, None]
        noise = config.noise * loudness * self._rng.standard_normal(self._wander.shape)
        return electrode_counts(thickness, self.units) + warm + self._wander + noise
