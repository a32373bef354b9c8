"""Node: the simulated robot behind the topics of the real one, paced to real time."""

from __future__ import annotations

import json
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.robot_description import FLANGE_LINK, JOINT_NAMES
from tactile_dynamics_ros.nodes.conversions import (
    JointReader,
    MessageError,
    biotac_to_message,
    camera_info,
    depth_to_message,
    joints_to_message,
    to_seconds,
    to_stamp,
    uncertain_pose_to_message,
    wrench_to_message,
)
from tactile_dynamics_ros.nodes.parameters import declare_config
from tactile_dynamics_ros.nodes.shell import Shell, run_node
from tactile_dynamics_ros.sim.simulated_robot import (
    Readings,
    SimulatedRobot,
    SimulatedRobotConfig,
)

PERIOD = 0.01
CATCH_UP = 0.1
CAMERA_FRAME = "camera_depth_optical_frame"


@dataclass(frozen=True)
class RobotSimConfig:
    """Pace and delays."""

    real_time_factor: float = parameter(1.0, "simulated over real time", "", 0.05, 20.0)
    touch_latency: float = parameter(0.005, "delay of raw counts behind their stamp", "s", 0, 1.0)
    vision_latency: float = parameter(0.02, "delay of poses and images", "s", 0.0, 1.0)
    command_lag: float = parameter(0.1, "the simulation waits for later commands", "s", 0.02)
    command_timeout: float = parameter(1.0, "real time after which it goes on", "s", 0.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class RobotSim(Shell):
    """Simulates 10 ms, publishes what the sensors say, waits until that time has passed.

    Where the machine is too slow, simulated time falls behind real time; nothing is skipped, and
    the simulation waits for a controller that is working but late.
    """

    def __init__(self) -> None:
        super().__init__("robot_sim")
        self.config = declare_config(self, RobotSimConfig)
        self.robot = SimulatedRobot(declare_config(self, SimulatedRobotConfig), PERIOD)
        self._reader: dict[tuple[str, ...], JointReader] = {}
        self._ticks = self.create_publisher(Clock, "/clock", 10)
        self._joints = self.stream(JointState, "/joint_states")
        self._raw = self.stream(Image, "/biotac/raw")
        self._wrist = self.stream(WrenchStamped, "/wrist/wrench")
        self._vision = self.stream(PoseWithCovarianceStamped, "/object/pose/vision")
        self._depth = self.stream(Image, "/camera/depth/image_rect")
        self._camera = self.stream(CameraInfo, "/camera/depth/camera_info")
        self.listen(JointState, "/joint_command", self._on_command)
        self.serve("/robot_sim/reveal", lambda: json.dumps(self.robot.reveal()))
        self._delayed: deque[tuple[float, Publisher, object]] = deque()
        self._start: float | None = None
        self._commanded = (0.0, -np.inf)
        self._measured = (time.monotonic(), 0.0)
        self.every(PERIOD / self.config.real_time_factor, self._tick)
        self.every(2.0, self._measure_pace)

    def _tick(self) -> None:
        """Advance until simulated time has caught up with real time, in bounded steps."""
        for _ in range(3):
            if self._ahead() > 0.5 * PERIOD or self._must_wait():
                return
            self._publish(self.robot.advance())

    def _ahead(self) -> float:
        """Return by how much simulated time leads; a large lag is forgiven."""
        now, factor = time.monotonic(), self.config.real_time_factor
        simulated = self.robot.world.time / factor
        if self._start is None or now - self._start - simulated > CATCH_UP:
            self._start = now - simulated
        return simulated - (now - self._start)

    def _must_wait(self) -> bool:
        """Whether a controller works on joint states that are long past."""
        stamp, came = self._commanded
        lag = self.robot.world.time - stamp
        waited = time.monotonic() - came
        return lag > self.config.command_lag and waited < self.config.command_timeout

    def _publish(self, readings: Readings) -> None:
        self._ticks.publish(Clock(clock=to_stamp(readings.time)))
        self._joints.publish(
            joints_to_message(
                JOINT_NAMES,
                readings.joint_time,
                readings.position,
                readings.velocity,
                readings.effort,
            )
        )
        self._wrist.publish(wrench_to_message(readings.wrist, readings.time, FLANGE_LINK))
        if readings.wrist_saturated:
            self.faults.add("wrist_saturated")
        counts = biotac_to_message(readings.counts, readings.touch_time, "hand")
        self._delay(readings.time + self.config.touch_latency, self._raw, counts)
        late = readings.time + self.config.vision_latency
        if readings.vision is not None:
            covariance = self.robot.marker.covariance
            pose = uncertain_pose_to_message(
                readings.vision, covariance, readings.joint_time, "world"
            )
            self._delay(late, self._vision, pose)
        if readings.depth is not None:
            camera = self.robot.camera.config
            info = camera_info(
                camera.intrinsics, camera.width, camera.height, readings.time, CAMERA_FRAME
            )
            image = depth_to_message(readings.depth, readings.time, CAMERA_FRAME)
            self._delay(late, self._camera, info)
            self._delay(late, self._depth, image)
        self._release(readings.time)

    def _delay(self, due: float, publisher: Publisher, message: object) -> None:
        self._delayed.append((due, publisher, message))

    def _release(self, now: float) -> None:
        """Publish what is due."""
        waiting = [entry for entry in self._delayed if entry[0] > now + 1e-9]
        for due, publisher, message in self._delayed:
            if due <= now + 1e-9:
                publisher.publish(message)
        self._delayed = deque(waiting)

    def _on_command(self, message: JointState) -> None:
        names = tuple(message.name)
        unknown = [name for name in names if name not in JOINT_NAMES]
        if unknown:
            raise MessageError("unknown_joint", f"/joint_command: no joint '{unknown[0]}'")
        reader = self._reader.setdefault(names, JointReader(names, "/joint_command"))
        self.robot.world.command(reader.positions(message), names)
        if to_seconds(message.header.stamp) > 0.0:
            self._commanded = (to_seconds(message.header.stamp), time.monotonic())

    def _measure_pace(self) -> None:
        before, simulated = self._measured
        self._measured = (time.monotonic(), self.robot.world.time)
        pace = (self._measured[1] - simulated) / (self._measured[0] - before)
        self.faults.show("real_time_factor", round(pace, 4))


def main() -> int:
    """Run the node."""
    return run_node(RobotSim)
