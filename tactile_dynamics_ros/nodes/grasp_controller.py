"""Node: the behaviour that grasps, lifts and moves the object, as joint commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.manipulation.arm_path import ArmPath, excite
from tactile_dynamics_ros.core.manipulation.excitation import OffsetTable, SumOfSines
from tactile_dynamics_ros.core.manipulation.grasp_controller import (
    GraspConfig,
    GraspController,
    Phase,
)
from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite
from tactile_dynamics_ros.core.manipulation.squeeze import held_by
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.tracking.pose_fusion import average_poses
from tactile_dynamics_ros.ros.conversions import (
    JointReader,
    StampGate,
    joints_to_message,
    to_seconds,
    uncertain_pose_to_core,
    wrench_to_core,
)
from tactile_dynamics_ros.ros.emergency import EmergencyStop
from tactile_dynamics_ros.ros.friction_messages import friction_range
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    GRASP_PHASE,
    GRASP_START,
    JOINT_COMMAND,
    JOINT_STATES,
    OBJECT_HELD,
    PROBE_ACTIVE,
    PROBE_ESTIMATE,
    TARE,
    VISION_POSE,
    contact_topic,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.robot import declare_robot
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.wire import Joints, Stamped
from tactile_dynamics_ros.share import object_file

PERIOD = 0.01
PAUSE = 0.1
MOVED = 0.1
"""Angle between an arm joint and its last command, rad, beyond which somebody has moved the arm
since the stop: a drive that still follows lags by its largest speed (1.7 rad/s) times the 30 to
50 ms between command and measurement. The motion is not continued then but planned anew."""
OFF_THE_TABLE = (Phase.CARRY, Phase.EXCITE, Phase.RETURN)
IDLE = f"idle: call {GRASP_START}"


@dataclass(frozen=True)
class GraspNodeConfig:
    """What to grasp."""

    object: str = parameter("box_0", "file in config/objects, or a path, with the grasp site")
    start_poses: int = parameter(10, "poses from vision that are averaged to start", "", 2, 1000)
    pose_timeout: float = parameter(5.0, "nothing is grasped at a pose older than that", "s", 0.1)
    motion: str = parameter("", "file of a motion from `tactile-dynamics excite`; else sines")
    force_timeout: float = parameter(0.3, "a finger silent for longer has no contact", "s", 0.02)
    touch_lag: float = parameter(0.06, "the motion waits where touch is older", "s", 0.02)

    def __post_init__(self) -> None:
        check_ranges(self)


class GraspControllerNode(Shell):
    """Runs one cycle per call of grasp_controller/start, and commands nothing before.

    grasp_controller/phase and object/held say what it does. /emergency_stop ends all motion; a new
    call then goes on where the motion was interrupted, or plans anew if the arm was moved. A cycle
    that starts while the fingers hold an object leaves them as they are and moves the arm.
    """

    skimming = True  # it acts on the newest joint states and forces

    def __init__(self) -> None:
        super().__init__("grasp_controller")
        self.config = declare_config(self, GraspNodeConfig)
        self._behaviour_config = declare_config(self, GraspConfig)
        self._site = GraspSite.from_file(object_file(self.config.object))
        self._motion: SumOfSines | OffsetTable = SumOfSines(self._behaviour_config.excitation)
        if self.config.motion:
            self._motion = OffsetTable.from_file(Path(self.config.motion))
        self.robot = declare_robot(self)
        self.kinematics = HandKinematics(self.robot)
        self._reader = JointReader(self.kinematics.joint_names, followers=self.robot.followers)
        self._gate = StampGate(JOINT_STATES)
        self._phase_name = ""
        self._command = self.stream(JointState, JOINT_COMMAND)
        self._phase = self.latched(String, GRASP_PHASE)
        self._held = self.latched(Bool, OBJECT_HELD)
        self._tare = self.create_client(Trigger, TARE)
        self._forget(IDLE)
        self._emergency = EmergencyStop(self, self._stop)
        self.listen(JointState, JOINT_STATES, self._on_joints, skim=True, need=Need.ALWAYS)
        self.listen(PoseWithCovarianceStamped, VISION_POSE, self._on_vision)
        for finger in self.robot.fingers:
            topic = contact_topic(finger, "force")
            self.listen(WrenchStamped, topic, self._force_taker(finger), skim=True)
        self.listen(Bool, PROBE_ACTIVE, self._on_probe, LATCHED)
        self.listen(DiagnosticStatus, PROBE_ESTIMATE, self._on_friction, LATCHED)
        self.serve(GRASP_START, self.start)

    def start(self) -> str:
        """Begin a cycle, or go on with the one that the emergency stop interrupted.

        Raises:
            NotIdentifiableError: it may not or cannot begin now; says why.
        """
        self._emergency.require_released()
        if self._moving:
            raise NotIdentifiableError(f"grasp controller: already runs ({self._phase_name})")
        time, positions = self._require_touch()
        held = held_by(self.robot, self._touching(time), self._behaviour_config.hold_force)
        if self._is_where_it_stopped(positions) and (held or self._resumed is None):
            self._moving = True
            return "the interrupted motion goes on"
        if not held:
            self._require_pose(time)
        self._behaviour, self._resumed, self._arm, self._paused = None, None, None, 0.0
        self._moving = True
        return "the arm moves what is held" if held else f"grasping {self.config.object}"

    def _stop(self, why: str) -> None:
        """End all motion; the robot stays where it was last told to be."""
        if self._moving:
            self._moving = False
            self._announce("stopped", outcome=why)

    def _forget(self, phase: str) -> None:
        """Wait for a start, knowing nothing."""
        self._moving = False
        self._behaviour: GraspController | None = None
        self._resumed: tuple[float, ArmPath] | None = None
        self._arm: Array | None = None
        self._seen: deque[Array] = deque(maxlen=self.config.start_poses)
        self._pose: tuple[float, Array] | None = None
        self._forces: dict[str, tuple[float, Array]] = {}
        self._joints: tuple[float, Array] | None = None
        self._last, self._paused, self._probing = -np.inf, 0.0, False
        self._friction: float | None = None
        self._announce(phase)

    def _require_touch(self) -> tuple[float, Array]:
        """Return time and positions of the newest joint states, if touch is known too."""
        if self._joints is None:
            raise NotIdentifiableError(f"grasp controller: no {JOINT_STATES} yet")
        silent = [finger for finger in self.robot.fingers if finger not in self._forces]
        if silent:
            topic = contact_topic(silent[0], "force")
            raise NotIdentifiableError(f"grasp controller: no {topic} yet")
        return self._joints

    def _require_pose(self, time: float) -> None:
        """Check that the object's pose is known and new."""
        if self._pose is None:
            raise NotIdentifiableError(
                f"grasp controller: no object pose yet, {len(self._seen)} of "
                f"{self.config.start_poses} have come on {VISION_POSE}"
            )
        age = time - self._pose[0]
        if age > self.config.pose_timeout:
            raise NotIdentifiableError(
                f"grasp controller: the object pose on {VISION_POSE} is {age:.1f} s old, more than "
                f"pose_timeout {self.config.pose_timeout:g} s"
            )

    def _is_where_it_stopped(self, positions: Array) -> bool:
        """Whether a motion was interrupted and the arm is still where it was told to be."""
        if self._arm is None:
            return False
        return bool(np.max(np.abs(positions[: self.robot.arm_dof] - self._arm)) < MOVED)

    def _force_taker(self, finger: str) -> Callable[[Stamped], None]:
        topic = contact_topic(finger, "force")

        def take(message: Stamped) -> None:
            wrench = wrench_to_core(message, topic, "world")
            self._forces[finger] = (to_seconds(message.stamp), wrench[3:])

        return take

    def _on_vision(self, message: Stamped) -> None:
        self._seen.append(uncertain_pose_to_core(message, VISION_POSE, "world")[0])
        if len(self._seen) == self.config.start_poses:
            pose = average_poses(np.stack(self._seen))[0]
            self._pose = to_seconds(message.stamp), pose

    def _on_joints(self, message: Joints) -> None:
        positions = self._reader.positions(message)
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self._forget(f"{IDLE}; the clock restarted")
        self._joints = (to_seconds(message.stamp), positions)

    def _on_probe(self, message: Bool) -> None:
        """While the friction probe commands the hand, the motion waits."""
        self._probing = message.data

    def _on_friction(self, message: DiagnosticStatus) -> None:
        """Grip as the least friction that was measured asks for."""
        found = friction_range(message)
        if found is not None:
            self._friction = found[0]
            if self._behaviour is not None:
                self._behaviour.set_friction(self._friction)

    def process(self) -> None:
        """Act on the newest joint states, unless touch lags behind: then the motion pauses.

        After a pause all fingers' messages must have been taken, or some seem to have let go.
        """
        if self._joints is None or len(self._forces) < len(self.robot.fingers):
            return
        time, positions = self._joints
        newest = max(stamp for stamp, _ in self._forces.values())
        if time <= self._last or time - newest > self.config.touch_lag:
            return
        gap, self._last = time - self._last, time
        if not self._moving or self._probing:
            self._paused += gap if gap < np.inf else 0.0
            return
        if PAUSE < gap < np.inf:
            self.faults.add("paused", f"no touch or joint states for {gap:.2f} s; motion paused")
            self._paused += gap - PERIOD
        try:
            self._move(time, positions)
        except NotIdentifiableError as error:
            self._finish(Phase.FAILED.value, str(error))

    def _move(self, time: float, positions: Array) -> None:
        if self._resumed is not None:
            self._repeat(time)
        elif self._behaviour is not None:
            self._act(self._behaviour, time, positions)
        else:
            self._begin(time, positions)

    def _begin(self, time: float, positions: Array) -> None:
        """Decide whether something is already in the hand."""
        config = self._behaviour_config
        if held_by(self.robot, self._touching(time), config.hold_force):
            tips = self.kinematics.locate(positions).sensors[:, :3, 3]
            motion = self._motion
            path = excite(self.kinematics, positions, tips.mean(axis=0), motion, motion.duration)
            self._resumed = (time - self._paused, path)
            return
        if self._tare.service_is_ready():
            self._tare.call_async(Trigger.Request())
        self._behaviour = GraspController(
            self.kinematics, self._site, config, self._motion, self._motion.duration
        )
        if self._friction is not None:
            self._behaviour.set_friction(self._friction)

    def _act(self, behaviour: GraspController, time: float, positions: Array) -> None:
        pose = None if self._pose is None else self._pose[1]
        forces = self._touching(time)
        target = behaviour.update(time - self._paused, positions, forces, pose)
        if behaviour.done:
            self._finish(behaviour.phase.value, behaviour.outcome)
            return
        self._announce(behaviour.phase.value, behaviour.phase in OFF_THE_TABLE, behaviour.outcome)
        if behaviour.phase is not Phase.OPEN:
            self._arm = target[: self.robot.arm_dof]
            self._command.publish(joints_to_message(self.kinematics.joint_names, time, target))

    def _repeat(self, time: float) -> None:
        """Move the arm on, with the fingers left to hold as they do."""
        assert self._resumed is not None
        self._announce("resumed", held=True)
        start, path = self._resumed
        self._arm = path((time - self._paused - start) % path.duration)
        names = self.kinematics.joint_names[: self.robot.arm_dof]
        self._command.publish(joints_to_message(names, time, self._arm))

    def _finish(self, phase: str, outcome: str) -> None:
        """End a cycle; the next start begins a new one."""
        self._moving, self._behaviour, self._resumed, self._arm = False, None, None, None
        self._announce(phase, held=False, outcome=outcome)

    def _touching(self, time: float) -> dict[str, Array]:
        limit = self.config.force_timeout
        recent = {f: force for f, (last, force) in self._forces.items() if time - last < limit}
        return {finger: force for finger, force in recent.items() if force.any()}

    def _announce(self, phase: str, held: bool | None = None, outcome: str = "") -> None:
        """Publish the phase when it changes, and whether the object is off the table if known."""
        if phase == self._phase_name:
            return
        self._phase_name = phase
        text = f"{phase}: {outcome}" if outcome else phase
        self.get_logger().info(text)
        self._phase.publish(String(data=text))
        if held is not None:
            self._held.publish(Bool(data=held))


def main() -> int:
    """Run the node."""
    return run_node(GraspControllerNode)
