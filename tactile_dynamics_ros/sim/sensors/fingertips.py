"""The hand's four BioTacs in a simulated world: contacts in, one image of raw counts out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.robot_description import FINGERS
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
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
    """BioTacs of index, middle, ring and thumb.

    Args:
        config: of the sensors.
        seed: of the noise.
        unit_seed: of the units' constants: the same hand has the same fingertips.
    """

    def __init__(
        self, config: BioTacConfig | None = None, seed: int = 0, unit_seed: int = 0
    ) -> None:
        self.array = BioTacArray(len(FINGERS), config, seed, unit_seed)
        self._last: Array | None = None

    def read(
        self,
        contacts: Mapping[str, TipContact],
        poses: Array,
        object_pose: Array,
        object_twist: tuple[Array, Array],
        dt: float = 0.01,
    ) -> NDArray[np.uint16]:
        """Return raw counts (4, 44) in the order index, middle, ring, thumb.

        Args:
            contacts: by finger; forces on the object, world axes.
            poses: (4, 4, 4) true X_WS of the sensor frames.
            object_pose: (4, 4) true X_WO.
            object_twist: angular velocity and velocity of the object's origin, world axes.
            dt: time since the last reading, s.
        """
        force, point = np.zeros((4, 3)), np.zeros((4, 3))
        slip = np.zeros(4)
        for k, finger in enumerate(FINGERS):
            contact = contacts.get(finger)
            if contact is None or not contact.in_contact:
                continue
            rotation = poses[k, :3, :3]
            force[k] = contact.force @ rotation
            point[k] = (contact.point - poses[k, :3, 3]) @ rotation
            slip[k] = self._slip_speed(k, contact.point, poses, object_pose, object_twist, dt)
        self._last = poses.copy()
        return self.array.measure(force, point, slip_speed=slip, dt=dt)

    def _slip_speed(
        self,
        k: int,
        point: Array,
        poses: Array,
        object_pose: Array,
        object_twist: tuple[Array, Array],
        dt: float,
    ) -> float:
        """Return the tangential speed of the object over the skin at a contact, m/s."""
        if self._last is None:
            return 0.0
        angular = log_so3(poses[k, :3, :3] @ self._last[k, :3, :3].T) / dt
        linear = (poses[k, :3, 3] - self._last[k, :3, 3]) / dt
        of_tip = linear + np.cross(angular, point - poses[k, :3, 3])
        of_object = object_twist[1] + np.cross(object_twist[0], point - object_pose[:3, 3])
        difference = of_object - of_tip
        outward = point - poses[k, :3, 3]
        outward /= max(float(np.linalg.norm(outward)), 1e-9)
        return float(np.linalg.norm(difference - (difference @ outward) * outward))
