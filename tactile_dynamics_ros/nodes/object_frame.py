"""The object's frame on /tf, where the messages of tf2 are installed."""

from __future__ import annotations

import importlib

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node

from tactile_dynamics_ros.nodes.conversions import header, matrix_to_pose

Array = NDArray[np.float64]


class ObjectFrame:
    """Broadcasts world -> object; does nothing without tf2_msgs.

    Args:
        node: that publishes.
        child: name of the object's frame.
    """

    def __init__(self, node: Node, child: str = "object") -> None:
        self._child = child
        try:
            self._kind = importlib.import_module("tf2_msgs.msg").TFMessage
        except ImportError:
            self._kind = None
            return
        self._publisher = node.create_publisher(self._kind, "/tf", 100)

    def send(self, pose: Array, stamp: Time, parent: str) -> None:
        """Broadcast X_WO (4, 4)."""
        if self._kind is None:
            return
        placed = matrix_to_pose(pose)
        message = TransformStamped(header=header(stamp, parent), child_frame_id=self._child)
        message.transform.translation.x = placed.position.x
        message.transform.translation.y = placed.position.y
        message.transform.translation.z = placed.position.z
        message.transform.rotation = placed.orientation
        self._publisher.publish(self._kind(transforms=[message]))
