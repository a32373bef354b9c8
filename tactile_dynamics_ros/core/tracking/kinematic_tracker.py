"""Track a grasped object by the hand's joints: it rolls on the fingertips that hold it.

After one pose from vision, every step of the joints moves the points of the skin that touch now,
and the object moves so that its surface goes with them. Where on the skin that is, the fingertips
tell; a point that is fixed for good, as in relaxed rigidity, would not see the object roll. A
contact is a patch that resists being turned, so two fingers, or one, are enough.

Source: paper A, Sec. IV (tracking by relaxed rigidity) and its reference 32; rolling contact after
Montana 1988 (velocities of both surfaces agree at the contact).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import align_points, log_so3, skew, twice
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics, JointUncertaintyConfig

SETTLED_POSITION = 0.05
"""Standard deviation, m, beyond which no first pose is uncertain about where the object lies: it is
in the hand. It only replaces what the covariance leaves open; any value far above vision's
millimetres has the same effect."""
_PATCH = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
"""Points of a contact's patch in units of its size: its middle and six around it, so that it
resists turns about all axes alike. Fewer points leave a turn free, more cost time; their weights,
not their places, set how stiff a patch is."""


@dataclass(frozen=True)
class KinematicTrackerConfig:
    """How the fingertips hold the object."""

    patch: float = parameter(2e-3, "radius of a contact that resists being turned", "m", 1e-5, 0.02)
    give_position: float = parameter(1e-4, "give of the skin", "m", 0.0, 0.02)
    give_rotation_deg: float = parameter(0.1, "turn by the give of the skin", "deg", 0.0, 45.0)
    creep_position: float = parameter(1e-4, "slow slip in the hand", "m/sqrt(s)", 0.0, 0.1)
    creep_rotation_deg: float = parameter(0.4, "slow turn in the hand", "deg/sqrt(s)", 0.0, 10.0)
    vision_position_std: float = parameter(1e-3, "initial position if not stated", "m", 0.0, 0.1)
    vision_rotation_std_deg: float = parameter(0.5, "initial rotation if not stated", "deg", 0, 45)
    settled_rotation_deg: float = parameter(
        2.0, "turns that vision leaves open are a convention, known so well", "deg", 0.01, 180.0
    )
    joints: JointUncertaintyConfig = field(default_factory=JointUncertaintyConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


class KinematicTracker:
    """Pose of a grasped object from joint positions and contact points, with covariance.

    Args:
        kinematics: kinematic model of arm and hand.
        config: compliances and joint uncertainty.
    """

    def __init__(
        self, kinematics: HandKinematics, config: KinematicTrackerConfig | None = None
    ) -> None:
        self.kinematics = kinematics
        self.config = config or KinematicTrackerConfig()
        joints = self.config.joints
        self._constant_variance = joints.constant_variance(kinematics.robot)
        self._varying_variance = joints.varying_variance(kinematics.robot)
        self._grasp: _Grasp | None = None

    @property
    def anchor(self) -> str:
        """Finger whose sensor frame holds the object where no contact poses come.

        It is the one that opposes all others, so that every grasp has it.
        """
        return self.kinematics.robot.reference

    @property
    def initialised(self) -> bool:
        """Whether a pose to start from is known."""
        return self._grasp is not None

    def initialise(
        self,
        pose: Array,
        joint_positions: Array,
        covariance: Array | None = None,
        time: float | None = None,
    ) -> None:
        """Take the object's pose at these joint positions as the start.

        Args:
            pose: (4, 4) X_WO.
            joint_positions: (J,) rad.
            covariance: (6, 6) covariance of the pose [rotation, position], world axes. What it
                leaves open, a turn that no camera sees, is settled by this pose, to
                ``settled_rotation_deg``.
            time: s; the creep of the grasp counts from here (first update if None).

        Raises:
            BadInputError: the pose is not a rigid transform.
        """
        pose = np.array(pose, dtype=float)
        if pose.shape != (4, 4) or not np.allclose(
            pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-4
        ):
            raise BadInputError("initial object pose: expected a rigid transform (4, 4)")
        if covariance is None:
            covariance = self.vision_covariance()
        settled = _diagonal(np.deg2rad(self.config.settled_rotation_deg), SETTLED_POSITION)
        covariance = np.linalg.inv(np.linalg.inv(covariance) + np.linalg.inv(settled))
        self._grasp = _Grasp(self.kinematics, pose, joint_positions, covariance, time)

    def vision_covariance(self) -> Array:
        """Return the covariance (6, 6) taken for a pose from vision that states none."""
        turn = np.deg2rad(self.config.vision_rotation_std_deg)
        return _diagonal(turn, self.config.vision_position_std)

    def reset(self) -> None:
        """Forget the object."""
        self._grasp = None

    def update(
        self, joint_positions: Array, time: float, contacts: Mapping[str, ArrayLike] | None = None
    ) -> tuple[Array, Array]:
        """Return the object's pose at new joint positions.

        Args:
            joint_positions: (J,) rad.
            time: s.
            contacts: (3,) points of the skin that touch the object now, sensor frames, m, by
                finger; the anchor's sensor frame holds the object where there is none.

        Returns:
            X_WO (4, 4) and its covariance (6, 6) [rotation, position], world axes.

        Raises:
            NotIdentifiableError: no initial pose was given.
        """
        if self._grasp is None:
            raise NotIdentifiableError(
                "kinematic tracker has no initial object pose; send one on /object/pose/vision"
            )
        grasp, config = self._grasp, self.config
        hold = grasp.roll(joint_positions, contacts or {self.anchor: np.zeros(3)}, config.patch)
        constant, varying = grasp.sensitivities(joint_positions, hold)
        covariance = (constant * self._constant_variance) @ constant.T
        covariance += (varying * self._varying_variance) @ varying.T
        covariance += grasp.initial_covariance() + self._give(grasp.age(time))
        return grasp.pose.copy(), covariance

    def _give(self, age: float) -> Array:
        config, root = self.config, np.sqrt(max(age, 0.0))
        give = _diagonal(np.deg2rad(config.give_rotation_deg), config.give_position)
        rotation = np.deg2rad(config.creep_rotation_deg)
        return give + _diagonal(rotation * root, config.creep_position * root)


@dataclass(frozen=True)
class _Hold:
    """Least squares by which the motions of K contacts make the object's.

    Attributes:
        index: numbers of the fingers. share: (K, 6, 6) share of each one's motion [rotation,
            position].
    """

    index: list[int]
    share: Array


class _Grasp:
    """The object in the hand: where it is, and what was known when tracking began."""

    def __init__(
        self,
        kinematics: HandKinematics,
        pose: Array,
        positions: Array,
        covariance: Array,
        time: float | None,
    ) -> None:
        self.pose = pose
        self._kinematics = kinematics
        self._first = pose
        self._covariance = covariance
        self._start = time
        self._sensors = kinematics.locate(np.asarray(positions, dtype=float)).sensors.copy()
        self._jacobians = self._tip_jacobians(positions, self._sensors)

    def age(self, time: float) -> float:
        """Return the time since tracking began."""
        if self._start is None:
            self._start = time
        return time - self._start

    def roll(self, positions: Array, contacts: Mapping[str, ArrayLike], patch: float) -> _Hold:
        """Move the object with the points of the skin that hold it.

        The rigid motion is that which fits the motions of all contacts best, each a patch: its
        middle and six points around it. For small motions v, w of the object and v_k, w_k of the
        contacts at r_k that is min sum_k |v + w x r_k - v_k|^2 + 2/7 patch^2 |w - w_k|^2.
        """
        sensors = self._kinematics.locate(positions).sensors.copy()
        index = [self._kinematics.robot.finger_index(finger) for finger in contacts]
        points = np.array(list(contacts.values()), dtype=float)[:, None] + patch * _PATCH
        before, after = _place(self._sensors[index], points), _place(sensors[index], points)
        turn, shift = align_points(before.reshape(-1, 3), after.reshape(-1, 3))
        self._sensors = sensors
        self.pose = np.array(self.pose)
        self.pose[:3, :3] = turn @ self.pose[:3, :3]
        self.pose[:3, 3] = turn @ self.pose[:3, 3] + shift
        design = np.tile(np.eye(6), (len(index), 1, 1))
        design[:, 3:, :3] = -skew(after.mean(axis=1) - self.pose[:3, 3])
        weighted = np.swapaxes(design, 1, 2) * ([2.0 / 7.0 * patch**2] * 3 + [1.0] * 3)
        return _Hold(index, np.linalg.solve(np.sum(weighted @ design, axis=0), weighted))

    def initial_covariance(self) -> Array:
        """Return the covariance of the initial pose carried along to the pose of now."""
        turn = twice(self._turn())
        return np.asarray(turn @ self._covariance @ turn.T)

    def sensitivities(self, positions: Array, hold: _Hold) -> tuple[Array, Array]:
        """Return the pose's derivatives (6, J) by constant and by varying errors of joints.

        A joint error that was there at the start acts only by how far its effect has changed.
        """
        jacobians = self._tip_jacobians(positions, self._sensors)[hold.index]
        carried = twice(self._turn()) @ self._jacobians[hold.index]
        constant = np.einsum("kij,kjn->in", hold.share, jacobians - carried)
        return constant, np.einsum("kij,kjn->in", hold.share, jacobians)

    def _turn(self) -> Array:
        return np.asarray(self.pose[:3, :3] @ self._first[:3, :3].T)

    def _tip_jacobians(self, positions: Array, sensors: Array) -> Array:
        return self._kinematics.jacobian(self._kinematics.fingers, positions, sensors[:, :3, 3])


def _place(poses: Array, points: Array) -> Array:
    """Return points (K, N, 3) of K frames in the world."""
    return np.asarray(points @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3])


def _diagonal(rotation_std: float, position_std: float) -> Array:
    return np.diag([rotation_std**2] * 3 + [position_std**2] * 3)


def pose_error(estimate: Array, truth: Array) -> Array:
    """Return the error (6,) [rotation, position] of a pose, world axes, rad and m."""
    rotation = log_so3(estimate[:3, :3] @ truth[:3, :3].T)
    return np.concatenate([rotation, estimate[:3, 3] - truth[:3, 3]])
