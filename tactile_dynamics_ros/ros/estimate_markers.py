"""The estimate, the forces and the object's frame for RViz and Foxglove."""

from __future__ import annotations

import importlib

import numpy as np
from geometry_msgs.msg import Point, Quaternion, TransformStamped, Vector3
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.core.streams.streams import ContactSample
from tactile_dynamics_ros.ros.conversions import array_to_vector, header
from tactile_dynamics_ros.ros.names import OBJECT_MARKERS, TF
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
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


METRES_PER_NEWTON = 0.02
"""Length of a force's arrow: fingertips press with 1 to 5 N, which is as long as an object."""
_LIFETIME = 0.5
"""Time for which a marker is shown, s: an arrow of a contact that fell silent disappears. Shorter
than the pause between two updates it would flicker."""
_SMALLEST = 1e-3
"""Least diameter of the ellipsoid, m, below which nothing could be seen of it."""


class EstimateMarkers:
    """Publishes the centre of mass as an ellipsoid and each contact's force as an arrow.

    Args:
        node: that publishes.
    """

    def __init__(self, node: Shell) -> None:
        self._publisher = node.create_publisher(MarkerArray, OBJECT_MARKERS, LATCHED)
        self._pose: Array | None = None
        self._contacts: dict[str, ContactSample] = {}

    def add_pose(self, pose: Array) -> None:
        """Take where the object is, X_WO (4, 4)."""
        self._pose = pose

    def add_contact(self, contact: ContactSample) -> None:
        """Take a contact in the world."""
        self._contacts[contact.name] = contact

    def publish(self, time: float, com: Array | None, std: Array) -> None:
        """Publish, if anybody listens.

        Args:
            time: s, stamp of the estimate.
            com: (3,) m in the object's frame; None while nothing is to be believed.
            std: (3,) m.
        """
        if self._publisher.get_subscription_count() == 0:
            return
        recent = [c for c in self._contacts.values() if time - c.time < _LIFETIME]
        markers = [_arrow(contact, number) for number, contact in enumerate(recent)]
        if self._pose is not None and com is not None:
            markers.append(_ellipsoid(self._pose, com, std))
        for marker in markers:
            marker.header = header(time, "world")
            marker.lifetime = Duration(seconds=_LIFETIME).to_msg()
        self._publisher.publish(MarkerArray(markers=markers))


def _arrow(contact: ContactSample, number: int) -> Marker:
    tip = contact.point + METRES_PER_NEWTON * contact.force
    marker = Marker(ns="forces", id=number, type=Marker.ARROW, text=contact.name)
    marker.pose.orientation.w = 1.0
    marker.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in (contact.point, tip)]
    marker.scale = Vector3(x=0.004, y=0.01, z=0.0)
    marker.color = ColorRGBA(r=0.18, g=0.62, b=0.47, a=1.0)
    return marker


def _ellipsoid(pose: Array, com: Array, std: Array) -> Marker:
    marker = Marker(ns="centre_of_mass", type=Marker.SPHERE)
    x, y, z = (pose[:3, 3] + pose[:3, :3] @ com).tolist()
    marker.pose.position = Point(x=x, y=y, z=z)
    x, y, z, w = matrix_to_quaternion(pose[:3, :3]).tolist()
    marker.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
    x, y, z = np.maximum(2.0 * std, _SMALLEST).tolist()
    marker.scale = Vector3(x=x, y=y, z=z)
    marker.color = ColorRGBA(r=0.92, g=0.47, b=0.12, a=0.6)
    return marker
