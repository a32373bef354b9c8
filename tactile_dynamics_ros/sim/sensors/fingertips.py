"""Fingertips of a hand in a simulated world: BioTacs, and flat pads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import cross, log_so3
from tactile_dynamics_ros.sim.contacts import ContactReading
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PadConfig:
    """Errors of a six-axis sensor behind a pad, tared before it touches.

    Source: sizes of what six-axis sensors of 17 mm (ATI Nano17) resolve, 3 mN and 0.02 mN m, times
    ten for a driver without averaging.
    """

    force_noise: float = parameter(0.03, "white noise of a force axis", "N", 0.0, 10.0)
    torque_noise: float = parameter(2e-4, "white noise of a torque axis", "N m", 0.0, 1.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class ForceTorquePads:
    """Sensors of all pads.

    Args:
        fingers: names of the pads.
        config: errors.
        seed: of the noise.
    """

    def __init__(
        self, fingers: Sequence[str], config: PadConfig | None = None, seed: int = 0
    ) -> None:
        self.config = config or PadConfig()
        self._fingers = tuple(fingers)
        self._rng = np.random.default_rng([seed, 17])

    @property
    def force_std(self) -> Array:
        """(3,) standard deviation of a reported force, N."""
        return np.full(3, max(self.config.force_noise, 1e-4))

    def read(self, contacts: Mapping[str, ContactReading], poses: Array) -> Array:
        """Return the wrenches (F, 6) [torque, force] on the object about the frames' origins.

        Args:
            contacts: true ones by finger, world axes.
            poses: (F, 4, 4) true X_WS of the sensor frames.
        """
        std = np.repeat([self.config.torque_noise, self.config.force_noise], 3)
        wrenches = std * self._rng.standard_normal((len(self._fingers), 6))
        for row, finger, pose in zip(wrenches, self._fingers, poses, strict=True):
            contact = contacts[finger]
            if contact.in_contact:
                torque = contact.torque + cross(contact.point - pose[:3, 3], contact.force)
                row += np.concatenate([torque @ pose[:3, :3], contact.force @ pose[:3, :3]])
        return wrenches


class TipContact(Protocol):
    """What is needed of a contact: mean force on the object and place, world axes."""

    @property
    def force(self) -> Array:
        """(3,) N."""

    @property
    def point(self) -> Array:
        """(3,) m."""

    @property
    def in_contact(self) -> bool:
        """Whether anything is touched."""


class Fingertips:
    """BioTacs of all fingers.

    Args:
        fingers: their names, in the order of the rows of the image.
        config: of the sensors.
        seed: of the noise.
        unit_seed: of the units' constants: the same hand has the same fingertips.
    """

    def __init__(
        self,
        fingers: Sequence[str],
        config: BioTacConfig | None = None,
        seed: int = 0,
        unit_seed: int = 0,
    ) -> None:
        self._fingers = tuple(fingers)
        self.array = BioTacArray(len(self._fingers), config, seed, unit_seed)
        self._last: Array | None = None

    def read(
        self,
        contacts: Mapping[str, TipContact],
        poses: Array,
        object_pose: Array,
        object_twist: tuple[Array, Array],
        dt: float = 0.01,
    ) -> NDArray[np.uint16]:
        """Return raw counts (F, 44) in the order of the fingers.

        Args:
            contacts: by finger; forces on the object, world axes.
            poses: (F, 4, 4) true X_WS of the sensor frames.
            object_pose: (4, 4) true X_WO.
            object_twist: angular velocity and velocity of the object's origin, world axes.
            dt: time since the last reading, s.
        """
        touching = [k for k, finger in enumerate(self._fingers) if _touches(contacts.get(finger))]
        count = len(self._fingers)
        force, point, slip = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
        if touching:
            where = np.stack([contacts[self._fingers[k]].point for k in touching])
            pushed = np.stack([contacts[self._fingers[k]].force for k in touching])
            rotation = poses[touching, :3, :3]
            force[touching] = _turn_back(rotation, pushed)
            point[touching] = _turn_back(rotation, where - poses[touching, :3, 3])
            if self._last is not None:
                velocity = _velocity(self._last[touching], poses[touching], where, dt)
                arm = where - object_pose[:3, 3]
                slipping = object_twist[1] + cross(np.asarray(object_twist[0]), arm) - velocity
                slip[touching] = _tangential(slipping, where - poses[touching, :3, 3])
        self._last = poses.copy()
        return self.array.measure(force, point, slip_speed=slip, dt=dt)


def _touches(contact: TipContact | None) -> bool:
    return contact is not None and contact.in_contact


def _turn_back(rotation: Array, vector: Array) -> Array:
    """Return R^T v of rotations (K, 3, 3) and vectors (K, 3)."""
    return np.einsum("kij,ki->kj", rotation, vector)


def _velocity(before: Array, after: Array, point: Array, dt: float) -> Array:
    """Return the velocity (K, 3) of points on tips that moved between two poses (K, 4, 4)."""
    turned = after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], -1, -2)
    angular = log_so3(turned) / dt
    linear = (after[:, :3, 3] - before[:, :3, 3]) / dt
    return np.asarray(linear + cross(angular, point - after[:, :3, 3]))


def _tangential(velocity: Array, outward: Array) -> Array:
    """Return the speed (K,) of velocities (K, 3) across the directions ``outward`` (K, 3)."""
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    normal = outward / np.maximum(length, 1e-9)
    along = np.sum(velocity * normal, axis=1, keepdims=True) * normal
    return np.asarray(np.linalg.norm(velocity - along, axis=1))
