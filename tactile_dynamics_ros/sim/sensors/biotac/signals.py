"""Electrical side of the sensor: impedances, pressures and temperatures to counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from tactile_dynamics_ros.sim.sensors.biotac.configuration import BioTacConfig
from tactile_dynamics_ros.sim.sensors.biotac.skin import Indentation
from tactile_dynamics_ros.sim.sensors.biotac.unit import Units

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
