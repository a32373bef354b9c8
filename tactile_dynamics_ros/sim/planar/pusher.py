"""An arm with a gripper that pushes with a tip and pulls with two pads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.manipulation.inverse_kinematics import solve_arm
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.planar.table import TableWorld
from tactile_dynamics_ros.sim.planar.touch import Skin, Touch, sides_of

PUSHER, PADS = "pusher", ("pad_left", "pad_right")
PAD_ROW, PAD_EDGE = np.array([-0.006, 0.0, 0.006]), 0.0015
"""Points of a pad along its face of 15 mm and their rounding, m."""
OPEN = 0.002
"""Width of the jaws above which the pads touch and below which the tip does, m: a closed gripper
is one finger."""
SMOOTHING = 0.015
"""Time constant of the arm's path filter, s: a third of what hands take for the same, as position
servos of arms do. At 5 ms the steps between targets shake the object, at 50 ms stops are soft."""
MISSED = 1e-3
"""Distance, m, by which an arm's joints may miss the tip's place; beyond, the place is out of
reach and the arm stays."""


@dataclass(frozen=True)
class PusherConfig:
    """Arm, gripper and what touches."""

    robot: str = parameter("panda_gripper", "file in config/robots, or path of a yaml file")
    position: tuple[float, ...] = parameter((0.35, -0.2, 0.3), "tip at the start, world", "m")
    speed: float = parameter(0.6, "largest of the tip", "m/s", 1e-3, 2.0)
    jaw_speed: float = parameter(0.05, "of the jaws against each other", "m/s", 1e-3, 1.0)
    grip_force: float = parameter(12.0, "at which closing jaws stop, each pad", "N", 0.1, 70.0)
    most_force: float = parameter(40.0, "of a contact, at which the arm stops", "N", 1.0, 500.0)
    tip_radius: float = parameter(0.006, "of the closed gripper's tip", "m", 1e-3, 0.05)
    stiffness: float = parameter(2e4, "of tip or pad with the arm, normal", "N/m", 1e2, 1e5)
    shear_stiffness: float = parameter(1.5e4, "the same across", "N/m", 1e2, 1e5)
    damping: float = parameter(60.0, "of tip or pad", "N s/m", 0.0, 200.0)
    friction: float = parameter(0.35, "tip or pad against objects", "", 0.0, 2.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class Pusher:
    """A position-controlled arm: its tip follows targets, whatever the load.

    The arm's servo is stiff beside a tip of 20 N/mm, so that its joints follow from the tip's pose
    by inverse kinematics and it adds no dynamics of its own. The gripper points down.

    Args:
        world: in which it pushes.
        config: of all.
        period: s, of targets and readings.

    Attributes:
        machine: the robot as data. frame: (4,) x, y, z (m) of the tip and turn (rad) now.
        width: m, of the jaws. joints: (J,) rad and m. fault: why the arm stays where it is.
    """

    def __init__(self, world: TableWorld, config: PusherConfig, period: float) -> None:
        self.config, self._period = config, period
        self.machine = load_robot(config.robot)
        self._kinematics = HandKinematics(self.machine)
        self._palm_height = self.machine.grasp.depth
        self.frame = np.array([*config.position, 0.0])
        self._rate, self._along = np.zeros(4), self.frame.copy()
        self._target, self._pace = self.frame.copy(), np.zeros(4)
        self.width = self._wanted = 0.0
        self._squeeze = self._jaw_rate = 0.0
        self._touching = False
        self.fault = ""
        self.joints, self._gap = self._solve(self.machine.start, 200)
        self._sides = sides_of(world.bodies)
        skin = Skin(config.stiffness, config.shear_stiffness, config.damping, config.friction)
        self._tip = Touch(PUSHER, np.zeros((1, 2)), config.tip_radius, skin)
        self._pads = [Touch(name, np.zeros((3, 2)), PAD_EDGE, skin) for name in PADS]
        world.add_pre_step(self._act, self._is_idle)

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of its contacts."""
        return (PUSHER, *PADS)

    @property
    def pose(self) -> Array:
        """Pose (4, 4) of the tip: x the gripper's forward axis, y from pad to pad, z up."""
        pose = np.eye(4)
        pose[:3, :3] = exp_so3(np.array([0.0, 0.0, self.frame[3]]))
        pose[:3, 3] = self.frame[:3]
        return pose

    def place(self, frame: Array, width: float = 0.0) -> None:
        """Put the tip at rest at x, y, z (m) and turn (rad), with open or closed jaws."""
        self.frame, self._along, self._target = frame.copy(), frame.copy(), frame.copy()
        self._rate, self._pace, self.fault = np.zeros(4), np.zeros(4), ""
        self.width = self._wanted = width
        self.joints, self._gap = self._solve(self.machine.start, 200)

    def go_to(self, target: Array) -> None:
        """Set where the tip should be one period from now, (4, 4); upright."""
        turn = np.arctan2(target[1, 0], target[0, 0]) - self._along[3]
        turn = self._along[3] + (turn + np.pi) % (2.0 * np.pi) - np.pi
        wanted = np.array([*target[:3, 3], turn])
        if self.fault and wanted[2] <= self.frame[2]:
            return  # the way out is up
        self.fault = ""
        self._target = wanted

    def open_to(self, width: float) -> None:
        """Set the width of the jaws, m; closing jaws stop at what they grip."""
        jaws = self.machine.hand_joints
        self._wanted = float(np.clip(width, 0.0, sum(joint.upper for joint in jaws)))

    def read(self, time: float) -> list[ContactReading]:
        """Let the joints follow, and return what tip and pads touched since the last call.

        Args:
            time: s, of the middle of that window.
        """
        touches = (self._tip, *self._pads)
        rising = self._pace[2] > 0.0  # the way out
        if any(touch.buried for touch in touches) and not rising:
            self._stop("the gripper came down on an object")
        read = [touch.read(time) for touch in touches]
        self._touching = any(each.in_contact for each in read)
        self._squeeze = min(float(np.linalg.norm(each.force)) for each in read[1:])
        most = max(float(np.linalg.norm(each.force)) for each in read)
        if most > self.config.most_force and not rising:
            self._stop(f"a contact bears more than {self.config.most_force:g} N")
        joints, gap = self._solve(self.joints, 8)
        if gap > MISSED and gap > self._gap:
            self._stop("the arm cannot reach its target")
        self.joints, self._gap = joints, gap
        return read

    def plan(self) -> None:
        """Choose the speed at which the target is approached in the coming period."""
        way = (self._target - self._along) / self._period
        size = float(np.linalg.norm(way[:3]))
        self._pace = way * min(1.0, self.config.speed / max(size, 1e-12))
        self._pace[3] = np.clip(way[3], -2.0, 2.0)
        most = self.config.jaw_speed * self._period
        jaw = float(np.clip(self._wanted - self.width, -most, most))
        if jaw < 0.0 and self._squeeze > 0.0:  # each of the jaws moves by half of it
            missing = (self.config.grip_force - self._squeeze) / (0.5 * self.config.stiffness)
            jaw = max(jaw, -max(missing, 0.0))
        self._jaw_rate = jaw / self._period

    def _stop(self, why: str) -> None:
        self.fault = why
        self._target, self._along = self.frame.copy(), self.frame.copy()
        self._rate[:] = 0.0

    def _solve(self, joints: Array, iterations: int) -> tuple[Array, float]:
        """Return joints whose tip is where it is now, and by how much they miss it."""
        down = np.diag([1.0, -1.0, -1.0, 1.0])
        palm = self.pose @ down
        palm[:3, 3] = self.frame[:3] + [0.0, 0.0, self._palm_height]
        found, missed = solve_arm(
            self._kinematics, joints, palm, self.machine.start[: self.machine.arm_dof], iterations
        )
        found[self.machine.arm_dof :] = 0.5 * self.width
        return found, missed

    def _is_idle(self) -> bool:
        still = max(np.abs(self._rate).max(), np.abs(self._pace).max()) < 1e-6
        return bool(still and self._jaw_rate == 0.0 and not self._touching)

    def _act(self, world: TableWorld) -> None:
        """Move by one step and push what is touched."""
        step = world.time_step
        self._along += step * self._pace
        pull = (self._along - self.frame) * (step / SMOOTHING**2)
        self._rate = (self._rate + pull) / (1.0 + 2.0 * step / SMOOTHING + (step / SMOOTHING) ** 2)
        self.frame = self.frame + step * self._rate
        self.width += step * self._jaw_rate
        if self.width < OPEN:
            self._tip.act(self._sides, self.frame, self._rate, step)
            return
        for touch, side in zip(self._pads, (1.0, -1.0), strict=True):
            across = np.full(3, side * (0.5 * self.width + PAD_EDGE))
            touch.move(np.column_stack([PAD_ROW, across]))
            touch.act(self._sides, self.frame, self._rate, step)
