"""Force of one fingertip by joint positions: Cartesian impedance, Jacobian transpose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import column

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ImpedanceConfig:
    """Gains and limits of the fingertip's force.

    Source: facts on Allegro practice: fingertip stiffness 100 to 400 N/m, damping 1 to 10 N s/m,
    force ceiling 3.8 N, safe limit of a BioTac 5 N.
    """

    stiffness: float = parameter(120.0, "against sliding off the anchor", "N/m", 0.0, 1000.0)
    damping: float = parameter(6.0, "damping of the fingertip", "N s/m", 0.0, 50.0)
    force_gain: float = parameter(4.0, "integral gain of the force error", "1/s", 0.0, 50.0)
    most_force: float = parameter(3.5, "limit of a fingertip's force", "N", 0.1, 5.0)
    torque_share: float = parameter(0.95, "share of the joints' torque caps", "", 0.1, 1.0)
    joint_rate: float = parameter(3.0, "limit of a joint command's speed", "rad/s", 0.05, 6.3)
    posture: float = parameter(0.3, "share of joint stiffness that keeps the posture", "", 0, 1)
    stiffness_scale: float = parameter(1.0, "factor on the drives' joint stiffness", "", 0.05, 3.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class FingertipImpedance:
    """Joint targets of one finger that make its tip press with a wanted force.

    tau = J^T (f_d + k_i int(f_d - f) dt + K (x_d - x) - D dx) + tau_0, q_d = q + tau / k_p. The
    drives multiply with k_p again, so that the torque arrives without any torque sensing. tau_0 is
    what the drives gave beyond the measured force when control began (weight of the finger), so
    that taking over moves nothing. The posture that J^T leaves free is held by a joint spring.

    Args:
        kinematics: kinematic model of the robot.
        finger: its name.
        config: gains, limits.

    Source: paper A, section IV-A.
    """

    def __init__(
        self, kinematics: HandKinematics, finger: str, config: ImpedanceConfig | None = None
    ) -> None:
        self.config = config or ImpedanceConfig()
        self._kinematics, self._finger = kinematics, finger
        robot = kinematics.robot
        joints = robot.hand[robot.finger_index(finger)].joints
        self._own = robot.owned[finger]
        self._kp = self.config.stiffness_scale * column(joints, "kp")
        self._cap = self.config.torque_share * column(joints, "effort")
        self._lower, self._upper = column(joints, "lower"), column(joints, "upper")
        self.anchor: Array | None = None
        self.limited = False

    def begin(self, positions: Array, targets: Array, force: Array) -> None:
        """Take over a finger that is told ``targets`` (J,) and presses with ``force`` (3,)."""
        jacobian = self._jacobian(positions)
        self._target = np.array(targets[self._own], dtype=float)
        given = np.clip(self._kp * (self._target - positions[self._own]), -self._cap, self._cap)
        self._bias = given - jacobian.T @ force
        self._posture = np.array(positions[self._own], dtype=float)
        self._missing = np.zeros(3)
        self._last = self.tip(positions)
        self._velocity = np.zeros(3)
        self.anchor = None

    def tip(self, positions: Array) -> Array:
        """Return the origin (3,) of the sensor frame in the world, m."""
        return np.asarray(self._kinematics.sensor_pose(self._finger, positions)[:3, 3])

    def command(self, dt: float, positions: Array, wanted: Array, felt: Array) -> Array:
        """Return the finger's joint targets (K,), rad.

        Args:
            dt: s since the last call.
            positions: (J,) measured, rad.
            wanted: (3,) force on the object, N, world axes.
            felt: (3,) measured force on the object, N, world axes.
        """
        config = self.config
        wanted = _limit(wanted, config.most_force)
        self._missing = _limit(self._missing + config.force_gain * dt * (wanted - felt), 1.0)
        tip = self.tip(positions)
        self._velocity += min(1.0, dt / 0.03) * ((tip - self._last) / dt - self._velocity)
        self._last = tip
        push = wanted + self._missing - config.damping * self._velocity
        if self.anchor is not None:
            push = push + config.stiffness * (self.anchor - tip)
        jacobian = self._jacobian(positions)
        spring = config.posture * self._kp * (self._posture - positions[self._own])
        torque = jacobian.T @ _limit(push, config.most_force) + self._bias
        torque = torque + _free_part(jacobian) @ spring
        self.torque = torque
        self.limited = bool(np.any(np.abs(torque) > self._cap))
        torque = np.clip(torque, -self._cap, self._cap)
        goal = np.clip(positions[self._own] + torque / self._kp, self._lower, self._upper)
        step = config.joint_rate * dt
        self._target = self._target + np.clip(goal - self._target, -step, step)
        return self._target.copy()

    def _jacobian(self, positions: Array) -> Array:
        tip = self.tip(positions)
        return self._kinematics.own_jacobian(self._finger, positions, tip)


def _limit(force: Array, most: float) -> Array:
    size = float(np.linalg.norm(force))
    return force * min(1.0, most / max(size, 1e-9))


def _free_part(jacobian: Array) -> Array:
    """Return the projection (K, K) on joint torques that make no force at the tip.

    A torque does not act on the tip if it is orthogonal to the range of J^T.
    """
    return np.asarray(np.eye(jacobian.shape[1]) - np.linalg.pinv(jacobian) @ jacobian)
