"""Node: one finger measures the friction of the held object while the others hold it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Bool, String

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.friction.probe import FrictionProbe
from tactile_dynamics_ros.core.friction.probe_config import (
    FrictionProbeConfig,
    ProbeContact,
    ProbeInput,
)
from tactile_dynamics_ros.core.friction.slip_detection import ElectrodeMotion
from tactile_dynamics_ros.core.reading import read_yaml
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics, Standstill
from tactile_dynamics_ros.core.shape.friction_regions import ObjectSurface
from tactile_dynamics_ros.core.streams.streams import ContactSample
from tactile_dynamics_ros.core.tracking.pose_fusion import average_poses
from tactile_dynamics_ros.ros.actions import Action
from tactile_dynamics_ros.ros.conversions import (
    JointReader,
    StampGate,
    biotac_to_core,
    joints_to_message,
    std_to_core,
    to_seconds,
    uncertain_pose_to_core,
)
from tactile_dynamics_ros.ros.diagnostics import status_message, status_values
from tactile_dynamics_ros.ros.emergency import EmergencyStop
from tactile_dynamics_ros.ros.friction_messages import (
    ContactAssembly,
    estimate_document,
    estimate_status,
    result_fields,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    BIOTAC_RAW,
    GRASP_PHASE,
    JOINT_COMMAND,
    JOINT_STATES,
    PROBE,
    PROBE_ACTIVE,
    PROBE_ESTIMATE,
    PROBE_PROGRESS,
    PROBE_SLIP,
    VISION_POSE,
    fingertip_topic,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.robot import declare_robot
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.stream_clock import StreamClock
from tactile_dynamics_ros.ros.wire import Joints, Picture, Stamped
from tactile_dynamics_ros.share import object_file

POSES = 20
REST_FRAMES = 30
IDLE = 0.1
RELIABLE = 10
REST = 0.3
"""Time of the stamps for which the hand must have stood still before a probe, s: three looks at
the joints while nothing is probed, and more than a command takes to arrive. A probe that begins
while the object moves is ended by that motion; less would take the turn of a motion for rest."""


@dataclass(frozen=True)
class ProbeNodeConfig:
    """What is probed, and which pose of it is used."""

    object: str = parameter("box_0", "file in config/objects, or a path, with shapes and regions")
    mesh: str = parameter("", "mesh file (STL, OBJ, PLY; m) that replaces the shapes")
    pose_topic: str = parameter(VISION_POSE, "pose of the object")
    touch_lag: float = parameter(0.06, "the probe waits where touch is older", "s", 0.02)
    contact_timeout: float = parameter(0.3, "a finger silent for longer does not touch", "s", 0.02)

    def __post_init__(self) -> None:
        check_ranges(self)


class FrictionProbeNode(Shell):
    """Answers friction_probe/probe at once; commands the hand's joints until the probe has ended.

    friction_probe/active tells whoever commands the hand otherwise to wait.
    """

    by_arrival = True

    def __init__(self) -> None:
        super().__init__("friction_probe")
        self.config = declare_config(self, ProbeNodeConfig)
        probe_config = declare_config(self, FrictionProbeConfig)
        description = read_yaml(object_file(self.config.object), "a yaml file of an object")
        surface = ObjectSurface.from_mapping(description)
        if self.config.mesh:
            surface = ObjectSurface.from_file(self.config.mesh, surface.regions)
        self.robot = declare_robot(self)
        self.robot.require_tips("biotac", "friction_probe")
        self.kinematics = HandKinematics(self.robot)
        self.probe = FrictionProbe(self.kinematics, surface, probe_config)
        self._reader = JointReader(self.kinematics.joint_names, followers=self.robot.followers)
        self._gate = StampGate(JOINT_STATES)
        self._contacts: dict[str, ContactSample] = {}
        self._poses: deque[tuple[float, Array]] = deque(maxlen=POSES)
        self._still, self._phase = Standstill(), ""
        self._positions: tuple[float, Array] | None = None
        self._targets: dict[str, float] = {}
        self._vibration: float | None = None
        self._motion, self._rest = ElectrodeMotion(), deque[Array](maxlen=REST_FRAMES)
        self._electrodes: float | None = None
        self._slip_topic = fingertip_topic(probe_config.finger, "slip")
        self._told, self._acted = ("", -1), -np.inf
        self._command = self.stream(JointState, JOINT_COMMAND)
        self._active = self.latched(Bool, PROBE_ACTIVE)
        self._progress = self.latched(DiagnosticStatus, PROBE_PROGRESS)
        self._estimate = self.latched(DiagnosticStatus, PROBE_ESTIMATE)
        self._slips = self.create_publisher(DiagnosticStatus, PROBE_SLIP, RELIABLE)
        self.listen(JointState, JOINT_STATES, self._on_joints, skim=True, need=Need.ALWAYS)
        self.listen(JointState, JOINT_COMMAND, self._on_command)
        topic = self.config.pose_topic
        self.listen(PoseWithCovarianceStamped, topic, self._on_pose, need=Need.ONCE)
        self.listen(Vector3Stamped, self._slip_topic, self._on_slip)
        self.listen(Image, BIOTAC_RAW, self._on_raw)
        self.listen(String, GRASP_PHASE, self._on_phase, LATCHED)
        self._emergency = EmergencyStop(self, self._stop)
        clock = StreamClock(self)
        self._assemblies = [
            ContactAssembly(self, f, self._taker(f), clock) for f in self.robot.fingers
        ]
        self.serve(PROBE, self.start)
        self.action = Action(
            self, "Probe", PROBE, lambda _: self.start(), lambda: self._stop("canceled")
        )

    def start(self) -> str:
        """Start a probe, or say why not."""
        self._emergency.require_released()
        if self.probe.running:
            raise NotIdentifiableError(f"friction probe: already runs ({self.probe.phase.value})")
        self._require_rest()
        seen = self._see()
        if seen is None:
            raise NotIdentifiableError(f"friction probe: {self._missing()}")
        targets = [self._targets.get(name, q) for name, q in self._named(seen.positions)]
        self.probe.start(seen, np.array(targets))
        self._active.publish(Bool(data=True))
        self._told = ("", -1)
        self._tell()
        return f"probing with the {self.probe.config.finger} finger; watch {PROBE_PROGRESS}"

    def _require_rest(self) -> None:
        """Check that the hand stands still, and forget where the object was before it did.

        Raises:
            NotIdentifiableError: it moves.
        """
        if self._positions is None:
            return
        rested = self._positions[0] - self._still.since
        if rested < REST:
            phase = f" (grasp_controller: {self._phase})" if self._phase else ""
            raise NotIdentifiableError(
                f"friction probe: the hand moves{phase}; call again when it has stood still for "
                f"{REST:g} s with the object in it"
            )
        while self._poses and self._poses[0][0] < self._still.since:
            self._poses.popleft()

    @property
    def gather(self) -> float:
        """Pause after a first message, s: long while nothing is probed."""
        return Shell.gather if self.probe.running else IDLE

    @property
    def skimming(self) -> bool:
        """Whether only the newest readings matter: while nothing is probed."""
        return not self.probe.running

    def destroy_node(self) -> None:
        """Leave the hand where it is told to be."""
        self._active.publish(Bool(data=False))
        self.action.close()
        super().destroy_node()

    def _taker(self, finger: str) -> Callable[[ContactSample], None]:
        def take(contact: ContactSample) -> None:
            self._contacts[finger] = contact

        return take

    def _on_pose(self, message: Stamped) -> None:
        pose = uncertain_pose_to_core(message, self.config.pose_topic, "world")[0]
        self._poses.append((to_seconds(message.stamp), pose))

    def _on_phase(self, message: String) -> None:
        self._phase = message.data

    def _on_slip(self, message: Stamped) -> None:
        self._vibration = float(std_to_core(message, self._slip_topic)[1])

    def _on_raw(self, message: Picture) -> None:
        """Follow the electrodes of the probing finger, at rest while it touches nothing."""
        finger = self.probe.config.finger
        counts = self._counts(message)[self.robot.finger_index(finger)]
        contact = self._contacts.get(finger)
        if contact is None or contact.force.any():
            self._rest.clear()
        else:
            self._rest.append(counts)
        if len(self._rest) == REST_FRAMES:
            self._motion.tare(np.stack(self._rest))
            self._rest.clear()
        self._electrodes = self._motion.update(counts)

    def _counts(self, message: Picture) -> Array:
        return biotac_to_core(message, BIOTAC_RAW, len(self.robot.fingers))

    def _on_command(self, message: Joints) -> None:
        if not self.probe.running:
            self._targets |= dict(zip(message.names, message.positions.tolist(), strict=False))

    def _stop(self, why: str) -> None:
        """End a probe at once; the hand stays where it is told to be."""
        if self.probe.running:
            self.probe.halt(why)
            self._tell()

    def _on_joints(self, message: Joints) -> None:
        positions = self._reader.positions(message)
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self.probe.halt("the clock restarted")
            self._contacts.clear()
            self._poses.clear()
            self._still.clear()
            self._acted = -np.inf
        self._positions = (to_seconds(message.stamp), positions)
        self._still.update(*self._positions)

    def process(self) -> None:
        """Act once on the newest joint states, as soon as touch is as new, or surely stale."""
        seen = self._see() if self.probe.running else None
        if seen is None or seen.time <= self._acted:
            return
        late = seen.time - seen.touch_time
        if self.config.touch_lag < late <= self.probe.config.stale_time:
            return
        self._acted = seen.time
        hand = self.probe.update(seen)[self.robot.arm_dof :]
        names = self.kinematics.joint_names[self.robot.arm_dof :]
        self._command.publish(joints_to_message(names, seen.time, hand))
        self._tell()

    def _named(self, positions: Array) -> list[tuple[str, float]]:
        return list(zip(self.kinematics.joint_names, positions.tolist(), strict=True))

    def _see(self) -> ProbeInput | None:
        """Return what is known now, or None while something is missing."""
        if self._positions is None or not self._contacts or len(self._poses) < 2:
            return None
        time, positions = self._positions
        touching = {
            finger: ProbeContact(c.point, c.force, np.full(3, 0.05) if c.std is None else c.std)
            for finger, c in self._contacts.items()
            if time - c.time < self.config.contact_timeout and c.force.any()
        }
        newest = max(contact.time for contact in self._contacts.values())
        pose = np.asarray(average_poses(np.stack([pose for _, pose in self._poses]))[0])
        return ProbeInput(
            time, newest, positions, touching, pose, self._vibration, self._electrodes
        )

    def _missing(self) -> str:
        if self._positions is None:
            return f"no {JOINT_STATES} yet"
        if len(self._poses) < 2:
            return f"no {self.config.pose_topic} yet since the hand stands still"
        return "the object is not held"

    def _tell(self) -> None:
        """Publish progress, slips and estimate when they change."""
        probe = self.probe
        state = (probe.phase.value, len(probe.events))
        if state == self._told:
            return
        for event in probe.events[max(self._told[1], 0) :]:
            self._slips.publish(status_message("slip", asdict(event) | {"ratio": event.ratio}))
        values = {"phase": state[0], "slips": state[1], "tried": probe.tried}
        level = DiagnosticStatus.WARN if probe.outcome else DiagnosticStatus.OK
        self._progress.publish(status_message("friction_probe", values, level, probe.outcome))
        self.action.tell(state[0], probe.tried / probe.config.most_slips, f"{state[1]} slips")
        if state[1] != self._told[1] or probe.done:
            estimate = estimate_status(probe.estimates(), probe.done, probe.outcome)
            self._estimate.publish(estimate)
        if probe.done:
            self._active.publish(Bool(data=False))
            told = estimate_document(status_values(estimate), estimate.message)
            regions = told["regions"]
            self.action.end(bool(regions), told["message"], told, **result_fields(regions))
        self._told = state


def main() -> int:
    """Run the node."""
    return run_node(FrictionProbeNode)
