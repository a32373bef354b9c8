"""Publishes an object on a table once its shape is known: shape, outlines, poses, drawing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Point32, PolygonStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from tactile_dynamics_ros.core.shape.superquadric.recovery import Recovery
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.ros.conversions import header, uncertain_pose_to_message
from tactile_dynamics_ros.ros.names import OBJECT_MARKERS, OBJECT_SHAPE, link_topic
from tactile_dynamics_ros.ros.shape_messages import WORLD, local_footprint, shape_message
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.wire import AnyStamp

Array = NDArray[np.float64]

CELLS = 8
"""Cells along an edge of the cube that is mapped to a drawn surface: 768 triangles per part, 1 mm
off at most on 10 cm. Twice as many make messages of 0.3 MB."""
COLOURS = ((0.20, 0.55, 0.85), (0.90, 0.55, 0.20), (0.40, 0.70, 0.35))


class ShapePublisher:
    """Publishes the parts of an object.

    Args:
        node: that publishes.
    """

    def __init__(self, node: Shell) -> None:
        self._node = node
        self._shape = node.latched(DiagnosticArray, OBJECT_SHAPE)
        self._markers = node.latched(MarkerArray, OBJECT_MARKERS)
        self._links: dict[str, tuple[Publisher, Publisher]] = {}
        self._of("link_1")

    def publish(self, parts: Sequence[Recovery], stamp: AnyStamp) -> None:
        """Tell all of an object.

        Args:
            parts: the largest first.
            stamp: of the last image that shows it.
        """
        self._shape.publish(shape_message(parts, stamp))
        markers = [Marker(action=Marker.DELETEALL)]
        for k, part in enumerate(parts, 1):
            link = f"link_{k}"
            footprint, pose = self._of(link)
            frame = "object" if k == 1 else link
            footprint.publish(footprint_message(part.shape, stamp, frame))
            pose.publish(
                uncertain_pose_to_message(part.shape.pose, pose_covariance(part), stamp, WORLD)
            )
            markers.append(marker(part.shape, stamp, k))
        self._markers.publish(MarkerArray(markers=markers))

    def _of(self, link: str) -> tuple[Publisher, Publisher]:
        """Return the publishers of a link's footprint and pose."""
        if link not in self._links:
            footprint = self._node.latched(PolygonStamped, link_topic(link, "footprint"))
            pose = self._node.stream(PoseWithCovarianceStamped, link_topic(link, "pose"))
            self._links[link] = footprint, pose
        return self._links[link]


def pose_covariance(part: Recovery) -> Array:
    """Return the covariance (6, 6) [rotation, position] of a part that stands on the table."""
    std = part.std
    turns = [std.get(f"turn_{axis}", 0.0) for axis in "xyz"]
    return np.diag(np.square([*turns, std["x"], std["y"], std.get("z", std["az"])]))


def footprint_message(shape: Superquadric, stamp: AnyStamp, frame: str) -> PolygonStamped:
    """Return the outline of a part in its own frame."""
    message = PolygonStamped(header=header(stamp, frame))
    message.polygon.points = [
        Point32(x=float(x), y=float(y), z=float(-shape.semi_axes[2]))
        for x, y in local_footprint(shape)
    ]
    return message


def marker(shape: Superquadric, stamp: AnyStamp, number: int) -> Marker:
    """Return the surface of a part as triangles in the world."""
    found = Marker(header=header(stamp, WORLD), ns="shape", id=number, type=Marker.TRIANGLE_LIST)
    found.pose.orientation.w = 1.0
    found.scale.x = found.scale.y = found.scale.z = 1.0
    red, green, blue = COLOURS[(number - 1) % len(COLOURS)]
    found.color = ColorRGBA(r=red, g=green, b=blue, a=0.8)
    corners = shape.mesh(CELLS).triangles.reshape(-1, 3)
    found.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in corners]
    return found
