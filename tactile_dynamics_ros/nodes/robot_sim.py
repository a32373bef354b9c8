"""Node: the simulated robot behind the topics of the real one, paced to real time."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import String

from tactile_dynamics_ros.ros.conversions import (
    JointReader,
    MessageError,
    biotac_to_message,
    camera_info,
    depth_to_message,
    joints_to_message,
    std_to_message,
    to_seconds,
    uncertain_pose_to_message,
    wrench_to_message,
)
from tactile_dynamics_ros.ros.names import (
    BIOTAC_RAW,
    CAMERA_INFO,
    CLOCK,
    DEPTH_IMAGE,
    JOINT_COMMAND,
    JOINT_STATES,
    REVEAL,
    ROBOT_DESCRIPTION,
    VISION_POSE,
    WRIST_WRENCH,
    fingertip_topic,
)
from tactile_dynamics_ros.ros.pacing import DelayLine, Pace, PaceConfig
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import Shell, run_node
from tactile_dynamics_ros.ros.wire import Joints, encode_clock, to_stamp

if TYPE_CHECKING:
    from tactile_dynamics_ros.sim.simulated_robot import Readings

Array = NDArray[np.float64]

PERIOD = 0.01
AHEAD = 2.0
"""A command that is stamped further ahead, s, is refused."""

CAMERA_FRAME = "camera_depth_optical_frame"


class RobotSim(Shell):
    """Simulates 10 ms, publishes what the sensors say, waits until that time has passed.

    Where the machine is too slow, simulated time falls behind real time; nothing is skipped, and
    the simulation waits for a controller that is working but late. A command is executed a fixed
    time after its stamp (at once if it comes later or bears none), as drives do that follow
    setpoints by their clock: messages that come in bursts do not make the motion jerk. One that is
    stamped more than 2 s ahead is refused.
    """

    gather = 0.0
    """Few messages come, and all others wait for the next step."""

    def __init__(self) -> None:
        # here, so that a robot without the extra [sim] is told in one line what is missing
        from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobot, SimulatedRobotConfig

        super().__init__("robot_sim")
        self.config = declare_config(self, PaceConfig)
        self.robot = SimulatedRobot(declare_config(self, SimulatedRobotConfig), PERIOD)
        self.machine = self.robot.machine
        self._reader: dict[tuple[str, ...], JointReader] = {}
        self._ticks = self.create_publisher(Clock, CLOCK, 10)
        self._joints = self.stream(JointState, JOINT_STATES)
        self._raw = self.stream(Image, BIOTAC_RAW)
        self._pads = [self._pad_streams(f) for f in self.machine.fingers if self._has_pads]
        self._wrist = self.stream(WrenchStamped, WRIST_WRENCH)
        self._vision = self.stream(PoseWithCovarianceStamped, VISION_POSE)
        self._depth = self.stream(Image, DEPTH_IMAGE)
        self._camera = self.stream(CameraInfo, CAMERA_INFO)
        self.latched(String, ROBOT_DESCRIPTION).publish(String(data=self.machine.urdf))
        self.listen(JointState, JOINT_COMMAND, self._on_command)
        self.serve(REVEAL, lambda: json.dumps(self.robot.reveal()))
        self._late: DelayLine[tuple[Publisher, object]] = DelayLine()
        self._commands: DelayLine[tuple[Array, tuple[str, ...]]] = DelayLine()
        self._pace = Pace(self.config)
        self.every(PERIOD / self.config.real_time_factor, self._tick)
        self.every(2.0, self._measure_pace)

    def _tick(self) -> None:
        """Advance until simulated time has caught up with real time, in bounded steps."""
        for _ in range(3):
            if self._pace.must_wait(self.robot.world.time):
                return
            for target, names in self._commands.take(self.robot.world.time):
                self.robot.world.command(target, names)
            self._publish(self.robot.advance())

    def _publish(self, readings: Readings) -> None:
        self._ticks.publish(encode_clock(to_stamp(readings.time)))
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
            self.faults.add("wrist_saturated")
        for entry in self._touch(readings):
            self._late.add(readings.time + self.config.touch_latency, entry)
        late = readings.time + self.config.vision_latency
        if readings.vision is not None:
            covariance = self.robot.marker.covariance
            pose = uncertain_pose_to_message(
                readings.vision, covariance, readings.joint_time, "world"
            )
            self._late.add(late, (self._vision, pose))
        if readings.depth is not None:
            camera = self.robot.camera.config
            info = camera_info(
                camera.intrinsics, camera.width, camera.height, readings.time, CAMERA_FRAME
            )
            image = depth_to_message(readings.depth, readings.time, CAMERA_FRAME)
            self._late.add(late, (self._camera, info))
            self._late.add(late, (self._depth, image))
        for publisher, message in self._late.take(readings.time):
            publisher.publish(message)

    @property
    def _has_pads(self) -> bool:
        return self.machine.tips.kind == "pad"

    def _pad_streams(self, finger: str) -> tuple[Publisher, Publisher]:
        force, std = (fingertip_topic(finger, kind, "pad") for kind in ("force", "force_std"))
        return self.stream(WrenchStamped, force), self.stream(Vector3Stamped, std)

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
        stamp = to_seconds(message.stamp)
        ahead = stamp - self.robot.world.time
        if ahead > AHEAD:
            text = (
                f"{JOINT_COMMAND}: stamped {ahead:.3g} s ahead of /clock: stamp commands with "
                "simulated time (it may also be left from before a restart)"
            )
            raise MessageError("command_ahead", text)
        self._commands.add(stamp + self.config.command_latency, (reader.positions(message), names))
        if stamp > 0.0:
            self._pace.note_command(stamp)

    def _measure_pace(self) -> None:
        pace = self._pace.measure(self.robot.world.time)
        self.faults.show("real_time_factor", round(pace, 4))


def main() -> int:
    """Run the node."""
    return run_node(RobotSim)
