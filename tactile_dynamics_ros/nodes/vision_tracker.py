"""Node: the object's pose from depth images, with the robot's own parts left out of sight."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float64

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import rpy_to_matrix
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.object_shape import MESH_SUFFIXES, load_shape
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.core.tracking.links.table_tracker import TableTracker
from tactile_dynamics_ros.core.tracking.vision_tracker import VisionTracker
from tactile_dynamics_ros.core.tracking.watch import VisionTrackerConfig
from tactile_dynamics_ros.ros.conversions import (
    JointReader,
    StampGate,
    camera_to_core,
    depth_to_core,
    pose_to_core,
    to_seconds,
    uncertain_pose_to_core,
    uncertain_pose_to_message,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    CAMERA_INFO,
    CAMERA_POSE,
    DEPTH_IMAGE,
    JOINT_STATES,
    OBJECT_POSE,
    OBJECT_SHAPE,
    VISION_POSE,
    VISION_RESET,
    VISION_SCORE,
    link_topic,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.robot import JointHistory, declare_robot
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.table_following import PoseHistory, load_volume, tracker_of
from tactile_dynamics_ros.ros.wire import Joints, Picture, Stamped
from tactile_dynamics_ros.share import object_file

WORLD = "world"
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
RECENT = 0.2


@dataclass(frozen=True)
class VisionNodeConfig:
    """What to look for, and from where."""

    object: str = parameter("box_0", "file in config/objects, or path of a yaml or mesh file (m)")
    camera_position: tuple[float, ...] = parameter((0.75, -0.6, 0.45), "camera in the world", "m")
    camera_rpy_deg: tuple[float, ...] = parameter(
        (-111.51917682, 0.0, 28.81079374), "optical frame in the world, fixed axes", "deg"
    )
    table_robot: str = parameter("", "URDF file of the robot at the table; empty: none")
    follow_fused: bool = parameter(True, "start from object/pose where it is known")

    def __post_init__(self) -> None:
        check_ranges(self)


class VisionTrackerNode(Shell):
    """Aligns the object's surface with each depth image; silent while it is hidden or lost.

    vision_tracker/score is the share of the visible surface that is where it should be, NaN while
    too little of it is visible.
    """

    skimming = True
    gather = 0.01  # joint states and poses come a hundred times a second, images fifteen times

    def __init__(self) -> None:
        super().__init__("vision_tracker")
        self.config = declare_config(self, VisionNodeConfig)
        name = self.config.object
        path = Path(name) if Path(name).suffix.lower() in MESH_SUFFIXES else object_file(name)
        kinematics = HandKinematics(declare_robot(self))
        settings = declare_config(self, VisionTrackerConfig)
        self.tracker = VisionTracker(load_shape(path), kinematics, settings)
        self._placement = np.eye(4)
        self._placement[:3, :3] = rpy_to_matrix(np.deg2rad(self.config.camera_rpy_deg))
        self._placement[:3, 3] = self.config.camera_position
        self._camera: PinholeCamera | None = None
        self._reader = JointReader(kinematics.joint_names, followers=kinematics.robot.followers)
        self._joints = JointHistory()
        self._fused: tuple[float, Array] | None = None
        self._gate = StampGate(DEPTH_IMAGE)
        self._spent: list[float] = []
        self._table: TableTracker | None = None
        self._volume = load_volume(self.config.table_robot, settings.robot_margin)
        self._table_reader = JointReader(() if self._volume is None else self._volume.joint_names)
        self._table_joints, self._camera_poses = JointHistory(), PoseHistory()
        self._links: dict[str, Publisher] = {}
        self._pose = self.stream(PoseWithCovarianceStamped, VISION_POSE)
        self._score = self.stream(Float64, VISION_SCORE)
        self.listen(CameraInfo, CAMERA_INFO, self._on_camera, need=Need.ONCE)
        self.listen(JointState, JOINT_STATES, self._on_joints)
        if self.config.follow_fused:
            self.listen(PoseWithCovarianceStamped, OBJECT_POSE, self._on_fused, skim=True)
        self.listen(DiagnosticArray, OBJECT_SHAPE, self._on_shape, LATCHED)
        self.listen(PoseStamped, CAMERA_POSE, self._on_camera_pose)
        self.listen(Image, DEPTH_IMAGE, self._on_image, NEWEST, need=Need.ONCE)
        self.serve(VISION_RESET, self._reset)
        self.every(1.0, self._show)

    def _reset(self) -> str:
        self.tracker.reset()
        self._fused = None
        return "the object is searched in the whole image"

    def _on_camera(self, message: CameraInfo) -> None:
        self._camera = camera_to_core(message, CAMERA_INFO, self._placement)

    def _on_shape(self, message: DiagnosticArray) -> None:
        """Follow the links of an object on a table from now on."""
        self._table = tracker_of(message, self._volume, self.tracker.config)
        for link in self._table.states:
            if link not in self._links:
                self._links[link] = self.stream(PoseWithCovarianceStamped, link_topic(link, "pose"))

    def _on_camera_pose(self, message: Stamped) -> None:
        self._camera_poses.add(to_seconds(message.stamp), pose_to_core(message, CAMERA_POSE, WORLD))

    def _on_joints(self, message: Joints) -> None:
        if self._table is not None:
            if self._volume is not None:
                self._table_joints.add(
                    to_seconds(message.stamp), self._table_reader.positions(message)
                )
            return
        self._joints.add(to_seconds(message.stamp), self._reader.positions(message))

    def _on_fused(self, message: Stamped) -> None:
        pose, _ = uncertain_pose_to_core(message, OBJECT_POSE, WORLD)
        self._fused = (to_seconds(message.stamp), pose)

    def _on_image(self, message: Picture) -> None:
        depth = depth_to_core(message, DEPTH_IMAGE)
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self._joints.clear()
            self._reset()
        stamp = to_seconds(message.stamp)
        if self._table is not None:
            self._follow_table(depth, message, stamp)
            return
        positions = self._joints.at(stamp)
        if positions is None or self._camera is None:
            missing = "camera_info" if self._camera is None else "joint_states"
            self.faults.add(
                f"no_{missing}", f"{DEPTH_IMAGE}: no {missing} for the image at {stamp:.3f}"
            )
            return
        began = time.perf_counter()
        known = [pose for when, pose in [self._fused or (-math.inf, None)] if pose is not None
                 and abs(stamp - when) < RECENT]  # fmt: skip
        seen = self.tracker.update(depth, self._camera, positions, stamp, known)
        self._spent.append(time.perf_counter() - began)
        enough = self.tracker.visible >= self.tracker.config.least_visible
        self._score.publish(Float64(data=self.tracker.score if enough else math.nan))
        if seen is None:
            self.faults.add(f"{self.tracker.state.value}_images")
            return
        self._pose.publish(
            uncertain_pose_to_message(seen.pose, seen.covariance, message.stamp, WORLD)
        )

    def _follow_table(self, depth: NDArray[np.float32], message: Picture, stamp: float) -> None:
        """Publish the pose of every link that the image shows for sure."""
        assert self._table is not None
        moving = len(self._camera_poses) > 0
        pose = self._camera_poses.at(stamp) if moving else self._placement
        positions = self._table_joints.at(stamp)
        needs = {
            "camera_info": self._camera is None,
            "camera_pose": pose is None,
            "joint_states": self._volume is not None and positions is None,
        }
        missing = [name for name, lacks in needs.items() if lacks]
        if missing or self._camera is None or pose is None:
            text = f"{DEPTH_IMAGE}: no {missing[0]} for the image at {stamp:.3f}"
            self.faults.add(f"no_{missing[0]}", text)
            return
        began = time.perf_counter()
        seen = self._table.update(depth, replace(self._camera, pose=pose), stamp, positions)
        self._spent.append(time.perf_counter() - began)
        for link, state in self._table.states.items():
            self.faults.show(link, state.value)
            if link not in seen:
                self.faults.add(f"{link}_{state.value}_images")
                continue
            found = seen[link]
            self._links[link].publish(
                uncertain_pose_to_message(found.pose, found.covariance, message.stamp, WORLD)
            )

    def _show(self) -> None:
        """Put state, score and speed on /diagnostics."""
        self.faults.show("state", self.tracker.state.value)
        self.faults.show("score", round(self.tracker.score, 3))
        self.faults.show("visible", round(self.tracker.visible, 3))
        if self._spent:
            self.faults.show("image_ms", round(1e3 * float(np.median(self._spent)), 1))
            self.faults.show("images_per_s", len(self._spent))
        self._spent.clear()


def main() -> int:
    """Run the node."""
    return run_node(VisionTrackerNode)
