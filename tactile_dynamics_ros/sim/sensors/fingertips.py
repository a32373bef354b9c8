"""The hand's BioTacs in a simulated world: contacts in, one image of raw counts out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import cross, log_so3
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig

Array = NDArray[np.float64]


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
