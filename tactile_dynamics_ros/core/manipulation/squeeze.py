"""Grip force: joint offsets that press the fingertips against each other, trimmed by touch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.manipulation.grasp_planner import squeeze_forces
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot import Robot, column


@dataclass(frozen=True)
class SqueezeConfig:
    """How hard to hold."""

    least: float = parameter(1.8, "force of the reference finger on a light object", "N", 0.2, 50.0)
    effort_share: float = parameter(0.92, "share of the joints' torque caps to use", "", 0.1, 1.0)
    load_factor: float = parameter(1.3, "that force per newton of carried weight", "", 0.0, 5.0)
    friction_margin: float = parameter(2.0, "grip over the least that friction needs", "", 1.0, 10)
    ramp: float = parameter(0.8, "time to build the grip up", "s", 0.05, 10.0)
    trim_rate: float = parameter(1.5, "gain of the trim by touch", "1/s", 0.0, 20.0)
    stiffness_scale: float = parameter(1.0, "factor on the drives' joint stiffness", "", 0.05, 3.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class Squeeze:
    """Joint offsets that hold the object between thumb and fingers.

    dq = s K^-1 J^T f with balanced fingertip forces f (zero net wrench). The factor s follows the
    measured normal force of the robot's reference finger (a hand's thumb):
    ds/dt = g (F_wanted - F_measured) / F_wanted.

    Args:
        kinematics: kinematic model of the robot.
        positions: (J,) rad with the fingertips touching.
        normals: (F, 3) into the object, world axes, at these positions.
        config: how hard.
    """

    def __init__(
        self,
        kinematics: HandKinematics,
        positions: Array,
        normals: Array,
        config: SqueezeConfig | None = None,
    ) -> None:
        self.config = config or SqueezeConfig()
        robot, where = kinematics.robot, kinematics.locate(positions)
        points = where.sensors[:, :3, 3] + robot.tips.radius * normals
        self._normals_palm = normals @ where.palm[:3, :3]
        self._opposed = robot.finger_index(robot.reference)
        forces = squeeze_forces(points, normals, robot.sides, 1.0)
        torque = np.concatenate(
            [
                kinematics.own_jacobian(finger, positions, point).T @ force
                for finger, point, force in zip(robot.fingers, points, forces, strict=True)
            ]
        )
        self._torque = torque
        self._stiffness = column(robot.hand_joints, "kp")
        self._effort = column(robot.hand_joints, "effort")
        self._kinematics = kinematics
        bearable = float((self._effort / np.maximum(np.abs(torque), 1e-9)).min())
        self._most = self.config.effort_share * bearable
        self._growth = 0.0
        self._trim = 1.0
        self._weight = 0.0
        self.wanted = min(self.config.least, self._most)
        self.load_factor = self.config.load_factor

    def set_friction(self, friction: float) -> None:
        """Take a measured coefficient: the thumb and the fingers opposite bear W <= 2 mu F.

        Args:
            friction: lower end of its interval.
        """
        self.load_factor = self.config.friction_margin / (2.0 * max(friction, 0.05))

    def update(self, dt: float, positions: Array, forces: Mapping[str, Array]) -> Array:
        """Advance by ``dt`` and return the joint offsets (H,), rad.

        Args:
            dt: s since the last call.
            positions: (J,) rad.
            forces: force (3,) on the object per touching finger, N, world axes.
        """
        self._growth = min(1.0, self._growth + dt / self.config.ramp)
        if forces:
            self._follow_load(dt, forces)
        opposed = self._kinematics.robot.reference
        if opposed in forces and self._growth >= 1.0:
            palm = self._kinematics.locate(positions).palm[:3, :3]
            normal = palm @ self._normals_palm[self._opposed]
            missing = 1.0 - float(forces[opposed] @ normal) / self.wanted
            trim = self._trim + self.config.trim_rate * dt * float(np.clip(missing, -0.5, 0.5))
            self._trim = float(np.clip(trim, 0.7, 1.5))
        torque = self._growth * self._trim * self.wanted * self._torque
        torque = np.clip(torque, -self._effort, self._effort)
        return np.asarray(torque / (self.config.stiffness_scale * self._stiffness))

    def _follow_load(self, dt: float, forces: Mapping[str, Array]) -> None:
        """Let the wanted force follow the carried weight: up at once, down slowly."""
        carried = float(np.linalg.norm(np.sum([forces[name] for name in forces], axis=0)))
        self._weight += min(1.0, dt / 0.08) * (carried - self._weight)
        wanted = max(self.load_factor * self._weight, self.config.least)
        wanted = min(wanted, self._most)
        delay = 0.08 if wanted > self.wanted else 2.0
        self.wanted += min(1.0, dt / delay) * (wanted - self.wanted)


def held_by(robot: Robot, forces: Mapping[str, Array], threshold: float) -> bool:
    """Whether enough fingers press with more than ``threshold`` (N), the reference among them."""
    touching = [name for name in robot.fingers if name in forces]
    strong = [name for name in touching if float(np.linalg.norm(forces[name])) > threshold]
    return robot.reference in strong and len(strong) >= robot.least_holding
