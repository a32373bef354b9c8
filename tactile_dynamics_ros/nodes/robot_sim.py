"""Node: a simulated robot behind the topics of the real one, paced to real time."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Float64, String

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.ros.arm_scene import ArmScene
from tactile_dynamics_ros.ros.camera_motion import DepthStreams
from tactile_dynamics_ros.ros.conversions import (
    JointReader,
    MessageError,
    biotac_to_message,
    joints_to_message,
    pose_to_core,
    pose_to_message,
    std_to_message,
    to_seconds,
    uncertain_pose_to_message,
    wrench_to_message,
)
from tactile_dynamics_ros.ros.names import (
    BEGIN,
    BIOTAC_RAW,
    CAMERA_POSE,
    CAMERA_TARGET,
    CLOCK,
    GRIPPER_TARGET,
    JOINT_COMMAND,
    JOINT_STATES,
    PROPERTY_STATUS,
    PUSHER_TARGET,
    REVEAL,
    ROBOT_DESCRIPTION,
    SUPPORT_POSE,
    VISION_POSE,
    WRIST_WRENCH,
    fingertip_topic,
)
from tactile_dynamics_ros.ros.pacing import DelayLine, Pace, PaceConfig
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.pusher_streams import (
    ContactStreams,
    LinkStreams,
    PusherStreams,
    SensedConfig,
    SensorStreams,
)
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.wire import Joints, Stamp, Stamped, encode_clock, to_stamp

if TYPE_CHECKING:
    from tactile_dynamics_ros.sim.planar.simulated_table import TableReadings
    from tactile_dynamics_ros.sim.simulated_robot import Readings


PERIOD = 0.01
AHEAD = 2.0
"""A command that is stamped further ahead, s, is refused."""
UPRIGHT = 0.99
"""Cosine of the lean of a target of the pusher that is taken for upright: 8 deg, more than tables
lean; beyond it somebody means another gripper."""


@dataclass(frozen=True)
class SceneConfig:
    """What is simulated; each scene has parameters of its own."""

    scene: str = parameter(
        "hand",
        "hand: arm, hand and object; table: objects, a moving camera, an arm that pushes; arm: a "
        "wrist sensor, a tool and a load",
    )
    place_contacts: bool = parameter(
        True, "of an arm that pushes: publish contacts in the world, not forces of sensors"
    )

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.scene not in SCENES:
            raise BadInputError(f"scene '{self.scene}': expected one of {', '.join(SCENES)}")


class Scene(Protocol):
    """A stand-in for the hardware with its topics."""

    @property
    def time(self) -> float:
        """Simulated time, s."""

    def advance(self) -> Any:
        """Simulate one period and return what the sensors read then."""

    def publish(self, readings: Any) -> None:
        """Publish what the sensors read, or keep it until it is due."""

    def reveal(self) -> dict[str, Any]:
        """Return the truth as plain numbers."""


class RobotSim(Shell):
    """Simulates 10 ms, publishes what the sensors say, waits until that time has passed.

    Where the machine is too slow, simulated time falls behind real time: nothing is skipped, and
    the simulation waits for each command of a controller that is at work.

    Attributes:
        late: messages that are due later, with their publishers.
        pace: couples simulated to real time.
        shown: which scene is simulated.
    """

    gather = 0.0
    """Few messages come, and all others wait for the next step."""

    def __init__(self) -> None:
        super().__init__("robot_sim")
        self.config = declare_config(self, PaceConfig)
        self.late: DelayLine[tuple[Publisher, object]] = DelayLine()
        self.pace = Pace(self.config)
        self.shown = declare_config(self, SceneConfig)
        self.scene: Scene = SCENES[self.shown.scene](self)
        self._ticks = self.create_publisher(Clock, CLOCK, 10)
        self.serve(REVEAL, lambda: json.dumps(self.scene.reveal() | self.pace.counts()))
        self.every(PERIOD / self.config.real_time_factor, self._tick)
        self.every(2.0, self._measure_pace)

    def _tick(self) -> None:
        """Advance until simulated time has caught up with real time, in bounded steps."""
        for _ in range(3):
            if self.pace.must_wait(self.scene.time):
                return
            readings = self.scene.advance()
            self._ticks.publish(encode_clock(to_stamp(self.scene.time)))
            self.scene.publish(readings)
            for publisher, message in self.late.take(self.scene.time):
                publisher.publish(message)

    def _measure_pace(self) -> None:
        self.faults.show("real_time_factor", round(self.pace.measure(self.scene.time), 4))


class TableScene:
    """Objects on a table, an arm with a camera, and an arm that pushes where it is told.

    Images are rendered only while somebody subscribes to them. Targets are executed like joint
    commands of the hand: a fixed time after their stamp.

    Args:
        node: that publishes.
    """

    def __init__(self, node: RobotSim) -> None:
        from tactile_dynamics_ros.sim.planar.simulated_table import (
            SimulatedTable,
            SimulatedTableConfig,
        )

        self.node = node
        self.table = SimulatedTable(declare_config(node, SimulatedTableConfig), PERIOD)
        self.reveal = self.table.reveal
        node.serve(BEGIN, self.table.begin)
        self._depth = DepthStreams(
            node, self.table.camera.config, node.late, node.config.vision_latency
        )
        self._camera_pose = node.stream(PoseStamped, CAMERA_POSE)
        self._pusher, self._joints = PusherStreams(node), node.stream(JointState, JOINT_STATES)
        streams = ContactStreams if node.shown.place_contacts else SensorStreams
        self._sensed = declare_config(node, SensedConfig).contacts
        self._touch = streams(node, self._sensed)
        self._links: LinkStreams | None = None
        if self.table.config.vision_rate_hz > 0.0:
            self._links = LinkStreams(node, [link.corners for link in self.table.outlines])
        support = node.latched(PoseStamped, SUPPORT_POSE)
        support.publish(pose_to_message(self.table.support, 0.0, "world"))
        machine = self.table.pusher.machine
        node.latched(String, ROBOT_DESCRIPTION).publish(String(data=machine.urdf))
        node.listen(PoseStamped, CAMERA_TARGET, self._on_target)
        node.listen(PoseStamped, PUSHER_TARGET, self._on_pusher_target)
        node.listen(Float64, GRIPPER_TARGET, self._on_gripper_target)
        node.listen(DiagnosticArray, PROPERTY_STATUS, node.pace.note_estimate, LATCHED)
        self._targets: DelayLine[Array] = DelayLine()
        self._fault = ""

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.table.world.time

    def advance(self) -> TableReadings:
        """Execute the targets that are due, and simulate one period."""
        for target in self._targets.take(self.time):
            self.table.pusher.go_to(target)
        return self.table.advance(looking=self._depth.heard)

    def publish(self, readings: TableReadings) -> None:
        """Publish what arm, tip and pads, tracker and camera say, or keep it until it is due."""
        self._camera_pose.publish(pose_to_message(readings.camera_pose, readings.time, "world"))
        self._pusher.publish(readings.pusher, readings.width, readings.time)
        names, joints = self.table.pusher.machine.joint_names, readings.joints
        load = np.zeros(len(joints))
        self._joints.publish(joints_to_message(names, readings.time, joints, readings.rates, load))
        late, config = self.node.late, self.node.config
        for measured in (measured for measured in readings.touch if measured.name in self._sensed):
            for entry in self._touch.report(
                measured, self.table.sensors.force_std, readings.pusher
            ):
                late.add(readings.time + config.touch_latency, entry)
        if self._links is not None and readings.links:
            covariance = self.table.markers[0].covariance
            for entry in self._links.messages(readings.links, covariance, readings.links_time):
                late.add(readings.time + config.vision_latency, entry)
        if readings.depth is not None:
            self._depth.add(readings.depth, readings.time)
        if self.table.pusher.fault != self._fault:
            self._fault = self.table.pusher.fault
            if self._fault:
                self.node.faults.add("pusher_stopped", self._fault)

    def _on_target(self, message: Stamped) -> None:
        self.table.carriage.go_to(pose_to_core(message, CAMERA_TARGET, "world"))

    def _on_pusher_target(self, message: Stamped) -> None:
        target = pose_to_core(message, PUSHER_TARGET, "world")
        if target[2, 2] < UPRIGHT:
            text = f"{PUSHER_TARGET}: z does not point up; this gripper points down and only turns"
            raise MessageError("not_upright", text)
        stamp = _checked_stamp(message.stamp, self.time, PUSHER_TARGET)
        self._targets.add(stamp + self.node.config.command_latency, target)
        self.node.pace.note_command(stamp, self.time)

    def _on_gripper_target(self, message: Float64) -> None:
        if not np.isfinite(message.data):
            raise MessageError("not_finite", f"{GRIPPER_TARGET}: {message.data}")
        self.table.pusher.open_to(message.data)


class HandScene:
    """Arm, hand and an object.

    A command is executed a fixed time after its stamp (at once if it comes later or bears none), as
    drives do that follow setpoints by their clock: messages that come in bursts do not make the
    motion jerk. One that is stamped more than 2 s ahead is refused.

    Args:
        node: that publishes.
    """

    def __init__(self, node: RobotSim) -> None:
        # here, so that a robot without the extra [sim] is told in one line what is missing
        from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobot, SimulatedRobotConfig

        self.node, self.config = node, node.config
        self.robot = SimulatedRobot(declare_config(node, SimulatedRobotConfig), PERIOD)
        self.machine = self.robot.machine
        self.reveal = self.robot.reveal
        self._reader: dict[tuple[str, ...], JointReader] = {}
        self._joints = node.stream(JointState, JOINT_STATES)
        self._raw = node.stream(Image, BIOTAC_RAW)
        self._pads = [self._pad_streams(f) for f in self.machine.fingers if self._has_pads]
        self._wrist = node.stream(WrenchStamped, WRIST_WRENCH)
        self._vision = node.stream(PoseWithCovarianceStamped, VISION_POSE)
        self._depth = DepthStreams(
            node, self.robot.camera.config, node.late, node.config.vision_latency
        )
        node.latched(String, ROBOT_DESCRIPTION).publish(String(data=self.machine.urdf))
        node.listen(JointState, JOINT_COMMAND, self._on_command)
        self._commands: DelayLine[tuple[Array, tuple[str, ...]]] = DelayLine()

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.robot.world.time

    def advance(self) -> Readings:
        """Execute the commands that are due, and simulate one period."""
        for target, names in self._commands.take(self.time):
            self.robot.world.command(target, names)
        return self.robot.advance()

    def publish(self, readings: Readings) -> None:
        """Publish what the sensors say."""
        self._joints.publish(
            joints_to_message(
                self.machine.joint_names,
                readings.joint_time,
                readings.position,
                readings.velocity,
                readings.effort,
            )
        )
        self._wrist.publish(wrench_to_message(readings.wrist, readings.time, self.machine.flange))
        if readings.wrist_saturated:
            self.node.faults.add("wrist_saturated")
        for entry in self._touch(readings):
            self.node.late.add(readings.time + self.config.touch_latency, entry)
        if readings.vision is not None:
            covariance = self.robot.marker.covariance
            pose = uncertain_pose_to_message(
                readings.vision, covariance, readings.joint_time, "world"
            )
            due = readings.time + self.config.vision_latency
            self.node.late.add(due, (self._vision, pose))
        if readings.depth is not None:
            self._depth.add(readings.depth, readings.time)

    @property
    def _has_pads(self) -> bool:
        return self.machine.tips.kind == "pad"

    def _pad_streams(self, finger: str) -> tuple[Publisher, Publisher]:
        force, std = (fingertip_topic(finger, kind, "pad") for kind in ("force", "force_std"))
        return self.node.stream(WrenchStamped, force), self.node.stream(Vector3Stamped, std)

    def _touch(self, readings: Readings) -> list[tuple[Publisher, object]]:
        """Return what the fingertips say, with the publishers that say it."""
        stamp = readings.touch_time
        if readings.counts is not None:
            return [(self._raw, biotac_to_message(readings.counts, stamp, "hand"))]
        told: list[tuple[Publisher, object]] = []
        known = self.robot.tips.force_std
        rows = zip(self.machine.hand, self._pads, readings.wrenches, strict=True)
        for finger, (force, std), wrench in rows:
            told.append((std, std_to_message(known, stamp, finger.sensor)))
            told.append((force, wrench_to_message(wrench, stamp, finger.sensor)))
        return told

    def _on_command(self, message: Joints) -> None:
        names = message.names
        unknown = [name for name in names if name not in self.machine.joint_names]
        if unknown:
            raise MessageError("unknown_joint", f"{JOINT_COMMAND}: no joint '{unknown[0]}'")
        reader = self._reader.setdefault(names, JointReader(names, JOINT_COMMAND))
        stamp = _checked_stamp(message.stamp, self.time, JOINT_COMMAND)
        self._commands.add(stamp + self.config.command_latency, (reader.positions(message), names))
        self.node.pace.note_command(stamp, self.time)


def _arm_scene(node: RobotSim) -> Scene:
    from tactile_dynamics_ros.sim.carrying_arm import CarryingArm, CarryingArmConfig

    return ArmScene(node, CarryingArm(declare_config(node, CarryingArmConfig), PERIOD))


SCENES: dict[str, Callable[[RobotSim], Scene]] = {
    "hand": HandScene,
    "table": TableScene,
    "arm": _arm_scene,
}


def _checked_stamp(stamp: Stamp, now: float, topic: str) -> float:
    """Return the stamp of a command, s.

    Raises:
        MessageError: it is far ahead of simulated time.
    """
    seconds = to_seconds(stamp)
    if seconds - now > AHEAD:
        text = (
            f"{topic}: stamped {seconds - now:.3g} s ahead of /clock: stamp commands with "
            "simulated time (it may also be left from before a restart)"
        )
        raise MessageError("command_ahead", text)
    return seconds


def main() -> int:
    """Run the node."""
    return run_node(RobotSim)
