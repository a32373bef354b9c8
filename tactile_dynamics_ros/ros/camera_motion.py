"""A camera that is carried about: its motion, and its images as streams."""

from __future__ import annotations

import time
from collections import deque
from typing import Protocol

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, Image

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.ros.conversions import (
    camera_info,
    camera_to_core,
    depth_to_message,
    pose_to_core,
    to_seconds,
)
from tactile_dynamics_ros.ros.names import CAMERA_INFO, CAMERA_POSE, CAMERA_TARGET, DEPTH_IMAGE
from tactile_dynamics_ros.ros.pacing import DelayLine
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.wire import AnyStamp, Stamp, Stamped

NEAR, TURNED = 0.005, np.deg2rad(1.0)
"""Distance, m, and turn from its target at which the camera is there: arms stop within. What is
used of an image is where the camera was, not where it should have been."""
SETTLED = 0.1
"""Time for which the camera has to rest before an image is used, s: pose and image agree then even
if their clocks are some hundredths apart."""
STILL = 5e-4
"""Move, m or rad, within `SETTLED` up to which the camera rests."""
KEPT = 500


class CameraMotion:
    """Follows `/camera/pose` and `/camera/depth/camera_info`.

    Args:
        node: that listens.

    Attributes:
        moved: when the camera moved last (or `wait_anew` was called), monotonic, s.
        intrinsics: (3, 3), None before they came.
    """

    def __init__(self, node: Shell) -> None:
        self.moved = time.monotonic()
        self.intrinsics: Array | None = None
        self._poses: deque[tuple[Stamp, Array]] = deque(maxlen=KEPT)
        node.listen(CameraInfo, CAMERA_INFO, self._on_info)
        node.listen(PoseStamped, CAMERA_POSE, self._on_pose)

    def wait_anew(self) -> None:
        """Begin to wait for a move."""
        self.moved = time.monotonic()

    def latest(self) -> tuple[Array, Stamp]:
        """Return the newest pose (4, 4) and its stamp.

        Raises:
            NotIdentifiableError: nothing came yet.
        """
        if not self._poses:
            raise NotIdentifiableError(f"no {CAMERA_POSE} yet: publish where the camera is")
        stamp, pose = self._poses[-1]
        return pose, stamp

    def still_at(self) -> Array:
        """Return the newest pose (4, 4), from which to look first, and begin to wait for images."""
        pose, _ = self.latest()
        self.wait_anew()
        return pose

    def rested_at(self, target: Array, stamp: AnyStamp) -> Array | None:
        """Return where the camera was at a stamp, if it rested at its target (4, 4) by then."""
        now = to_seconds(stamp)
        about = [pose for at, pose in self._poses if abs(to_seconds(at) - now) <= SETTLED]
        if not about or to_seconds(self._poses[0][0]) > now - SETTLED:
            return None
        if not is_near(about[-1], target, NEAR, TURNED):
            return None
        return about[-1] if all(is_near(p, about[-1], STILL, STILL) for p in about) else None

    def complaint(self, target: Array) -> str:
        """Return why no image could be used."""
        pose, _ = self.latest()
        if self.intrinsics is None:
            return f"no {CAMERA_INFO} came"
        if is_near(pose, target, NEAR, TURNED):
            return f"no {DEPTH_IMAGE} came whose stamp fits those of {CAMERA_POSE}"
        away = 1e3 * float(np.linalg.norm(pose[:3, 3] - target[:3, 3]))
        return f"the camera stands {away:.0f} mm from {CAMERA_TARGET}: the arm does not go there"

    def _on_info(self, message: CameraInfo) -> None:
        self.intrinsics = camera_to_core(message, CAMERA_INFO, np.eye(4)).intrinsics

    def _on_pose(self, message: Stamped) -> None:
        pose = pose_to_core(message, CAMERA_POSE, "world")
        if self._poses:
            before, last = self._poses[-1]
            if to_seconds(message.stamp) < to_seconds(before):
                self._poses.clear()
            if not is_near(pose, last, 1e-5, 1e-5):
                self.moved = time.monotonic()
        self._poses.append((message.stamp, pose))


def is_near(pose: Array, other: Array, distance: float, turn: float) -> bool:
    """Whether two poses (4, 4) are within so many m and rad."""
    between = 0.5 * (np.trace(pose[:3, :3].T @ other[:3, :3]) - 1.0)
    apart = float(np.linalg.norm(pose[:3, 3] - other[:3, 3]))
    return apart <= distance and float(np.arccos(np.clip(between, -1.0, 1.0))) <= turn


FRAME = "camera_depth_optical_frame"


class Optics(Protocol):
    """What is known of a camera (`sim.sensors.depth_camera.DepthCameraConfig`)."""

    width: int
    height: int

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """Camera matrix (3, 3), pixels."""


class DepthStreams:
    """Image and intrinsics of a depth camera, which come late.

    Args:
        node: that publishes.
        camera: its optics.
        late: messages that are due later.
        latency: of an image, s.
    """

    def __init__(
        self,
        node: Shell,
        camera: Optics,
        late: DelayLine[tuple[Publisher, object]],
        latency: float,
    ) -> None:
        self._optics, self._late, self._latency = camera, late, latency
        self._depth = node.stream(Image, DEPTH_IMAGE)
        self._camera = node.stream(CameraInfo, CAMERA_INFO)

    @property
    def heard(self) -> bool:
        """Whether anybody wants images."""
        return self._depth.get_subscription_count() > 0

    def add(self, depth: NDArray[np.float32], time: float) -> None:
        """Publish an image of a simulated time when it is due."""
        optics = self._optics
        info = camera_info(optics.intrinsics, optics.width, optics.height, time, FRAME)
        self._late.add(time + self._latency, (self._camera, info))
        self._late.add(time + self._latency, (self._depth, depth_to_message(depth, time, FRAME)))
