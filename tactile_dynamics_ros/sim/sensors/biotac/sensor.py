"""Several BioTacs read at once: forces in, signals, frames of 44 raw counts out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from tactile_dynamics_ros.core.tactile.electrodes import (
    CHANNELS,
    ELECTRODES,
    FULL_SCALE,
    PAC,
    PDC,
    TAC,
    TDC,
)
from tactile_dynamics_ros.sim.sensors.biotac.skin import (
    Indentation,
    ViscoelasticLoad,
    fluid_thickness,
    indent,
    outward_normal,
    sensed_share,
)
from tactile_dynamics_ros.sim.sensors.biotac.unit import BioTacConfig, Units, draw_units

Array = NDArray[np.float64]

PAC_PER_PDC = 36.5 / 0.37
PAC_RATE = 2200.0
HIGH_PASS_HZ = 10.0


def electrode_counts(thickness: Array, units: Units) -> Array:
    """Return electrode counts (U, 19) for fluid thickness (U, 19, 5).

    Counts and impedance in kOhm obey Z = 40950 / counts - 10; the part of the impedance above the
    electrode goes with the inverse of the thickness.
    """
    rest = 40950.0 / units.rest_counts - 10.0
    thinning = units.gap[:, None] * np.mean(1.0 / thickness, axis=2)
    impedance = rest * (1.0 - units.local_share + units.local_share * thinning)
    return np.asarray(40950.0 / (impedance + 10.0))


def static_pressure(patch: Indentation, units: Units, config: BioTacConfig) -> Array:
    """Return PDC above rest (U,) counts: displaced fluid over the compliance of the skin."""
    tail = config.tail_length
    unit_depth = config.fluid_gap * (1.0 - np.exp(-config.indentation))
    radius = config.patch_radius
    unit_volume = np.pi * unit_depth * (0.5 * radius**2 + radius * tail + tail**2)
    end = np.exp(-((patch.centre[:, 0] + 6e-3) ** 2) / (2 * (16e-3) ** 2))
    return np.asarray(units.pressure_gain * end * patch.volume / unit_volume)


def thermistor_counts(temperature: Array) -> Array:
    """Return TDC counts for temperatures in degC: inverse of T = 4025 / ln(R) - 273.15 K.

    R = (155183 - 46555 r) / r with r = counts / 4095.
    """
    ratio = np.exp(4025.0 / (temperature + 273.15))
    return np.asarray(4095.0 * 155183.0 / (ratio + 46555.0))


class VibrationChannel:
    """PAC: high-passed fluid pressure at 2200 Hz, 22 samples per frame, with slip vibration."""

    def __init__(self, count: int, config: BioTacConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self._pressure = np.zeros(count)
        self._state = np.zeros(count)
        self._band = butter(2, [50.0, 400.0], btype="bandpass", fs=PAC_RATE, output="sos")
        self._band_state = np.zeros((self._band.shape[0], count, 2))
        white = sosfilt(self._band, rng.standard_normal(22000))
        self._band_gain = 1.0 / float(np.std(white))

    def sample(self, pressure: Array, slip_speed: Array, press: Array) -> Array:
        """Return 22 samples per sensor (U, 22) in counts about rest.

        Args:
            pressure: (U,) PDC counts above rest at the end of the frame.
            slip_speed: (U,) m/s.
            press: (U,) normal force, N.
        """
        keep = 1.0 / (1.0 + 2 * np.pi * HIGH_PASS_HZ / PAC_RATE)
        slope = (pressure - self._pressure) / 22.0 * PAC_PER_PDC
        self._pressure = pressure.copy()
        powers = keep ** np.arange(1, 23)
        driven = keep * (1.0 - powers) / (1.0 - keep)
        samples = self._state[:, None] * powers + slope[:, None] * driven
        self._state = samples[:, -1].copy()
        noise = self._rng.standard_normal(samples.shape)
        band, self._band_state = sosfilt(
            self._band, self._rng.standard_normal(samples.shape), axis=1, zi=self._band_state
        )
        strength = np.sqrt(slip_speed / 0.035) * np.minimum(press, 3.0) ** 0.5
        slip = self._config.slip_vibration * self._band_gain * strength[:, None] * band
        return np.asarray(samples + slip + self._config.vibration_noise * noise)


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
