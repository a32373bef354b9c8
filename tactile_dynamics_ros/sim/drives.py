"""Joint drives: the arm's stiff servo and the hand's torque-limited PD."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.robot_description import (
    ACTUATED_JOINTS,
    ARM_JOINTS,
    HAND_JOINTS,
)

Array = NDArray[np.float64]

ARM_DOF = len(ARM_JOINTS)


class JointDrives:
    """Turns joint targets into motor commands of arm and hand, once per simulation step.

    Arm: position servo with a first-order lag, limited in speed and torque.
    Hand: tau = clip(kp (q_d - q) - kd dq, +-cap), the driver's law (no gravity compensation).

    Args:
        client, robot: Bullet ids.
        indices: (23,) Bullet joint indices in the order of ACTUATED_JOINTS.
        arm_time_constant: lag of the arm's servo, s.
        stiffness_scale: factor on the hand's kp and, as its square root, on kd.
        time_step: of the simulation, s.
    """

    def __init__(
        self,
        client: int,
        robot: int,
        indices: Sequence[int],
        arm_time_constant: float,
        stiffness_scale: float,
        time_step: float,
    ) -> None:
        self._client, self._robot = client, robot
        self._arm, self._hand = list(indices[:ARM_DOF]), list(indices[ARM_DOF:])
        self._kp = stiffness_scale * np.array([joint.kp for joint in HAND_JOINTS])
        self._kd = np.sqrt(stiffness_scale) * np.array([joint.kd for joint in HAND_JOINTS])
        self._cap = np.array([joint.effort for joint in HAND_JOINTS])
        self._arm_cap = [joint.effort for joint in ARM_JOINTS]
        self._arm_gain = [time_step / arm_time_constant] * ARM_DOF
        self._lower = np.array([joint.lower for joint in ACTUATED_JOINTS])
        self._upper = np.array([joint.upper for joint in ACTUATED_JOINTS])
        self.target = np.zeros(len(ACTUATED_JOINTS))
        self.torque = np.zeros(len(HAND_JOINTS))
        self._release_hand_motors()
        self._limit_speeds()

    def set_target(self, target: Array) -> None:
        """Set the joint targets (23,), rad; the drives clip them to the joints' limits."""
        self.target = np.clip(target, self._lower, self._upper)
        pybullet.setJointMotorControlArray(
            self._robot,
            self._arm,
            pybullet.POSITION_CONTROL,
            targetPositions=self.target[:ARM_DOF].tolist(),
            positionGains=self._arm_gain,
            velocityGains=[1.0] * ARM_DOF,
            forces=self._arm_cap,
            physicsClientId=self._client,
        )

    def apply(self) -> None:
        """Apply the hand's torques for the coming step."""
        states = pybullet.getJointStates(self._robot, self._hand, physicsClientId=self._client)
        now = np.array([state[:2] for state in states])
        wanted = self._kp * (self.target[ARM_DOF:] - now[:, 0]) - self._kd * now[:, 1]
        self.torque = np.minimum(np.maximum(wanted, -self._cap), self._cap)
        pybullet.setJointMotorControlArray(
            self._robot,
            self._hand,
            pybullet.TORQUE_CONTROL,
            forces=self.torque.tolist(),
            physicsClientId=self._client,
        )

    def _release_hand_motors(self) -> None:
        pybullet.setJointMotorControlArray(
            self._robot,
            self._hand,
            pybullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self._hand),
            physicsClientId=self._client,
        )

    def _limit_speeds(self) -> None:
        for index, joint in zip([*self._arm, *self._hand], ACTUATED_JOINTS, strict=True):
            pybullet.changeDynamics(
                self._robot,
                index,
                maxJointVelocity=joint.velocity,
                jointDamping=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                physicsClientId=self._client,
            )
