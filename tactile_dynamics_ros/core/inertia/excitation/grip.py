"""How a grasp shares the wrench that a motion needs, and how near it comes to slipping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.inertia.excitation.trajectory import ObjectMotion
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = NDArray[np.float64]

_HELD_PERCENTILE = 99.5
"""Percentile of the sliding ratios of all samples that the grip has shown to hold: the largest but
for one in 200, which may be noise of a single sample. At 100 one outlier would promise any
friction; at 90 motions become smaller than those that were held."""


@dataclass(frozen=True)
class Grip:
    """Contacts that hold the object, fixed in the body frame.

    Attributes:
        names: names of the C contacts.
        point: (C, 3) m; normal: (C, 3) unit, into the object.
        squeeze: (C, 3) N, forces that the contacts apply on the weightless object at rest.
        friction: coefficient.
    """

    names: tuple[str, ...]
    point: Array
    normal: Array
    squeeze: Array
    friction: float

    @classmethod
    def from_samples(cls, samples: WrenchSamples, phi: Array, friction: float) -> Grip:
        """Read the grip from measured contacts: what they apply beyond carrying the object.

        Args:
            samples: samples of the held object; the mean over samples in contact is taken.
            phi: (10,) dynamic parameters.
            friction: coefficient; raised to what the samples show to hold.
        """
        count = np.maximum(samples.in_contact.sum(axis=0), 1)[:, None]
        held = np.flatnonzero(samples.in_contact.mean(axis=0) > 0.5)
        point = (samples.contact_point.sum(axis=0) / count)[held]
        normal = samples.contact_rotation[..., 2].mean(axis=0)[held]
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        names = tuple(samples.contact_names[k] for k in held)
        loose = cls(names, point, normal, np.zeros_like(point), friction)
        matrix = regressor(
            samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
        )
        carried = loose.share(matrix @ phi)
        squeeze = (samples.contact_force[:, held] - carried).mean(axis=0)
        shown = float(np.percentile(_sliding_ratio(squeeze + carried, normal), _HELD_PERCENTILE))
        return cls(names, point, normal, squeeze, max(friction, shown))

    def share(self, wrench: Array) -> Array:
        """Smallest additional forces (N, C, 3) that apply wrenches (N, 6), beside the squeeze."""
        grasp = np.concatenate(
            [np.hstack(list(skew(self.point))), np.tile(np.eye(3), len(self.point))]
        )
        forces = np.asarray(wrench) @ np.linalg.pinv(grasp).T
        return np.asarray(self.squeeze + forces.reshape(len(wrench), -1, 3))

    def load(self, motion: ObjectMotion, phi: Array) -> WrenchSamples:
        """Samples of a motion with the forces that it needs for a body (10,)."""
        matrix = regressor(
            motion.specific_acceleration, motion.angular_velocity, motion.angular_acceleration
        )
        force = self.share(matrix @ phi)
        shape = (len(motion.time), len(self.names))
        return WrenchSamples(
            time=motion.time,
            position=motion.position,
            rotation=motion.rotation,
            velocity=motion.velocity,
            acceleration=motion.acceleration,
            angular_velocity=motion.angular_velocity,
            angular_acceleration=motion.angular_acceleration,
            contact_names=self.names,
            contact_point=np.broadcast_to(self.point, (*shape, 3)),
            contact_rotation=np.broadcast_to(_frames(self.normal), (*shape, 3, 3)),
            contact_force=force,
            contact_torque=np.zeros((*shape, 3)),
            in_contact=np.ones(shape, dtype=bool),
            gravity=GRAVITY_W,
        )

    def usage(self, samples: WrenchSamples) -> float:
        """Largest share of the friction cone in use; above 1 a finger slips."""
        return float(np.max(_sliding_ratio(samples.contact_force, self.normal)) / self.friction)


def _sliding_ratio(force: Array, normal: Array) -> Array:
    """Tangential over normal force, (N, C)."""
    pressing = np.sum(force * normal, axis=-1)
    sliding = np.linalg.norm(force - pressing[..., None] * normal, axis=-1)
    return np.asarray(sliding / np.maximum(pressing, 1e-6))


def _frames(normal: Array) -> Array:
    """Rotations (C, 3, 3) whose z axes are the normals."""
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x_axis = np.cross(helper, normal)
    x_axis /= np.linalg.norm(x_axis, axis=1, keepdims=True)
    return np.stack([x_axis, np.cross(normal, x_axis), normal], axis=2)
