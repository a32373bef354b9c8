"""Forward kinematics and Jacobians of the arm, the four fingers and their sensor frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import cross, skew
from tactile_dynamics_ros.core.robot.robot_description import (
    FINGERS,
    JOINT_NAMES,
    JOINTS,
    PALM_LINK,
    Joint,
    sensor_frame,
)

Array = NDArray[np.float64]

ARM_DOF = 7
"""Joints of the arm; they come first in all vectors of joints."""
FINGER_DOF = 4
"""Joints of one finger, from the palm to the tip."""
DOF = ARM_DOF + FINGER_DOF * len(FINGERS)
"""Joints of arm and hand."""

MOVING = np.hstack(
    [np.ones((len(FINGERS), ARM_DOF)), np.kron(np.eye(len(FINGERS)), np.ones(FINGER_DOF))]
)
"""(F, 23) 1 for the joints that move a finger."""


@dataclass(frozen=True)
class HandConfiguration:
    """Where everything is at one vector of joint positions (or at many).

    Attributes:
        palm: (..., 4, 4) X_WP, pose of the palm.
        sensors: (..., F, 4, 4) X_WS of the fingers' sensor frames, in the order of FINGERS.
        axes: (..., DOF, 3) joint axes in the world.
        centres: (..., DOF, 3) a point on each joint axis in the world, m.
        frames: (..., DOF, 4, 4) pose of the link that each joint moves, in the world.
    """

    palm: Array
    sensors: Array
    axes: Array
    centres: Array
    frames: Array


class HandKinematics:
    """Kinematics of the robot table: X_WS(q) and its Jacobians, vectorised over samples.

    Args:
        base_pose: (4, 4) X_WB of the arm's base in the world; identity if None.
    """

    joint_names = JOINT_NAMES
    fingers = FINGERS

    def __init__(self, base_pose: Array | None = None) -> None:
        chains = [_chain(sensor_frame(finger)) for finger in FINGERS]
        arm_fixed, arm_axes, palm_fixed = _merge_fixed(_chain(PALM_LINK))
        self._base = np.eye(4) if base_pose is None else np.asarray(base_pose, dtype=float)
        self._palm_fixed = palm_fixed
        trunk = len(_chain(PALM_LINK))
        merged = [_merge_fixed(chain[trunk:]) for chain in chains]
        self._sensor_fixed = np.stack([end for _, _, end in merged])
        finger_fixed = np.stack([fixed for fixed, _, _ in merged])
        finger_axes = np.stack([axes for _, axes, _ in merged])
        self._fixed = np.concatenate([arm_fixed, finger_fixed.reshape(-1, 4, 4)])
        self._axes = np.concatenate([arm_axes, finger_axes.reshape(-1, 3)])
        self._cross = skew(self._axes)
        self._cross_square = self._cross @ self._cross
        self._last: tuple[Array, HandConfiguration] | None = None

    def locate(self, positions: Array) -> HandConfiguration:
        """Return palm, sensor frames and joint axes in the world.

        Args:
            positions: (..., 23) joint positions in the order of ``joint_names``, rad.

        Raises:
            BadInputError: the last dimension is not 23.
        """
        positions = np.asarray(positions, dtype=float)
        if self._last is not None and np.array_equal(self._last[0], positions):
            return self._last[1]
        if positions.shape[-1] != DOF:
            raise BadInputError(
                f"joint positions: {positions.shape[-1]} values, expected {DOF} "
                "(7 arm joints, then 4 each of index, middle, ring, thumb)"
            )
        configuration = self._propagate(self._joint_transforms(positions))
        self._last = (positions.copy(), configuration)
        return configuration

    def sensor_pose(self, finger: str | Sequence[str], positions: Array) -> Array:
        """Return X_WS (..., 4, 4), the pose of a finger's sensor frame in the world.

        Args:
            finger: name of the finger, or one name for each of K samples.
            positions: (..., 23) rad, (K, 23) for K names.
        """
        sensors = self.locate(positions).sensors
        if isinstance(finger, str):
            return np.asarray(sensors[..., finger_index(finger), :, :])
        return np.asarray(sensors[np.arange(len(finger)), _rows(finger)])

    def in_sensor_frame(self, finger: str, positions: Array, point: Array) -> Array:
        """Return a point (3,) of the world in a finger's sensor frame, m."""
        pose = self.sensor_pose(finger, positions)
        return np.asarray((point - pose[:3, 3]) @ pose[:3, :3])

    def jacobian(self, finger: str | Sequence[str], positions: Array, point: Array) -> Array:
        """Return the Jacobian of a point that moves with a finger's sensor frame.

        V = J dq, V = [angular velocity, velocity of the point], world axes.

        Args:
            finger: name of the finger, or one name for each sample.
            positions: (..., 23) rad.
            point: (..., 3) the point in the world, m.

        Returns:
            (..., 6, 23).
        """
        where = self.locate(positions)
        axes = where.axes * MOVING[_rows(finger), :, None]
        arm = np.asarray(point, dtype=float)[..., None, :] - where.centres
        return np.swapaxes(np.concatenate([axes, cross(axes, arm)], axis=-1), -1, -2)

    def order(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Return indices that sort positions given by ``names`` into ``joint_names``.

        Raises:
            BadInputError: a joint is missing.
        """
        place = {name: k for k, name in enumerate(names)}
        missing = [name for name in self.joint_names if name not in place]
        if missing:
            raise BadInputError(
                f"joint states lack {len(missing)} of {DOF} joints (first: {missing[0]}); "
                "publish arm and hand together on /joint_states"
            )
        return np.array([place[name] for name in self.joint_names])

    def _joint_transforms(self, positions: Array) -> Array:
        """Return X of every joint's child in its predecessor, (..., 23, 4, 4)."""
        sine = np.sin(positions)[..., None, None]
        versine = 1.0 - np.cos(positions)[..., None, None]
        rotation = np.eye(3) + sine * self._cross + versine * self._cross_square
        transforms = np.zeros((*positions.shape, 4, 4))
        transforms[..., :3, :3] = self._fixed[:, :3, :3] @ rotation
        transforms[..., :, 3] = self._fixed[:, :, 3]
        return transforms

    def _propagate(self, transforms: Array) -> HandConfiguration:
        lead = transforms.shape[:-3]
        frames = np.empty((*lead, DOF, 4, 4))
        frame = np.broadcast_to(self._base, (*lead, 4, 4))
        for k in range(ARM_DOF):
            frame = frame @ transforms[..., k, :, :]
            frames[..., k, :, :] = frame
        palm = frame @ self._palm_fixed
        steps = transforms[..., ARM_DOF:, :, :].reshape(*lead, len(FINGERS), FINGER_DOF, 4, 4)
        fingers = frames[..., ARM_DOF:, :, :].reshape(*lead, len(FINGERS), FINGER_DOF, 4, 4)
        tips = palm[..., None, :, :]
        for k in range(FINGER_DOF):
            tips = tips @ steps[..., k, :, :]
            fingers[..., k, :, :] = tips
        frames[..., ARM_DOF:, :, :] = fingers.reshape(*lead, -1, 4, 4)
        axes = np.einsum("...kij,kj->...ki", frames[..., :3, :3], self._axes)
        sensors = tips @ self._sensor_fixed
        return HandConfiguration(palm, sensors, axes, frames[..., :3, 3], frames)


def _rows(finger: str | Sequence[str]) -> int | list[int]:
    return finger_index(finger) if isinstance(finger, str) else [*map(finger_index, finger)]


def finger_index(finger: str) -> int:
    """Return the row of a finger in FINGERS.

    Raises:
        BadInputError: there is no such finger.
    """
    if finger not in FINGERS:
        raise BadInputError(f"finger '{finger}': expected one of {', '.join(FINGERS)}")
    return FINGERS.index(finger)


def _chain(link: str) -> list[Joint]:
    """Return the joints from the base to a link."""
    by_child = {joint.child: joint for joint in JOINTS}
    chain: list[Joint] = []
    while link in by_child:
        chain.append(by_child[link])
        link = by_child[link].parent
    return chain[::-1]


def _merge_fixed(chain: Sequence[Joint]) -> tuple[Array, Array, Array]:
    """Return transforms before each moving joint (K, 4, 4), its axis (K, 3), and the last one."""
    fixed, axes, pending = [], [], np.eye(4)
    for joint in chain:
        pending = pending @ joint.origin()
        if joint.axis is not None:
            fixed.append(pending)
            axes.append(joint.axis)
            pending = np.eye(4)
    return np.array(fixed), np.array(axes, dtype=float), pending
