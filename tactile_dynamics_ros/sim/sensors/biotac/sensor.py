"""BioTacs read at once: contact force, skin and fluid, signals, frames of 44 raw counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.tactile.electrodes import (
    CHANNELS,
    ELECTRODES,
    FULL_SCALE,
    PAC,
    PDC,
    TAC,
    TDC,
)
from tactile_dynamics_ros.sim.sensors.biotac.unit import BioTacConfig, Units, draw_units

FAST, SLOW = 0.2, 4.0


class ViscoelasticLoad:
    """The load that the indentation follows when the true load is applied.

    A share of the response lags with 0.2 s and another with 4 s (under constant force the skin
    creeps, under constant indentation the force relaxes); a rate-independent friction loop of the
    Dahl type separates loading from unloading.
    """

    def __init__(self, count: int, config: BioTacConfig) -> None:
        self._config = config
        self._fast = np.zeros((count, 4))
        self._slow = np.zeros((count, 4))
        self._last = np.zeros(count)
        self._loop = np.zeros(count)

    def follow(self, load: Array, dt: float) -> Array:
        """Return the effective load (U, 4) [press, traction] for the true one after ``dt``."""
        config = self._config
        self._fast += (1.0 - np.exp(-dt / FAST)) * (load - self._fast)
        self._slow += (1.0 - np.exp(-dt / SLOW)) * (load - self._slow)
        change = load[:, 0] - self._last
        self._last = load[:, 0].copy()
        step = np.abs(change) / (0.15 + 0.25 * load[:, 0])
        self._loop += (np.sign(change) - self._loop) * (1.0 - np.exp(-step))
        direct = 1.0 - config.creep_fast - config.creep_slow
        effective = direct * load + config.creep_fast * self._fast + config.creep_slow * self._slow
        effective[:, 0] *= 1.0 - 0.5 * config.hysteresis * self._loop
        return effective


OUTER_RADIUS = 7.0e-3
MOUNT_X = -18.0e-3
NAIL_Z = 1.5e-3


def outward_normal(point: Array) -> Array:
    """Return the outward normal of the skin at points (..., 3) of the sensor frame.

    The skin is a cylinder about x behind the origin and a sphere about the origin before it.
    """
    radial = np.array(point, dtype=float)
    radial[..., 0] = np.maximum(radial[..., 0], 0.0)
    length = np.linalg.norm(radial, axis=-1, keepdims=True)
    fallback = np.broadcast_to(np.array([0.0, 0.0, -1.0]), radial.shape)
    return np.where(length > 1e-6, radial / np.maximum(length, 1e-6), fallback)


def sensed_share(point: Array) -> Array:
    """Return which share of a contact at (..., 3) loads the skin instead of the rigid mount.

    Contacts on the mounting frame (behind the skin) or on the nail never reach the fluid.
    """
    behind = 1.0 / (1.0 + np.exp((MOUNT_X - point[..., 0]) / 0.6e-3))
    above = 1.0 / (1.0 + np.exp((point[..., 2] - NAIL_Z) / 0.5e-3))
    share: Array = behind * above
    return share


@dataclass(frozen=True)
class Indentation:
    """Contact patch of U sensors.

    Attributes:
        centre: (U, 3) centre on the outer skin, sensor frame, m.
        normal: (U, 3) outward normal there.
        depth: (U,) m.
        radius: (U,) patch radius, m.
        shear: (U, 3) tangential displacement of the skin, m.
        volume: (U,) fluid displaced, m^3.
    """

    centre: Array
    normal: Array
    depth: Array
    radius: Array
    shear: Array
    volume: Array


def indent(
    press: Array,
    traction: Array,
    point: Array,
    curvature: Array,
    units: Units,
    config: BioTacConfig,
) -> Indentation:
    """Return the patch that a normal and a tangential force make.

    Args:
        press: (U,) normal force on the skin, N, not negative.
        traction: (U, 3) tangential force on the skin, N.
        point: (U, 3) contact point, m.
        curvature: (U,) curvature of the object, 1/m (0 flat, positive convex).
        units: constants of the sensors.
        config: constants of the model.
    """
    normal = outward_normal(point)
    axis = np.stack([np.minimum(point[:, 0], 0.0), np.zeros(len(point)), np.zeros(len(point))], -1)
    centre = axis + OUTER_RADIUS * normal
    sharpness = np.clip(1.0 + OUTER_RADIUS * curvature, 0.2, 5.0)
    load = np.maximum(press, 0.0) / units.stiffness
    radius = config.patch_radius * np.cbrt(load / sharpness)
    depth = units.gap * (1.0 - np.exp(-config.indentation * load ** (2 / 3) * np.cbrt(sharpness)))
    grip = config.shear_stiffness * units.stiffness * np.cbrt(0.05 + load)
    shear = traction / grip[:, None]
    shear *= np.minimum(1.0, 1.5e-3 / np.maximum(np.linalg.norm(shear, axis=1), 1e-9))[:, None]
    volume = np.pi * depth * (0.5 * radius**2 + radius * config.tail_length + config.tail_length**2)
    return Indentation(centre, normal, depth, radius, shear, volume)


def fluid_thickness(patch: Indentation, units: Units, config: BioTacConfig) -> Array:
    """Return the thickness of the fluid at the electrodes' nodes, (U, 19, 5) m.

    A paraboloid inside the patch, an exponential tail outside it, a bulge far away that takes up
    the displaced volume, and a wide dipole from shear: skin that is dragged along the core is
    pulled tight behind the contact and piles up fluid ahead of it.
    """
    lift = (OUTER_RADIUS - 6.65e-3) * 0.5
    origin = patch.centre + patch.shear - lift * patch.normal
    count, electrodes, nodes, _ = units.nodes.shape
    arm = units.nodes.reshape(count, -1, 3) - origin[:, None]
    depthwise, ahead = np.moveaxis(arm @ np.stack([patch.normal, patch.shear], axis=-1), -1, 0)
    square = np.einsum("unk,unk->un", arm, arm) - 0.75 * depthwise**2
    distance = np.sqrt(square)
    radius = patch.radius[:, None]
    inside = 1.0 - 0.5 * square / np.maximum(radius, 1e-6) ** 2
    outside = 0.5 * np.exp((radius - distance) / config.tail_length)
    profile = np.where(distance < radius, inside, outside)
    bulge = (patch.volume / config.bulge_area)[:, None]
    far = 1.0 - np.exp(-square / 6e-3**2)
    tilt = 0.5 * np.sum(patch.normal * patch.shear, axis=1)[:, None]
    reach = config.shear_reach
    dipole = (ahead - tilt * depthwise) / reach * np.exp(0.5 - 0.5 * square / reach**2)
    thickness = units.gap[:, None] - patch.depth[:, None] * profile + bulge * far
    thickness = thickness + config.shear_gain * dipole
    floor, soft = config.smallest_gap, 0.5 * config.smallest_gap
    above = _softplus((thickness - floor) / soft)
    return (floor + soft * above).reshape(count, electrodes, nodes)


def _softplus(value: Array) -> Array:
    """Return ln(1 + exp(x)), which is x itself for most electrodes: the fluid is seldom thin."""
    result = np.maximum(value, 0.0)
    near = np.abs(value) < 37.0
    result[near] += np.log1p(np.exp(-np.abs(value[near])))
    return result


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
