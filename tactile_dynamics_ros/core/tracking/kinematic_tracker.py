"""Track a grasped object by the hand's joints: rigid to the thumb, softly held by the others.

After one pose from vision the object moves with the thumb's frame; every other finger in contact
says where the point it holds has gone. All of these are predictions of one pose, with errors that
are correlated because they share joints; generalised least squares combines them and yields the
covariance.

Source: paper A, Sec. IV (tracking by relaxed rigidity) and its reference 32.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.hand_kinematics import (
    DOF,
    HandKinematics,
    finger_index,
)
from tactile_dynamics_ros.core.contact.joint_uncertainty import JointUncertaintyConfig
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3, skew, twice

Array = NDArray[np.float64]

ANCHOR = "thumb"
SETTLED_POSITION = 0.05


@dataclass(frozen=True)
class KinematicTrackerConfig:
    """How softly the fingertips hold the object."""

    thumb_rotation_std_deg: float = parameter(
        1.0, "roll of the object on the thumb", "deg", 0.0, 45
    )
    thumb_position_std: float = parameter(3e-4, "give of the thumb's skin", "m", 0.0, 0.02)
    finger_position_std: float = parameter(6e-4, "give and roll of another finger", "m", 0.0, 0.05)
    creep_position: float = parameter(4e-4, "slow slip in the hand", "m/sqrt(s)", 0.0, 0.1)
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
    """Pose of a grasped object from joint positions, with covariance.

    Args:
        kinematics: of arm and hand.
        config: compliances and joint uncertainty.
    """

    def __init__(
        self, kinematics: HandKinematics, config: KinematicTrackerConfig | None = None
    ) -> None:
        self.kinematics = kinematics
        self.config = config or KinematicTrackerConfig()
        self._grasp: _Grasp | None = None

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
            joint_positions: (23,) rad.
            covariance: (6, 6) of the pose [rotation, position], world axes. What it leaves open,
                a turn that no camera sees, is settled by this pose, to ``settled_rotation_deg``.
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
        self._grasp = _Grasp(self.kinematics, pose, joint_positions, np.array(covariance), time)

    def vision_covariance(self) -> Array:
        """Return the covariance (6, 6) taken for a pose from vision that states none."""
        turn = np.deg2rad(self.config.vision_rotation_std_deg)
        return _diagonal(turn, self.config.vision_position_std)

    def reset(self) -> None:
        """Forget the object."""
        self._grasp = None

    def update(
        self, joint_positions: Array, time: float, touching: Collection[str] = ()
    ) -> tuple[Array, Array]:
        """Return the object's pose at new joint positions.

        Args:
            joint_positions: (23,) rad.
            time: s.
            touching: fingers besides the thumb that hold the object now.

        Returns:
            X_WO (4, 4) and its covariance (6, 6) [rotation, position], world axes.

        Raises:
            NotIdentifiableError: no initial pose was given.
        """
        if self._grasp is None:
            raise NotIdentifiableError(
                "kinematic tracker has no initial object pose; send one on /object/pose/vision"
            )
        grasp = self._grasp
        predicted = grasp.rigid_prediction(joint_positions)
        fingers = [finger for finger in touching if finger != ANCHOR]
        design, innovation, constant, varying = grasp.relate(joint_positions, predicted, fingers)
        joints = self.config.joints
        noise = (constant * joints.constant_variance()) @ constant.T
        noise += (varying * joints.varying_variance()) @ varying.T
        noise += np.diag(self._give(len(fingers)))
        weight = np.linalg.solve(noise, design).T
        spread = np.linalg.inv(weight @ design)
        correction = spread @ weight @ innovation
        pose = np.eye(4)
        pose[:3, :3] = exp_so3(correction[:3]) @ predicted[:3, :3]
        pose[:3, 3] = predicted[:3, 3] + correction[3:]
        return pose, spread + grasp.initial_covariance(pose) + self._creep(grasp.age(time))

    def _give(self, fingers: int) -> Array:
        config = self.config
        thumb = [np.deg2rad(config.thumb_rotation_std_deg)] * 3 + [config.thumb_position_std] * 3
        return np.array(thumb + [config.finger_position_std] * (3 * fingers)) ** 2

    def _creep(self, age: float) -> Array:
        root = np.sqrt(max(age, 0.0))
        rotation = np.deg2rad(self.config.creep_rotation_deg)
        return _diagonal(rotation * root, self.config.creep_position * root)


class _Grasp:
    """What was known when tracking began: object, joints, and the points that fingers hold."""

    def __init__(
        self,
        kinematics: HandKinematics,
        pose: Array,
        positions: Array,
        covariance: Array,
        time: float | None,
    ) -> None:
        self._kinematics = kinematics
        self._pose = pose
        self._positions = np.array(positions, dtype=float)
        self._covariance = covariance
        self._start = time
        sensors = kinematics.locate(self._positions).sensors
        self._thumb_to_object = np.linalg.inv(sensors[finger_index(ANCHOR)]) @ pose
        self._tips = sensors[:, :3, 3].copy()
        self._tips_in_object = (self._tips - pose[:3, 3]) @ pose[:3, :3]
        self._object_jacobian = kinematics.jacobian(ANCHOR, self._positions, pose[:3, 3])
        self._tip_jacobians = kinematics.jacobian(kinematics.fingers, self._positions, self._tips)[
            :, 3:
        ]

    def age(self, time: float) -> float:
        """Return the time since tracking began."""
        if self._start is None:
            self._start = time
        return time - self._start

    def rigid_prediction(self, positions: Array) -> Array:
        """Return X_WO if the object were rigid to the thumb."""
        return np.asarray(self._kinematics.sensor_pose(ANCHOR, positions) @ self._thumb_to_object)

    def initial_covariance(self, pose: Array) -> Array:
        """Return the covariance of the initial pose carried along to ``pose``."""
        turn = twice(pose[:3, :3] @ self._pose[:3, :3].T)
        return np.asarray(turn @ self._covariance @ turn.T)

    def relate(
        self, positions: Array, predicted: Array, fingers: Sequence[str]
    ) -> tuple[Array, Array, Array, Array]:
        """Return design, innovation, and sensitivities to constant and varying joint errors.

        A joint error that was there at the start acts only by how far its effect has changed.
        """
        turn = predicted[:3, :3] @ self._pose[:3, :3].T
        jacobian = self._kinematics.jacobian(ANCHOR, positions, predicted[:3, 3])
        carried = twice(turn) @ self._object_jacobian
        rows = 6 + 3 * len(fingers)
        design, innovation = np.zeros((rows, 6)), np.zeros(rows)
        constant, varying = np.zeros((rows, DOF)), np.zeros((rows, DOF))
        design[:6], constant[:6], varying[:6] = np.eye(6), jacobian - carried, jacobian
        index = [finger_index(finger) for finger in fingers]
        tips = self._kinematics.locate(positions).sensors[index, :3, 3]
        arms = self._tips_in_object[index] @ predicted[:3, :3].T
        of_tips = self._kinematics.jacobian(fingers, positions, tips)[:, 3:]
        design[6:, :3], design[6:, 3:] = (
            -skew(arms).reshape(-1, 3),
            np.tile(np.eye(3), (len(index), 1)),
        )
        innovation[6:] = (tips - predicted[:3, 3] - arms).ravel()
        constant[6:] = (of_tips - turn @ self._tip_jacobians[index]).reshape(-1, DOF)
        varying[6:] = of_tips.reshape(-1, DOF)
        return design, innovation, constant, varying


def _diagonal(rotation_std: float, position_std: float) -> Array:
    return np.diag([rotation_std**2] * 3 + [position_std**2] * 3)


def pose_error(estimate: Array, truth: Array) -> Array:
    """Return the error (6,) [rotation, position] of a pose, world axes, rad and m."""
    rotation = log_so3(estimate[:3, :3] @ truth[:3, :3].T)
    return np.concatenate([rotation, estimate[:3, 3] - truth[:3, 3]])
