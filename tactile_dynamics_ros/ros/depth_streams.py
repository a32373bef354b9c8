"""Images of a simulated depth camera on their topics."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, Image

from tactile_dynamics_ros.ros.conversions import camera_info, depth_to_message
from tactile_dynamics_ros.ros.names import CAMERA_INFO, DEPTH_IMAGE
from tactile_dynamics_ros.ros.pacing import DelayLine
from tactile_dynamics_ros.ros.shell import Shell

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
