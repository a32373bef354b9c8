"""Joint drives: the arm's stiff servo and the hand's torque-limited PD."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet
from numpy.typing import NDArray

from tactile_dynamics_ros.core.robot.robot_description import (
    ACTUATED_JOINTS,
    ARM_JOINTS,
    HAND_JOINTS,
)

Array = NDArray[np.float64]

ARM_DOF = len(ARM_JOINTS)
SERVO_TIME = 0.01


class JointDrives:
    """Turns joint targets into motor commands of arm and hand, once per simulation step.

    Targets come at any rate; a critically damped second-order filter makes the reference smooth:
    ddq_r = (q_d - q_r) / T^2 - 2 dq_r / T, with dq_r limited to the joints' speeds.
    Arm: velocity servo to dq_r + (q_r - q) / T_servo, limited in torque, gravity compensated.
    Hand: tau = clip(kp (q_r - q) - kd dq, +-cap), the driver's law (no gravity compensation).

    Args:
        client, robot: Bullet ids.
        indices: (23,) Bullet joint indices in the order of ACTUATED_JOINTS.
        smoothing: T of the filter, s.
        stiffness_scale: factor on the hand's kp and, as its square root, on kd.
        time_step: of the simulation, s.
    """

    def __init__(
        self,
        client: int,
        robot: int,
        indices: Sequence[int],
        smoothing: float,
        stiffness_scale: float,
        time_step: float,
    ) -> None:
        self._client, self._robot = client, robot
        self._all = list(indices)
        self._arm, self._hand = list(indices[:ARM_DOF]), list(indices[ARM_DOF:])
        self._kp = stiffness_scale * np.array([joint.kp for joint in HAND_JOINTS])
        self._kd = np.sqrt(stiffness_scale) * np.array([joint.kd for joint in HAND_JOINTS])
        self._cap = np.array([joint.effort for joint in HAND_JOINTS])
        self._floor = -self._cap
        self._arm_cap = [joint.effort for joint in ARM_JOINTS]
        self._dt, ratio = time_step, time_step / smoothing
        self._pull, self._decay = ratio / smoothing, 1.0 + 2.0 * ratio + ratio**2
        self._speed = np.array([joint.velocity for joint in ACTUATED_JOINTS])
        self._slowest = -self._speed
        self._lower = np.array([joint.lower for joint in ACTUATED_JOINTS])
        self._upper = np.array([joint.upper for joint in ACTUATED_JOINTS])
        self.target = np.zeros(len(ACTUATED_JOINTS))
        self.reference = np.zeros(len(ACTUATED_JOINTS))
        self._rate = np.zeros(len(ACTUATED_JOINTS))
        self.torque = np.zeros(len(HAND_JOINTS))
        self._release_hand_motors()
        self._limit_speeds()

    def set_target(self, target: Array) -> None:
        """Set the joint targets (23,), rad; the drives clip them to the joints' limits."""
        self.target = np.minimum(np.maximum(target, self._lower), self._upper)

    def reset(self, positions: Array) -> None:
        """Start anew at rest at ``positions`` (23,), rad."""
        self.set_target(positions)
        self.reference = self.target.copy()
        self._rate = np.zeros(len(ACTUATED_JOINTS))

    def apply(self) -> None:
        """Drive arm and hand for the coming step."""
        self._smooth()
        states = pybullet.getJointStates(self._robot, self._all, physicsClientId=self._client)
        position = np.array([state[0] for state in states])
        gap = self.reference - position
        pybullet.setJointMotorControlArray(
            self._robot,
            self._arm,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=(self._rate + gap / SERVO_TIME)[:ARM_DOF].tolist(),
            forces=self._arm_cap,
            physicsClientId=self._client,
        )
        velocity = np.array([state[1] for state in states[ARM_DOF:]])
        wanted = self._kp * gap[ARM_DOF:] - self._kd * velocity
        self.torque = np.minimum(np.maximum(wanted, self._floor), self._cap)
        pybullet.setJointMotorControlArray(
            self._robot,
            self._hand,
            pybullet.TORQUE_CONTROL,
            forces=self.torque.tolist(),
            physicsClientId=self._client,
        )

    def _smooth(self) -> None:
        """Advance the reference by one step (implicit in its own decay)."""
        rate = (self._rate + (self.target - self.reference) * self._pull) / self._decay
        self._rate = np.minimum(np.maximum(rate, self._slowest), self._speed)
        self.reference = self.reference + self._dt * self._rate

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
