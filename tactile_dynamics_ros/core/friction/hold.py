"""Force of fingertips by joint positions; how others hold while one finger probes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import align_points, log_so3, skew
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import LEAST_HOLDING, Robot, column


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

    def command(self, dt: float, positions: Array, wanted: Array, measured: Array) -> Array:
        """Return the finger's joint targets (K,), rad.

        Args:
            dt: s since the last call.
            positions: (J,) measured, rad.
            wanted: (3,) force on the object, N, world axes.
            measured: (3,) measured force on the object, N, world axes.
        """
        config = self.config
        wanted = _limit(wanted, config.most_force)
        self._missing = _limit(self._missing + config.force_gain * dt * (wanted - measured), 1.0)
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


_SLIDING_COST = 3.0
"""Weight of a holding finger's tangential over its normal force, beyond one: forces along the
surface, which may slip, count four times in the sum that is made least. At zero they share what the
probe pushes without regard to friction; much more lets normal forces leave what is wanted."""
_STIFFNESS = np.array([2.0] * 3 + [150.0] * 3)
"""Spring that brings the object back: N m/rad for turns, N/m for shifts. 2 N m/rad as in EPFL's
object impedance for this hand; 150 N/m is about the stiffness of its fingers at a lever of 15 cm
(80 N/m there). Softer lets the object wander while it is probed, stiffer rocks it."""
_INTEGRAL = np.array([4.0] * 3 + [300.0] * 3)
"""Gain of the integral part, N m/(rad s) and N/(m s): twice the stiffness, so that it takes over
after half a second. Less leaves the object off its place for longer, more rocks it."""
_MOST = np.array([0.06] * 3 + [1.2] * 3)
"""Largest pull of spring and integral, N m and N: what holding fingers have to spare beside the
grip. A larger one can make them slip. A smaller one lets the probe push the object away."""


def holding_fingers(robot: Robot, probing: str) -> tuple[str, ...]:
    """Return the fingers that hold while one probes.

    Raises:
        BadInputError: that one is missed too much: it opposes all others, or too few remain.
    """
    allowed = [finger for finger in robot.fingers if finger != robot.reference]
    holders = tuple(finger for finger in robot.fingers if finger != probing)
    if probing not in allowed or len(holders) < LEAST_HOLDING:
        raise BadInputError(
            f"finger = '{probing}': expected one of {', '.join(allowed)}, of a hand in which "
            f"{LEAST_HOLDING} others hold the object"
        )
    return holders


def balance_forces(points: Array, normals: Array, wanted: Array, wrench: Array) -> Array:
    """Return forces (K, 3) on the object that make a given wrench and press as wanted.

    min sum |f_k - wanted_k n_k|^2, tangential parts weighted, subject to sum f_k = F and
    sum (p_k - p_0) x f_k = M about the mean contact point p_0.

    Args:
        points: (K, 3) m.
        normals: (K, 3) into the object.
        wanted: (K,) normal forces, N.
        wrench: (6,) [M, F], about the mean of ``points``.
    """
    count = len(points)
    centre = points.mean(axis=0)
    weight = np.zeros((3 * count, 3 * count))
    grasp = np.zeros((6, 3 * count))
    for k in range(count):
        rows = slice(3 * k, 3 * k + 3)
        across = np.eye(3) - np.outer(normals[k], normals[k])
        weight[rows, rows] = np.eye(3) + _SLIDING_COST * across
        grasp[:3, rows] = 10.0 * skew(points[k] - centre)
        grasp[3:, rows] = np.eye(3)
    target = (wanted[:, None] * normals).reshape(-1)
    system = np.block([[weight, grasp.T], [grasp, -1e-9 * np.eye(6)]])
    scaled = np.concatenate([10.0 * wrench[:3], wrench[3:]])
    solution = np.linalg.lstsq(system, np.concatenate([weight @ target, scaled]), rcond=None)[0]
    return np.asarray(solution[: 3 * count].reshape(count, 3))


def total_wrench(points: Array, forces: Array, centre: Array) -> Array:
    """Return [torque about ``centre``, force] (6,) of forces (K, 3) at points (K, 3)."""
    return np.concatenate([np.cross(points - centre, forces).sum(axis=0), forces.sum(axis=0)])


class Hold:
    """Joint targets of the holding fingers that make up for what the probing finger does.

    Their forces balance what the probe is to push; what they measure of the push is late, and would
    rock a light object in the air. A spring with integral action on the object brings it back to
    where it was: stiffness 150 N/m and 2 N m/rad, as far as 1.2 N and 0.06 N m.

    Source: facts on Allegro practice (object-level impedance 80 N/m, 2 N m/rad).

    Args:
        kinematics: kinematic model of the robot.
        fingers: that hold.
        stiffness_scale: factor on the drives' joint stiffness.
    """

    def __init__(
        self, kinematics: HandKinematics, fingers: Sequence[str], stiffness_scale: float = 1.0
    ) -> None:
        self._kinematics = kinematics
        self._fingers = tuple(fingers)
        robot = kinematics.robot
        self._arm_dof = robot.arm_dof
        self._kp = stiffness_scale * column(robot.hand_joints, "kp")
        self._effort = column(robot.hand_joints, "effort")
        self._index = [robot.finger_index(finger) for finger in fingers]
        owned = (robot.owned[finger] for finger in fingers)
        self._joints = [np.arange(own.start, own.stop) - robot.arm_dof for own in owned]

    def begin(
        self,
        positions: Array,
        targets: Array,
        points: Array,
        normals: Array,
        forces: Array,
        probe: tuple[Array, Array],
    ) -> None:
        """Start from a hold at rest.

        Args:
            positions: (J,) measured, rad.
            targets: (J,) commanded, rad.
            points: (K, 3) contact points, m.
            normals: (K, 3) into the object.
            forces: (K, 3) measured on the object, N.
            probe: point (3,) and force (3,) of the probing finger.
        """
        self._targets = np.array(targets[self._arm_dof :], dtype=float)
        self._points, self._normals, self._forces = points, normals, forces
        self._centre = points.mean(axis=0)
        self._total = total_wrench(points, forces, self._centre)
        self._total += total_wrench(probe[0][None], probe[1][None], self._centre)
        self._jacobians = [
            self._kinematics.own_jacobian(finger, positions, point)
            for finger, point in zip(self._fingers, points, strict=True)
        ]
        given = self._kp * (self._targets - positions[self._arm_dof :])
        self._given = np.clip(given, -self._effort, self._effort)
        self._tips = self._locate_tips(positions)
        self._pull = np.zeros(6)

    def command(
        self, dt: float, positions: Array, wanted: Array, probe: tuple[Array, Array]
    ) -> Array:
        """Return hand targets (H,).

        Args:
            dt: s since the last call.
            positions: (J,) measured, rad.
            wanted: (K,) normal forces, N.
            probe: point (3,) and wanted force (3,) of the probing finger.
        """
        others = total_wrench(probe[0][None], probe[1][None], self._centre)
        back = self._bring_back(dt, positions)
        forces = balance_forces(self._points, self._normals, wanted, self._total - others + back)
        targets = self._targets.copy()
        for k, rows in enumerate(self._joints):
            torque = self._jacobians[k].T @ (forces[k] - self._forces[k])
            most = 0.95 * self._effort[rows]
            room = np.clip(self._given[rows] + torque, -most, most)
            targets[rows] += (room - self._given[rows]) / self._kp[rows]
        return targets

    def _bring_back(self, dt: float, positions: Array) -> Array:
        """Wrench (6,) on the object against its motion as the holding tips show it."""
        tips = self._locate_tips(positions)
        turn, _ = align_points(tips, self._tips)
        shift = self._tips.mean(axis=0) - tips.mean(axis=0)
        away = np.concatenate([log_so3(turn), shift])
        self._pull = np.clip(self._pull + dt * _INTEGRAL * away, -_MOST, _MOST)
        return np.asarray(np.clip(self._pull + _STIFFNESS * away, -_MOST, _MOST))

    def _locate_tips(self, positions: Array) -> Array:
        where = self._kinematics.locate(positions).sensors
        return np.asarray(where[self._index, :3, 3])
