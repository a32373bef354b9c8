"""The object's frame on /tf, where the messages of tf2 are installed."""

from __future__ import annotations

import importlib

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node

from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.ros.conversions import array_to_vector, header
from tactile_dynamics_ros.ros.names import TF
from tactile_dynamics_ros.ros.wire import AnyStamp

Array = NDArray[np.float64]


class ObjectFrame:
    """Broadcasts world -> object; does nothing without tf2_msgs.

    /tf is one for all hands: in a namespace the frame is named as tf does it, left/object.

    Args:
        node: that publishes.
        child: name of the object's frame.
    """

    def __init__(self, node: Node, child: str = "object") -> None:
        self._child = f"{node.get_namespace()}/{child}".lstrip("/")
        try:
            self._kind = importlib.import_module("tf2_msgs.msg").TFMessage
        except ImportError:
            self._kind = None
            return
        self._publisher = node.create_publisher(self._kind, TF, 100)

    def send(self, pose: Array, stamp: AnyStamp, parent: str) -> None:
        """Broadcast X_WO (4, 4)."""
        if self._kind is None:
            return
        message = TransformStamped(header=header(stamp, parent), child_frame_id=self._child)
        message.transform.translation = array_to_vector(pose[:3, 3])
        x, y, z, w = matrix_to_quaternion(pose[:3, :3]).tolist()
        message.transform.rotation = Quaternion(x=x, y=y, z=z, w=w)
        self._publisher.publish(self._kind(transforms=[message]))
