"""Node: the behaviour that grasps, lifts and moves the object, as joint commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.hand_kinematics import ARM_DOF, HandKinematics
from tactile_dynamics_ros.core.contact.robot_description import FINGERS
from tactile_dynamics_ros.core.manipulation.arm_path import ArmPath, excite
from tactile_dynamics_ros.core.manipulation.excitation import OffsetTable, SumOfSines
from tactile_dynamics_ros.core.manipulation.grasp_controller import (
    GraspConfig,
    GraspController,
    Phase,
)
from tactile_dynamics_ros.core.manipulation.grasp_site import GraspSite
from tactile_dynamics_ros.core.manipulation.squeeze import held_by
from tactile_dynamics_ros.core.tracking.pose_average import average_poses
from tactile_dynamics_ros.nodes.conversions import (
    JointReader,
    StampGate,
    joints_to_message,
    to_seconds,
    uncertain_pose_to_core,
    wrench_to_core,
)
from tactile_dynamics_ros.nodes.friction_messages import friction_range
from tactile_dynamics_ros.nodes.parameters import declare_config
from tactile_dynamics_ros.nodes.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.nodes.wire import Joints, Stamped
from tactile_dynamics_ros.recording.topics import VISION_POSE
from tactile_dynamics_ros.share import object_file

Array = NDArray[np.float64]

PERIOD = 0.01
PAUSE = 0.1
OFF_THE_TABLE = (Phase.CARRY, Phase.EXCITE, Phase.RETURN)


@dataclass(frozen=True)
class GraspNodeConfig:
    """What to grasp."""

    object: str = parameter("box_0", "file in config/objects, or a path, with the grasp site")
    start_poses: int = parameter(10, "poses from vision that are averaged to start", "", 2, 1000)
    motion: str = parameter("", "file of a motion from `tactile-dynamics excite`; else sines")
    force_timeout: float = parameter(0.3, "a finger silent for longer has no contact", "s", 0.02)
    touch_lag: float = parameter(0.06, "the motion waits where touch is older", "s", 0.02)

    def __post_init__(self) -> None:
        check_ranges(self)


class GraspControllerNode(Shell):
    """Runs one cycle per start; says what it does on /grasp_controller/phase and /object/held.

    A node that starts while the fingers hold an object leaves them as they are and goes on moving
    the arm.
    """

    skimming = True  # it acts on the newest joint states and forces

    def __init__(self) -> None:
        super().__init__("grasp_controller")
        self.config = declare_config(self, GraspNodeConfig)
        self._behaviour_config = declare_config(self, GraspConfig)
        path = object_file(self.config.object)
        self._site = GraspSite.from_mapping(yaml.safe_load(path.read_text())["grasp"])
        self._motion: SumOfSines | OffsetTable = SumOfSines(self._behaviour_config.excitation)
        if self.config.motion:
            self._motion = OffsetTable.from_file(Path(self.config.motion))
        self.kinematics = HandKinematics()
        self._reader = JointReader(self.kinematics.joint_names)
        self._gate = StampGate("/joint_states")
        self._phase_name = ""
        self._command = self.stream(JointState, "/joint_command")
        self._phase = self.latched(String, "/grasp_controller/phase")
        self._held = self.latched(Bool, "/object/held")
        self._tare = self.create_client(Trigger, "/biotac_force/tare")
        self.start()
        self.listen(JointState, "/joint_states", self._on_joints, skim=True)
        self.listen(PoseWithCovarianceStamped, VISION_POSE, self._on_vision)
        for finger in FINGERS:
            topic = f"/contact/{finger}/force"
            self.listen(WrenchStamped, topic, self._force_taker(finger), skim=True)
        self.listen(Bool, "/friction_probe/active", self._on_probe, LATCHED)
        self.listen(DiagnosticStatus, "/friction_probe/estimate", self._on_friction, LATCHED)
        self.serve("/grasp_controller/start", self.start)

    def start(self) -> str:
        """Begin a new cycle as soon as touch and object pose are known."""
        self._behaviour: GraspController | None = None
        self._resumed: tuple[float, ArmPath] | None = None
        self._seen: deque[Array] = deque(maxlen=self.config.start_poses)
        self._pose: Array | None = None
        self._forces: dict[str, tuple[float, Array]] = {}
        self._waiting: tuple[float, Array] | None = None
        self._last, self._paused, self._probing = -np.inf, 0.0, False
        self._friction: float | None = None
        return "a new cycle begins"

    def _force_taker(self, finger: str) -> Callable[[Stamped], None]:
        topic = f"/contact/{finger}/force"

        def take(message: Stamped) -> None:
            wrench = wrench_to_core(message, topic, "world")
            self._forces[finger] = (to_seconds(message.stamp), wrench[3:])

        return take

    def _on_vision(self, message: Stamped) -> None:
        self._seen.append(uncertain_pose_to_core(message, VISION_POSE, "world")[0])
        if len(self._seen) == self.config.start_poses:
            self._pose = average_poses(np.stack(self._seen))[0]

    def _on_joints(self, message: Joints) -> None:
        positions = self._reader.positions(message)
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self.start()
        self._waiting = (to_seconds(message.stamp), positions)

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
        if self._waiting is None or len(self._forces) < len(FINGERS):
            return
        time, positions = self._waiting
        if time - max(stamp for stamp, _ in self._forces.values()) > self.config.touch_lag:
            return
        self._waiting = None
        gap = time - self._last
        if PAUSE < gap < np.inf:
            self.faults.add("paused", f"no touch or joint states for {gap:.2f} s; motion paused")
            self._paused += gap - PERIOD
        self._last = time
        if self._probing:
            self._paused += 0.0 if gap > PAUSE else gap
            return
        if self._resumed is not None:
            self._repeat(time)
        elif self._behaviour is not None:
            self._act(self._behaviour, time, positions)
        else:
            self._begin(time, positions)

    def _begin(self, time: float, positions: Array) -> None:
        """Decide whether something is already in the hand."""
        config = self._behaviour_config
        if held_by(self._touching(time), config.hold_force):
            tips = self.kinematics.locate(positions).sensors[:, :3, 3]
            motion = self._motion
            path = excite(self.kinematics, positions, tips.mean(axis=0), motion, motion.duration)
            self._resumed = (time - self._paused, path)
            self._announce("resumed", held=True)
            return
        if self._tare.service_is_ready():
            self._tare.call_async(Trigger.Request())
        self._behaviour = GraspController(
            self.kinematics, self._site, config, self._motion, self._motion.duration
        )
        if self._friction is not None:
            self._behaviour.set_friction(self._friction)

    def _act(self, behaviour: GraspController, time: float, positions: Array) -> None:
        forces = self._touching(time)
        target = behaviour.update(time - self._paused, positions, forces, self._pose)
        self._announce(behaviour.phase.value, behaviour.phase in OFF_THE_TABLE, behaviour.outcome)
        if not behaviour.done and behaviour.phase is not Phase.OPEN:
            self._command.publish(joints_to_message(self.kinematics.joint_names, time, target))

    def _repeat(self, time: float) -> None:
        """Move the arm on, with the fingers left to hold as they do."""
        assert self._resumed is not None
        start, path = self._resumed
        arm = path((time - self._paused - start) % path.duration)
        names = self.kinematics.joint_names[:ARM_DOF]
        self._command.publish(joints_to_message(names, time, arm))

    def _touching(self, time: float) -> dict[str, Array]:
        limit = self.config.force_timeout
        recent = {f: force for f, (last, force) in self._forces.items() if time - last < limit}
        return {finger: force for finger, force in recent.items() if force.any()}

    def _announce(self, phase: str, held: bool, outcome: str = "") -> None:
        """Publish the phase and whether the object is off the table when it changes."""
        if phase == self._phase_name:
            return
        self._phase_name = phase
        text = f"{phase}: {outcome}" if outcome else phase
        self.get_logger().info(text)
        self._phase.publish(String(data=text))
        self._held.publish(Bool(data=held))


def main() -> int:
    """Run the node."""
    return run_node(GraspControllerNode)
