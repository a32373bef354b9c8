"""Behaviour: open, approach, grasp, lift, excite, put down, as joint targets over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.manipulation.arm_path import (
    ArmPath,
    excite,
    join_joints,
    join_poses,
)
from tactile_dynamics_ros.core.manipulation.excitation import (
    CartesianOffsets,
    ExcitationConfig,
    SumOfSines,
)
from tactile_dynamics_ros.core.manipulation.grasp_planner import (
    GraspGeometry,
    GraspPlan,
    GraspSite,
    plan_grasp,
)
from tactile_dynamics_ros.core.manipulation.squeeze import Squeeze, SqueezeConfig, held_by
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics


class Phase(Enum):
    """Phases of a grasp."""

    OPEN = "open"
    APPROACH = "approach"
    DESCEND = "descend"
    CLOSE = "close"
    SQUEEZE = "squeeze"
    LIFT = "lift"
    CARRY = "carry"
    EXCITE = "excite"
    RETURN = "return"
    LOWER = "lower"
    RELEASE = "release"
    RETREAT = "retreat"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class GraspConfig:
    """Speeds, heights and thresholds of the behaviour."""

    hover: float = parameter(
        0.12, "height above the grasp from which the hand comes", "m", 0.05, 0.4
    )
    lift: float = parameter(0.12, "height of the straight lift", "m", 0.02, 0.4)
    approach_speed: float = parameter(0.5, "share of the joints' speed limits", "", 0.05, 1.0)
    carry_speed: float = parameter(0.25, "share of the joints' speed limits", "", 0.05, 1.0)
    descend_speed: float = parameter(0.08, "speed of the palm coming down", "m/s", 0.01, 0.5)
    lift_speed: float = parameter(0.05, "speed of the palm with the object", "m/s", 0.01, 0.5)
    close_time: float = parameter(2.0, "time from open to closed fingers", "s", 0.2, 20.0)
    touch_force: float = parameter(0.15, "force that counts as touch", "N", 0.02, 2.0)
    hold_force: float = parameter(0.15, "force below which a finger does not hold", "N", 0.0, 2.0)
    lost_time: float = parameter(0.5, "time without hold that counts as lost", "s", 0.05, 5.0)
    settle: float = parameter(0.7, "pause after squeezing and after carrying", "s", 0.0, 5.0)
    stand: float = parameter(0.0, "time to hold the object on its support first", "s", 0.0, 600.0)
    attempts: int = parameter(2, "grasps to try before giving up", "", 1, 10)
    excite_forever: bool = parameter(False, "repeat the excitation instead of putting down")
    geometry: GraspGeometry = field(default_factory=GraspGeometry)
    squeeze: SqueezeConfig = field(default_factory=SqueezeConfig)
    excitation: ExcitationConfig = field(default_factory=ExcitationConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


class GraspController:
    """State machine from measured joints, touch and object pose to joint targets.

    Call `update` at 50 to 500 Hz. It starts by itself once an object pose is known.

    Args:
        kinematics: kinematic model of the robot.
        site: where to take the object.
        config: speeds, forces, excitation.
        offsets: excitation as Cartesian offsets over ``duration`` seconds; a sum of sines if None.
        duration: duration of ``offsets``, s.

    Attributes:
        phase: what the hand is doing. outcome: why it failed, or "".
    """

    def __init__(
        self,
        kinematics: HandKinematics,
        site: GraspSite,
        config: GraspConfig | None = None,
        offsets: CartesianOffsets | None = None,
        duration: float | None = None,
    ) -> None:
        self.config = config or GraspConfig()
        self.phase = Phase.OPEN
        self.outcome = ""
        self._kinematics, self._robot = kinematics, kinematics.robot
        self._arm = slice(0, kinematics.robot.arm_dof)
        self._fingers = slice(kinematics.robot.arm_dof, None)
        self._site = site
        self._offsets = offsets or SumOfSines(self.config.excitation)
        self._duration = self.config.excitation.duration if duration is None else duration
        self._since: float | None = None
        self._last = 0.0
        self._attempt = 1
        self._plan: GraspPlan | None = None
        self._path: ArmPath | None = None
        self._back: ArmPath | None = None
        self._squeeze: Squeeze | None = None
        self._friction: float | None = None
        self._hold = np.zeros(len(self._robot.hand_joints))
        self._hand_from = self._hold
        self._target = np.zeros(self._robot.dof)
        self._stopped = np.zeros(len(self._robot.hand), dtype=bool)
        self._lost_since: float | None = None
        self._steps: dict[Phase, Callable[[float, Array, Mapping[str, Array]], None]] = {
            Phase.APPROACH: self._approach,
            Phase.DESCEND: self._descend,
            Phase.CLOSE: self._close,
            Phase.SQUEEZE: self._settle_squeeze,
            Phase.LIFT: self._lift,
            Phase.CARRY: self._carry,
            Phase.EXCITE: self._excite,
            Phase.RETURN: self._return,
            Phase.LOWER: self._lower,
            Phase.RELEASE: self._release,
            Phase.RETREAT: self._retreat,
        }

    @property
    def holding(self) -> bool:
        """Whether the object should be in the hand and off the table."""
        return self.phase in (Phase.LIFT, Phase.CARRY, Phase.EXCITE, Phase.RETURN)

    @property
    def done(self) -> bool:
        """Whether the behaviour has ended, well or not."""
        return self.phase in (Phase.DONE, Phase.FAILED)

    def update(
        self,
        time: float,
        positions: Array,
        forces: Mapping[str, Array],
        object_pose: Array | None,
    ) -> Array:
        """Return the joint targets (J,), rad (m where joints slide).

        Args:
            time: s, not decreasing.
            positions: (J,) measured joint positions, rad.
            forces: force (3,) on the object per finger in contact, N, world axes.
            object_pose: (4, 4) X_WO, or None while unknown; used until the hand descends.
        """
        if self._since is None:
            self._since, self._last, self._target = time, time, np.array(positions, dtype=float)
        if self.phase is Phase.OPEN and object_pose is not None:
            self._begin(time, positions, object_pose)
        elif self.phase in self._steps:
            self._steps[self.phase](time, positions, forces)
            if self._squeeze is not None:
                offset = self._squeeze.update(time - self._last, positions, forces)
                self._target[self._fingers] = self._hold + offset
            self._watch(time, forces)
        self._last = time
        return self._target.copy()

    def set_friction(self, friction: float) -> None:
        """Take a coefficient that the surface surely has; the grip then suits the weight."""
        self._friction = friction
        if self._squeeze is not None:
            self._squeeze.set_friction(friction)

    def _begin(self, time: float, positions: Array, object_pose: Array) -> None:
        try:
            self._plan_approach(positions, object_pose)
        except NotIdentifiableError as error:
            self.outcome = str(error)
            self._enter(Phase.FAILED, time)
            return
        self._hand_from = np.array(positions[self._fingers], dtype=float)
        self._enter(Phase.APPROACH, time)

    def _plan_approach(self, positions: Array, object_pose: Array) -> None:
        self._plan = plan_grasp(self._kinematics, self._site, object_pose, self.config.geometry)
        start = np.concatenate([self._plan.arm, self._plan.open])
        above = self._plan.palm.copy()
        above[2, 3] += self.config.hover
        rise = join_poses(self._kinematics, start, above, self.config.descend_speed)
        self._path = join_joints(
            self._robot, positions[self._arm], rise(rise.duration), self.config.approach_speed
        )

    def _enter(self, phase: Phase, time: float) -> None:
        self.phase, self._since = phase, time

    def _elapsed(self, time: float) -> float:
        return time - (self._since or 0.0)

    def _follow(self, time: float) -> bool:
        """Set the arm's target along the current path; return whether its end is reached."""
        assert self._path is not None
        self._target[self._arm] = self._path(self._elapsed(time))
        return self._elapsed(time) >= self._path.duration

    def _approach(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        assert self._plan is not None and self._path is not None
        share = min(1.0, 2.0 * self._elapsed(time) / self._path.duration)
        self._target[self._fingers] = self._hand_from + share * (self._plan.open - self._hand_from)
        if self._follow(time):
            speed = self.config.descend_speed
            self._path = join_poses(self._kinematics, self._target, self._plan.palm, speed)
            self._enter(Phase.DESCEND, time)

    def _descend(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        if self._follow(time) and self._elapsed(time) > self._path_end() + 0.3:
            self._stopped[:] = False
            self._enter(Phase.CLOSE, time)

    def _path_end(self) -> float:
        return 0.0 if self._path is None else self._path.duration

    def _close(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        assert self._plan is not None
        for k, finger in enumerate(self._robot.fingers):
            touched = finger in forces and np.linalg.norm(forces[finger]) > self.config.touch_force
            self._stopped[k] |= bool(touched)
        share = min(1.0, self._elapsed(time) / self.config.close_time)
        wanted = self._plan.open + share * (self._plan.closed - self._plan.open)
        moving = np.repeat(~self._stopped, [len(f.joints) for f in self._robot.hand])
        self._target[self._fingers] = np.where(moving, wanted, self._target[self._fingers])
        if self._stopped.all() or share >= 1.0:
            self._grip(time)

    def _grip(self, time: float) -> None:
        """Start to squeeze from where the fingers are told to be."""
        assert self._plan is not None
        self._hold = self._target[self._fingers].copy()
        palm = self._kinematics.locate(self._target).palm
        normals = self._plan.normals @ palm[:3, :3].T
        self._squeeze = Squeeze(self._kinematics, self._target, normals, self.config.squeeze)
        if self._friction is not None:
            self._squeeze.set_friction(self._friction)
        self._enter(Phase.SQUEEZE, time)

    def _settle_squeeze(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        wait = self.config.squeeze.ramp + self.config.settle
        if self._elapsed(time) < wait:
            return
        if not held_by(self._robot, forces, self.config.hold_force):
            self._retry(time, "no grip after closing")
            return
        if self._elapsed(time) < wait + self.config.stand:
            return
        self._path = self._vertical(self.config.lift, self.config.lift_speed)
        self._enter(Phase.LIFT, time)

    def _vertical(self, height: float, speed: float) -> ArmPath:
        goal = self._kinematics.locate(self._target).palm.copy()
        goal[2, 3] += height
        return join_poses(self._kinematics, self._target, goal, speed)

    def _lift(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        if self._follow(time):
            arm, speed = self._target[self._arm].copy(), self.config.carry_speed
            self._path = join_joints(self._robot, arm, self._robot.carry, speed)
            self._back = join_joints(self._robot, self._robot.carry, arm, speed)
            self._enter(Phase.CARRY, time)

    def _carry(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        if self._follow(time) and self._elapsed(time) > self._path_end() + self.config.settle:
            self._start_excitation(time)

    def _start_excitation(self, time: float) -> None:
        where = self._kinematics.locate(self._target)
        pivot = where.sensors[:, :3, 3].mean(axis=0)
        self._path = excite(self._kinematics, self._target, pivot, self._offsets, self._duration)
        self._enter(Phase.EXCITE, time)

    def _excite(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        if not self._follow(time):
            return
        if self.config.excite_forever:
            self._enter(Phase.EXCITE, time)
            return
        self._path = self._back
        self._enter(Phase.RETURN, time)

    def _return(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        if self._follow(time):
            self._path = self._vertical(-self.config.lift, self.config.lift_speed)
            self._enter(Phase.LOWER, time)

    def _lower(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        if self._follow(time):
            self._start_release(time)

    def _start_release(self, time: float) -> None:
        self._squeeze = None
        self._hand_from = self._target[self._fingers].copy()
        self._enter(Phase.RELEASE, time)

    def _release(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        assert self._plan is not None
        share = min(1.0, self._elapsed(time) / self.config.close_time)
        self._target[self._fingers] = self._hand_from + share * (self._plan.open - self._hand_from)
        if share >= 1.0:
            self._path = self._vertical(self.config.hover, self.config.descend_speed)
            self._enter(Phase.RETREAT, time)

    def _retreat(self, time: float, positions: Array, forces: Mapping[str, Array]) -> None:
        if not self._follow(time):
            return
        if self.outcome and self._attempt < self.config.attempts:
            self._attempt += 1
            self.outcome = ""
            self._enter(Phase.OPEN, time)
            return
        self._enter(Phase.FAILED if self.outcome else Phase.DONE, time)

    def _retry(self, time: float, reason: str) -> None:
        self.outcome = reason
        self._start_release(time)

    def _watch(self, time: float, forces: Mapping[str, Array]) -> None:
        """Give up when the object has left the hand."""
        enough = len(forces) >= self._robot.least_holding
        if not self.holding or enough or held_by(self._robot, forces, self.config.hold_force):
            self._lost_since = None
            return
        self._lost_since = time if self._lost_since is None else self._lost_since
        if time - self._lost_since > self.config.lost_time:
            self._lost_since = None
            self.outcome = f"object lost during {self.phase.value}"
            self._squeeze = None
            self._enter(Phase.FAILED, time)
