"""A wrist sensor as its driver publishes it, placed by tf: the contact of what it carries."""

from __future__ import annotations

import importlib
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.frame_tree import FrameTree
from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.ros.conversions import (
    pose_to_message,
    to_seconds,
    uncertain_pose_to_message,
    wrench_to_core,
    wrench_to_message,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import OBJECT_POSE, TF, TF_STATIC, contact_topic
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.wire import Stamp, Stamped

NAME = "wrist"
"""Of the contact; it is API."""
PATIENCE = 0.5
"""How long a reading waits for frames of its time, s of the streams: those of 10 Hz and later."""
_STATIC = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Static frames: all that were ever published, as tf2 hears them."""
_MOVING = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Moving frames: a later one makes good for one that was lost, from whatever publisher."""


@dataclass(frozen=True)
class WristConfig:
    """A force/torque sensor and two frames."""

    wrench: str = parameter("", "topic of the sensor's driver; empty: there is no such sensor")
    base: str = parameter("base_link", "frame that stands still with z up, for world")
    sensor: str = parameter("", "frame of the sensor; empty: that of the wrench's header")
    of_sensor_on_load: bool = parameter(
        False, "whether it reads what it applies on the load, not what the load applies on it"
    )


class WristContact:
    """Publishes object/pose and contact/wrist/{pose,force} of what a wrist sensor carries.

    The frame of the object is the sensor's: what it carries moves with it.

    Args:
        node: that listens.
        config: topic and frames.
    """

    def __init__(self, node: Shell, config: WristConfig) -> None:
        self._node, self._config = node, config
        self._frames = FrameTree()
        self._waiting: deque[tuple[Stamp, str, Array]] = deque(maxlen=5000)
        self._pose = node.stream(PoseWithCovarianceStamped, OBJECT_POSE)
        self._place = node.stream(PoseStamped, contact_topic(NAME, "pose"))
        self._force = node.stream(WrenchStamped, contact_topic(NAME, "force"))
        kind = _transforms()
        node.listen(kind, TF_STATIC, lambda m: self._on_frames(m, True), _STATIC)
        node.listen(kind, TF, lambda m: self._on_frames(m, False), _MOVING)
        node.listen(WrenchStamped, config.wrench, self._on_wrench, sole=True, need=Need.ALWAYS)

    def _on_frames(self, message: Any, static: bool) -> None:
        for one in message.transforms:
            place, turn = one.transform.translation, one.transform.rotation
            numbers = np.array([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w])
            if not np.isfinite(numbers).all() or not numbers[3:].any():
                raise BadInputError(f"frame '{one.child_frame_id}' has a pose that is none")
            pose = np.eye(4)
            pose[:3, 3], pose[:3, :3] = numbers[:3], quaternion_to_matrix(numbers[3:])
            parent, child = (name.lstrip("/") for name in (one.header.frame_id, one.child_frame_id))
            self._frames.add(parent, child, to_seconds(one.header.stamp), pose, static)

    def _on_wrench(self, message: Stamped) -> None:
        wrench = wrench_to_core(message, self._config.wrench)
        newest = to_seconds(self._waiting[-1][0]) if self._waiting else -np.inf
        if to_seconds(message.stamp) < newest - 1.0:
            self._node.faults.add("clock_restarted")
            self._waiting.clear()
            self._frames.clear()
        frame = self._config.sensor or message.frame_id.lstrip("/")
        self._waiting.append((message.stamp, frame, wrench))

    def process(self) -> None:
        """Publish the readings whose frames are known."""
        while self._waiting:
            stamp, frame, wrench = self._waiting[0]
            time = to_seconds(stamp)
            try:
                pose = self._frames.at(self._config.base, frame, time)
            except BadInputError as error:
                self._node.faults.add("no_frame", str(error))
                self._waiting.clear()
                return
            if pose is None:
                if to_seconds(self._waiting[-1][0]) - time < PATIENCE:
                    return
                self._node.faults.add("wrench_without_frame", f"no /tf of {frame} at {time:.3f} s")
            self._waiting.popleft()
            if pose is not None:
                self._publish(stamp, pose, wrench)

    def _publish(self, stamp: Stamp, pose: Array, wrench: Array) -> None:
        sign = 1.0 if self._config.of_sensor_on_load else -1.0
        world = sign * (pose[:3, :3] @ wrench.reshape(2, 3).T).T.ravel()
        unstated = np.zeros((6, 6))
        self._pose.publish(uncertain_pose_to_message(pose, unstated, stamp, "world"))
        self._place.publish(pose_to_message(pose, stamp, "world"))
        self._force.publish(wrench_to_message(world, stamp, "world"))


def _transforms() -> type[Any]:
    """Return the type of /tf.

    Raises:
        BadInputError: tf2_msgs is not installed.
    """
    try:
        found: type[Any] = importlib.import_module("tf2_msgs.msg").TFMessage
    except ImportError as error:
        raise BadInputError(
            "frames come on /tf, whose tf2_msgs cannot be imported: apt install "
            "ros-jazzy-tf2-msgs, or publish contact/wrist/force, contact/wrist/pose and object/pose"
        ) from error
    return found
