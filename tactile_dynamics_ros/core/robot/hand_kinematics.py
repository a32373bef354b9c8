"""Kinematics of an arm and its fingers, and how far joint positions can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import cross, skew
from tactile_dynamics_ros.core.robot.kinematic_tree import chain
from tactile_dynamics_ros.core.robot.robot import Joint, Robot, column
from tactile_dynamics_ros.core.robot.robot_file import load_robot


@dataclass(frozen=True)
class HandConfiguration:
    """Where everything is at one vector of joint positions (or at many).

    Attributes:
        palm: (..., 4, 4) X_WP, pose of the palm.
        sensors: (..., F, 4, 4) X_WS of the fingers' sensor frames, in the robot's order.
        axes: (..., J, 3) joint axes in the world.
        centres: (..., J, 3) a point on each joint axis in the world, m.
        frames: (..., J, 4, 4) pose of the link that each joint moves, in the world.
    """

    palm: Array
    sensors: Array
    axes: Array
    centres: Array
    frames: Array


class HandKinematics:
    """Kinematics of a robot: X_WS(q) and its Jacobians, vectorised over samples.

    Joints may turn or slide; fingers may have different numbers of joints.

    Args:
        robot: arm and hand; a KUKA iiwa with a right Allegro hand if None.
        base_pose: (4, 4) X_WB of the arm's base in the world; identity if None.

    Attributes:
        robot: as given. joint_names: J joints, arm first. fingers: names of the F fingers.
        base: X_WB. moving: (F, J) 1 for the joints that move a finger.
    """

    def __init__(self, robot: Robot | None = None, base_pose: Array | None = None) -> None:
        self.robot = robot = robot or load_robot()
        self.joint_names, self.fingers = robot.joint_names, robot.fingers
        self.base = np.eye(4) if base_pose is None else np.asarray(base_pose, dtype=float)
        arm, self._palm_fixed = _merge_fixed(chain(robot.tree, robot.base, robot.palm))
        merged = [_merge_fixed(chain(robot.tree, robot.palm, f.sensor)) for f in robot.hand]
        self._sensor_fixed = np.stack([end for _, end in merged])
        fixed = [*arm, *(step for steps, _ in merged for step in steps)]
        self._fixed = np.array(fixed).reshape(-1, 4, 4)
        self._axes = np.array([joint.axis for joint in robot.joints], dtype=float)
        self._slides = np.array([joint.slides for joint in robot.joints])
        self._sliding = bool(self._slides.any())
        self._cross = skew(np.where(self._slides[:, None], 0.0, self._axes))
        self._cross_square = self._cross @ self._cross
        self._travel = np.einsum("kij,kj->ki", self._fixed[:, :3, :3], self._axes)
        self._travel *= self._slides[:, None]
        self._steps = _step_table(robot)
        self.moving = np.zeros((len(self.fingers), robot.dof))
        self.moving[:, : robot.arm_dof] = 1.0
        for row, own in enumerate(robot.owned.values()):
            self.moving[row, own] = 1.0
        self._last: tuple[Array, HandConfiguration] | None = None

    def locate(self, positions: Array) -> HandConfiguration:
        """Return palm, sensor frames and joint axes in the world.

        Args:
            positions: (..., J) joint positions in the order of ``joint_names``, rad or m.

        Raises:
            BadInputError: the last dimension is not J.
        """
        positions = np.asarray(positions, dtype=float)
        if self._last is not None and np.array_equal(self._last[0], positions):
            return self._last[1]
        robot = self.robot
        if positions.shape[-1] != robot.dof:
            raise BadInputError(
                f"joint positions: {positions.shape[-1]} values, expected {robot.dof} "
                f"({robot.arm_dof} arm joints, then those of {', '.join(self.fingers)})"
            )
        configuration = self._propagate(self._joint_transforms(positions))
        self._last = (positions.copy(), configuration)
        return configuration

    def sensor_pose(self, finger: str | Sequence[str], positions: Array) -> Array:
        """Return X_WS (..., 4, 4), the pose of a finger's sensor frame in the world.

        Args:
            finger: name of the finger, or one name for each of K samples.
            positions: (..., J) rad, (K, J) for K names.
        """
        sensors = self.locate(positions).sensors
        if isinstance(finger, str):
            return np.asarray(sensors[..., self.robot.finger_index(finger), :, :])
        return np.asarray(sensors[np.arange(len(finger)), self._rows(finger)])

    def in_sensor_frame(self, finger: str, positions: Array, point: Array) -> Array:
        """Return a point (3,) of the world in a finger's sensor frame, m."""
        pose = self.sensor_pose(finger, positions)
        return np.asarray((point - pose[:3, 3]) @ pose[:3, :3])

    def jacobian(self, finger: str | Sequence[str], positions: Array, point: Array) -> Array:
        """Return the Jacobian of a point that moves with a finger's sensor frame.

        V = J dq, V = [angular velocity, velocity of the point], world axes.

        Args:
            finger: name of the finger, or one name for each sample.
            positions: (..., J) rad.
            point: (..., 3) the point in the world, m.

        Returns:
            (..., 6, J).
        """
        where = self.locate(positions)
        axes = where.axes * self.moving[self._rows(finger), :, None]
        turning = np.where(self._slides[:, None], 0.0, axes) if self._sliding else axes
        arm = np.asarray(point, dtype=float)[..., None, :] - where.centres
        shift = cross(turning, arm)
        if self._sliding:
            shift = np.where(self._slides[:, None], axes, shift)
        return np.swapaxes(np.concatenate([turning, shift], axis=-1), -1, -2)

    def own_jacobian(self, finger: str, positions: Array, point: Array) -> Array:
        """Return the derivative (3, K) of a point (3,) of a finger's tip by the finger's joints."""
        return np.asarray(self.jacobian(finger, positions, point)[3:, self.robot.owned[finger]])

    def palm_jacobian(self, positions: Array, point: Array) -> Array:
        """Return the Jacobian (6, A) of a point (3,) that moves with the palm, by the arm's joints.

        V = J dq, V = [angular velocity, velocity of the point], world axes.
        """
        count = self.robot.arm_dof
        where, slides = self.locate(positions), self._slides[:count, None]
        axes = where.axes[:count]
        turning = np.where(slides, 0.0, axes)
        shift = np.where(slides, axes, cross(turning, point - where.centres[:count]))
        return np.concatenate([turning, shift], axis=1).T

    def order(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Return indices that sort positions given by ``names`` into ``joint_names``.

        Raises:
            BadInputError: a joint is missing.
        """
        place = {name: k for k, name in enumerate(names)}
        missing = [name for name in self.joint_names if name not in place]
        if missing:
            raise BadInputError(
                f"joint states lack {len(missing)} of {self.robot.dof} joints (first: "
                f"{missing[0]}); publish arm and hand together on /joint_states"
            )
        return np.array([place[name] for name in self.joint_names])

    def _rows(self, finger: str | Sequence[str]) -> int | list[int]:
        find = self.robot.finger_index
        return find(finger) if isinstance(finger, str) else [*map(find, finger)]

    def _joint_transforms(self, positions: Array) -> Array:
        """Return X of every joint's child in its predecessor, (..., J, 4, 4)."""
        sine = np.sin(positions)[..., None, None]
        versine = 1.0 - np.cos(positions)[..., None, None]
        rotation = np.eye(3) + sine * self._cross + versine * self._cross_square
        transforms = np.zeros((*positions.shape, 4, 4))
        transforms[..., :3, :3] = self._fixed[:, :3, :3] @ rotation
        transforms[..., :, 3] = self._fixed[:, :, 3]
        if self._sliding:
            transforms[..., :3, 3] += positions[..., None] * self._travel
        return transforms

    def _propagate(self, transforms: Array) -> HandConfiguration:
        lead, count = transforms.shape[:-3], self.robot.arm_dof
        frames = np.empty((*lead, self.robot.dof, 4, 4))
        frame = np.broadcast_to(self.base, (*lead, 4, 4))
        for k in range(count):
            frame = frame @ transforms[..., k, :, :]
            frames[..., k, :, :] = frame
        palm = frame @ self._palm_fixed
        tips = np.empty((*lead, len(self.fingers), 4, 4))
        tips[...] = palm[..., None, :, :]
        for rows, joints in self._steps:
            moved = tips[..., rows, :, :] @ transforms[..., joints, :, :]
            tips[..., rows, :, :] = frames[..., joints, :, :] = moved
        axes = np.einsum("...kij,kj->...ki", frames[..., :3, :3], self._axes)
        sensors = tips @ self._sensor_fixed
        return HandConfiguration(palm, sensors, axes, frames[..., :3, 3], frames)


def _step_table(robot: Robot) -> list[tuple[slice | list[int], slice | list[int]]]:
    """Return, for each step from the palm outward, the fingers that have such a joint and it."""
    starts = [own.start for own in robot.owned.values()]
    lengths = [len(finger.joints) for finger in robot.hand]
    if len(set(lengths)) == 1:
        first, stride = robot.arm_dof, lengths[0]
        return [(slice(None), slice(first + k, None, stride)) for k in range(stride)]
    table: list[tuple[slice | list[int], slice | list[int]]] = []
    for k in range(max(lengths)):
        rows = [row for row, length in enumerate(lengths) if length > k]
        table.append((rows, [starts[row] + k for row in rows]))
    return table


def _merge_fixed(joints: Sequence[Joint]) -> tuple[list[Array], Array]:
    """Return the transform (4, 4) before each moving joint, and what follows the last one."""
    fixed, pending = [], np.eye(4)
    for joint in joints:
        pending = pending @ joint.origin
        if joint.axis is not None:
            fixed.append(pending)
            pending = np.eye(4)
    return fixed, pending


@dataclass(frozen=True)
class JointUncertaintyConfig:
    """Standard deviations of what makes a joint position wrong.

    Source: Allegro encoders 2e-4 rad; offset 0.5 to 1 deg and backlash 0.3 to 0.5 deg as
    delivered, the defaults hold for a calibrated hand that keeps its load direction; iiwa
    encoders 1e-5 rad, repeatability 0.1 to 0.15 mm. A joint that slides, of arm or
    hand, has numbers of its own: jaws of grippers repeat to 0.1 mm.
    """

    hand_noise: float = parameter(2e-4, "encoder noise of a hand joint", "rad", 0.0, 0.1)
    hand_offset: float = parameter(0.0035, "calibration offset of a hand joint", "rad", 0.0, 0.2)
    hand_backlash: float = parameter(5e-4, "play of a hand joint under load", "rad", 0.0, 0.1)
    arm_noise: float = parameter(1e-5, "encoder noise of an arm joint", "rad", 0.0, 0.1)
    arm_offset: float = parameter(1e-4, "calibration offset of an arm joint", "rad", 0.0, 0.1)
    slide_noise: float = parameter(1e-5, "encoder noise of a joint that slides", "m", 0.0, 0.01)
    slide_offset: float = parameter(2e-4, "offset and play of a joint that slides", "m", 0.0, 0.05)

    def __post_init__(self) -> None:
        check_ranges(self)

    def varying_variance(self, robot: Robot) -> Array:
        """Return the variance (J,) of what changes from reading to reading, rad^2 or m^2."""
        hand = self.hand_noise**2 + self.hand_backlash**2
        return _per_joint(robot, self.arm_noise**2, hand, self.slide_noise**2)

    def constant_variance(self, robot: Robot) -> Array:
        """Return the variance (J,) of what stays the same during a run, rad^2 or m^2."""
        return _per_joint(robot, self.arm_offset**2, self.hand_offset**2, self.slide_offset**2)


def _per_joint(robot: Robot, arm: float, hand: float, slide: float) -> Array:
    turning = np.where(np.arange(robot.dof) < robot.arm_dof, arm, hand)
    return np.where(column(robot.joints, "slides") > 0.0, slide, turning)


_STILL = 0.005
"""Joint motion, rad (m where joints slide), up to which a robot stands still: 4 mm of a fingertip
0.8 m from the joint, a third of the motion of the object that ends a probe. Less takes noise and
the settling of drives for motion, more takes a slow motion for rest."""


class Standstill:
    """Follows joint positions, and says since when none has moved by more than 0.005 rad.

    Attributes:
        since: s, stamp since which the robot stands still; infinity before the first positions.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Know nothing."""
        self._place: Array | None = None
        self.since = np.inf

    def update(self, time: float, positions: Array) -> None:
        """Take positions (J,) at a time, s, not decreasing."""
        if self._place is None or np.max(np.abs(positions - self._place)) > _STILL:
            self._place, self.since = np.array(positions), time
