"""Mechanics of the skin: from a contact force to the thickness of the fluid, with creep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.sim.sensors.biotac.unit import BioTacConfig, Units

Array = NDArray[np.float64]

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
