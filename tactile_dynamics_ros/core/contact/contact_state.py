"""Contacts from what robots know: fingertips by joints and force, tips by an outline."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import cross, skew
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics, JointUncertaintyConfig
from tactile_dynamics_ros.core.shape.skin_surface import (
    point_from_wrench,
    point_under_force,
    skin_normal,
)


@dataclass(frozen=True)
class ContactStateConfig:
    """Uncertainty of a contact's place and frame."""

    point_std: float = parameter(1e-3, "contact place on the skin", "m", 0.0, 0.02)
    mount_std_deg: float = parameter(0.5, "mounting of a tip on its finger", "deg", 0.0, 20.0)
    touch_force: float = parameter(0.03, "force below which nothing is touched", "N", 0.0, 5.0)
    joints: JointUncertaintyConfig = field(default_factory=JointUncertaintyConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Contact:
    """One finger's contact in the world.

    Attributes:
        finger: its name.
        point: (3,) m. rotation: (3, 3) R_WC, column z is the normal into the object.
        force: (3,) N that the finger applies on the object.
        torque: (3,) N m about the point; zero for fingertips whose contacts carry none.
        force_std: (3,) N per world axis, including the uncertainty of the sensor's orientation.
        force_covariance: (3, 3) N^2. point_covariance: (3, 3) m^2.
        touching: whether the force exceeds the touch threshold.
    """

    finger: str
    point: Array
    rotation: Array
    force: Array
    torque: Array
    force_std: Array
    force_covariance: Array
    point_covariance: Array
    touching: bool


class ContactState:
    """Place fingertip forces in the world.

    Args:
        kinematics: kinematic model of arm and hand.
        config: uncertainties.
    """

    def __init__(
        self, kinematics: HandKinematics, config: ContactStateConfig | None = None
    ) -> None:
        self.kinematics = kinematics
        self.config = config or ContactStateConfig()
        robot, joints = kinematics.robot, self.config.joints
        self._joint_variance = joints.varying_variance(robot)
        self._joint_variance += joints.constant_variance(robot)

    def update(
        self,
        finger: str,
        joint_positions: Array,
        force: Array,
        force_std: Array,
        torque: Array | None = None,
    ) -> Contact:
        """Return the contact of one finger: `update_all` of one.

        Args:
            finger: name.
            joint_positions: (J,) rad.
            force: (3,) N.
            force_std: (3,) N.
            torque: (3,) N m, or None if it is not known.

        Raises:
            BadInputError: a value is not finite.
        """
        turning = np.zeros(3) if torque is None else torque
        rows = [
            np.asarray(v, dtype=float)[None] for v in (joint_positions, force, force_std, turning)
        ]
        return self.update_all([finger], *rows)[0]

    def update_all(
        self,
        fingers: Sequence[str],
        joint_positions: Array,
        force: Array,
        force_std: Array,
        torque: Array,
    ) -> list[Contact]:
        """Return K contacts.

        f_W = R_WS f_S; cov = R diag(std^2) R^T + [f]x cov(rotation) [f]x^T.

        Args:
            fingers: K names.
            joint_positions: (K, J) rad, arm then hand.
            force: (K, 3) on the object, sensor frame, N.
            force_std: (K, 3) N, sensor frame.
            torque: (K, 3) N m of that force about the sensor origin, which tells where on a
                round skin the contact is; where it is zero the contact is where the normal is
                along the force. A flat face transmits it.

        Raises:
            BadInputError: a value is not finite.
        """
        for name, value in (("force", force), ("force_std", force_std), ("torque", torque)):
            _check(name, value, len(fingers))
        pose = self.kinematics.sensor_pose(fingers, joint_positions)
        rotation = pose[:, :3, :3]
        place, frames = self._places(force, torque)
        point = _turn(rotation, place) + pose[:, :3, 3]
        jacobian = self.kinematics.jacobian(fingers, joint_positions, point)
        frame = (jacobian * self._joint_variance) @ np.swapaxes(jacobian, -1, -2)
        frame[:, :3, :3] += np.deg2rad(self.config.mount_std_deg) ** 2 * np.eye(3)
        frame[:, 3:, 3:] += self.config.point_std**2 * np.eye(3)
        world_force = _turn(rotation, force)
        lever = skew(world_force)
        covariance = (rotation * force_std[:, None] ** 2) @ np.swapaxes(rotation, -1, -2)
        covariance += lever @ frame[:, :3, :3] @ np.swapaxes(lever, -1, -2)
        std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        axes = rotation @ frames
        turning = np.zeros_like(force)
        if self.kinematics.robot.tips.carries_torque:
            turning = _turn(rotation, torque)
        touching = np.linalg.norm(force, axis=-1) > self.config.touch_force
        places = frame[:, 3:, 3:]
        columns = (fingers, point, axes, world_force, turning, std, covariance, places)
        rows = zip(*columns, touching.tolist(), strict=True)
        return [Contact(*row) for row in rows]

    def _places(self, force: Array, torque: Array) -> tuple[Array, Array]:
        """Return contact points (K, 3) and frames R_SC (K, 3, 3) in the sensor frames.

        A flat face that carries torque is touched at its middle, whose frame is the sensor's; on
        a round skin the wrench tells where.
        """
        tips = self.kinematics.robot.tips
        if tips.carries_torque:
            return np.zeros_like(force), np.broadcast_to(np.eye(3), (len(force), 3, 3))
        known = torque.any(axis=-1, keepdims=True)
        found = point_from_wrench(force, torque, tips.radius)
        place = np.where(known, found, point_under_force(force, tips.radius))
        return place, _contact_frame(place)


def _turn(rotation: Array, vector: Array) -> Array:
    return np.asarray((rotation @ vector[..., None])[..., 0])


def _contact_frame(place: Array) -> Array:
    """Return R_SC (K, 3, 3) at skin points: z outward (into the object), x nearly along x."""
    normal = skin_normal(place)
    lengthwise = np.where(np.abs(normal[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    x = lengthwise - np.sum(lengthwise * normal, axis=-1, keepdims=True) * normal
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, cross(normal, x), normal], axis=-1)


def _check(name: str, value: Array, count: int) -> None:
    if value.shape != (count, 3) or not math.isfinite(value.sum()):
        raise BadInputError(f"{name} = {value.tolist()}: expected three finite numbers each")


@dataclass(frozen=True)
class OutlineContactConfig:
    """What tells whether and where an outline is touched."""

    touch_force: float = parameter(0.15, "force below which nothing is touched", "N", 0.0, 5.0)
    tip_radius: float = parameter(0.006, "of a round tip", "m", 0.0, 0.1)
    reach: float = parameter(
        0.02, "a tip further than this from every outline touches something else", "m", 0.0, 1.0
    )

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class OutlineContact:
    """A contact on the side of an object.

    Attributes:
        point: (2,) m, on the outline. normal: (2,) unit vector into the object.
        gap: m, from the middle of the tip to the outline; negative inside.
    """

    point: Array
    normal: Array
    gap: float


def nearest_side(place: Array, outlines: Sequence[Array]) -> OutlineContact:
    """Return the place on outlines that is nearest to a point, with the normal there.

    Outside a corner the normal points from the place to the corner: a round tip rolls about it.

    Args:
        place: (2,) m, middle of the tip.
        outlines: (V, 2) m each, anticlockwise, in the same frame.
    """
    found = [_nearest(place, outline) for outline in outlines]
    return min(found, key=lambda contact: contact.gap)


def _nearest(place: Array, outline: Array) -> OutlineContact:
    edge = np.roll(outline, -1, axis=0) - outline
    away = place - outline
    length = np.maximum(np.sum(edge**2, axis=1), 1e-18)
    share = np.clip(np.sum(away * edge, axis=1) / length, 0.0, 1.0)
    gap = away - share[:, None] * edge
    k = int(np.sum(gap**2, axis=1).argmin())
    offset, along = gap[k], edge[k] / np.sqrt(length[k])
    distance = float(np.linalg.norm(offset))
    inside = along[0] * offset[1] - along[1] * offset[0] > 0.0
    if distance < 1e-9:
        return OutlineContact(place - offset, np.array([-along[1], along[0]]), 0.0)
    signed = -distance if inside else distance
    return OutlineContact(place - offset, -offset / signed, signed)
