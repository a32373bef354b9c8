"""Joint drives: the arm's stiff servo and the hand's torque-limited PD."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.robot.robot import Robot, column

SERVO_TIME = 0.01


class JointDrives:
    """Turns joint targets into motor commands of arm and hand, once per simulation step.

    Targets come at any rate; a critically damped second-order filter makes the reference smooth:
    ddq_r = (q_d - q_r) / T^2 - 2 dq_r / T, with dq_r limited to the joints' speeds.
    Arm: velocity servo to dq_r + (q_r - q) / T_servo, limited in torque, gravity compensated.
    Hand: tau = clip(kp (q_r - q) - kd dq, ±cap), the driver's law (no gravity compensation).

    Args:
        client, body: Bullet ids.
        robot: whose drives they are.
        indices: (J,) Bullet joint indices in the robot's order.
        smoothing: T of the filter, s.
        stiffness_scale: factor on the hand's kp and, as its square root, on kd.
        time_step: of the simulation, s.
    """

    def __init__(
        self,
        client: int,
        body: int,
        robot: Robot,
        indices: Sequence[int],
        smoothing: float,
        stiffness_scale: float,
        time_step: float,
    ) -> None:
        self._client, self._body, self._robot = client, body, robot
        self._arm_dof = count = robot.arm_dof
        self._all = list(indices)
        self._arm, self._hand = list(indices[:count]), list(indices[count:])
        self._kp = stiffness_scale * column(robot.hand_joints, "kp")
        self._kd = np.sqrt(stiffness_scale) * column(robot.hand_joints, "kd")
        self._cap = column(robot.hand_joints, "effort")
        self._floor = -self._cap
        self._arm_cap = [joint.effort for joint in robot.arm]
        self._dt, ratio = time_step, time_step / smoothing
        self._pull, self._decay = ratio / smoothing, 1.0 + 2.0 * ratio + ratio**2
        self._speed = column(robot.joints, "velocity")
        self._slowest = -self._speed
        self._lower, self._upper = column(robot.joints, "lower"), column(robot.joints, "upper")
        self.target = np.zeros(robot.dof)
        self.reference = np.zeros(robot.dof)
        self._rate = np.zeros(robot.dof)
        self.torque = np.zeros(len(robot.hand_joints))
        self._release_hand_motors()
        self._limit_speeds()

    def set_target(self, target: Array) -> None:
        """Set the joint targets (J,), rad; the drives clip them to the joints' limits."""
        self.target = np.minimum(np.maximum(target, self._lower), self._upper)

    def reset(self, positions: Array) -> None:
        """Start anew at rest at ``positions`` (J,), rad."""
        self.set_target(positions)
        self.reference = self.target.copy()
        self._rate = np.zeros(self._robot.dof)

    def apply(self) -> None:
        """Drive arm and hand for the coming step."""
        self._smooth()
        states = pybullet.getJointStates(self._body, self._all, physicsClientId=self._client)
        position = np.array([state[0] for state in states])
        gap = self.reference - position
        pybullet.setJointMotorControlArray(
            self._body,
            self._arm,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=(self._rate + gap / SERVO_TIME)[: self._arm_dof].tolist(),
            forces=self._arm_cap,
            physicsClientId=self._client,
        )
        velocity = np.array([state[1] for state in states[self._arm_dof :]])
        wanted = self._kp * gap[self._arm_dof :] - self._kd * velocity
        self.torque = np.minimum(np.maximum(wanted, self._floor), self._cap)
        pybullet.setJointMotorControlArray(
            self._body,
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
            self._body,
            self._hand,
            pybullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self._hand),
            physicsClientId=self._client,
        )

    def _limit_speeds(self) -> None:
        """Let joints be as fast as the fastest may: Bullet has one limit for a whole body."""
        for index in self._all:
            pybullet.changeDynamics(
                self._body,
                index,
                maxJointVelocity=float(self._speed.max()),
                jointDamping=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                physicsClientId=self._client,
            )
