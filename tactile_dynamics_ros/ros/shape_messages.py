"""Shapes and estimates as messages and as markers for RViz and Foxglove."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import (
    Point,
    Point32,
    PolygonStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Vector3,
)
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion, quaternion_to_matrix
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.shape.solid import Solid
from tactile_dynamics_ros.core.shape.superquadric.recovery import Recovery
from tactile_dynamics_ros.core.shape.superquadric.superquadric import (
    Superquadric,
    SuperquadricSurface,
)
from tactile_dynamics_ros.core.shape.superquadric.words import describe
from tactile_dynamics_ros.core.streams.streams import ContactSample
from tactile_dynamics_ros.recording.shape_files import in_first
from tactile_dynamics_ros.ros.conversions import (
    MessageError,
    array_to_vector,
    header,
    uncertain_pose_to_message,
)
from tactile_dynamics_ros.ros.diagnostics import status_message, status_values
from tactile_dynamics_ros.ros.names import OBJECT_MARKERS, OBJECT_SHAPE, TF, link_topic
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.wire import AnyStamp

WORLD = "world"
STDS = {
    "semi_axes_m_std": ("ax", "ay", "az"),
    "exponents_std": ("e1", "e2"),
    "taper_std": ("k1", "k2"),
    "position_m_std": ("x", "y", "z"),
    "yaw_rad_std": ("yaw",),
}
"""Key of a message, and the names that `Recovery.std` has for its numbers. Where the part stands on
a table of known height, its z is the table's plus a_z: the spread of a_z stands for it."""
LENGTHS = {
    "semi_axes_m": 3,
    "exponents": 2,
    "taper": 2,
    "position_m": 3,
    "quaternion": 4,
    **{key: len(names) for key, names in STDS.items()},
}
"""How many numbers each key has."""


@dataclass(frozen=True)
class Link:
    """A part as `/object/shape` tells it.

    Attributes:
        name: link_1, link_2 ..; the largest first.
        shape: its surface; the pose is that of its frame in `world`.
        std: standard deviations by coordinate, as `Recovery.std` names them.
        words: the part in plain words.
    """

    name: str
    shape: Superquadric
    std: Mapping[str, float]
    words: str

    @property
    def footprint(self) -> Array:
        """(K, 2) outline on the support, m, anticlockwise, in the link's frame."""
        return local_footprint(self.shape)


def local_footprint(shape: Superquadric) -> Array:
    """Return the outline (K, 2), m, of a part in its own frame."""
    flat = shape.footprint()
    return shape.to_body(np.column_stack([flat, np.full(len(flat), shape.pose[2, 3])]))[:, :2]


def shape_message(parts: Sequence[Recovery], stamp: AnyStamp | float) -> DiagnosticArray:
    """Return `/object/shape` of the parts of an object, the largest first.

    Args:
        parts: as they were recovered.
        stamp: of the newest measurement that they come from.
    """
    message = DiagnosticArray(header=header(stamp, WORLD))
    message.status = [_status(f"link_{k}", part) for k, part in enumerate(parts, 1)]
    return message


def _status(name: str, part: Recovery) -> DiagnosticStatus:
    shape, std = part.shape, part.std
    known = {"z": std["az"], "yaw": std.get("turn_z", 0.0), **std}
    numbers: dict[str, Sequence[float]] = {
        "semi_axes_m": shape.semi_axes,
        "exponents": shape.exponents,
        "taper": shape.taper,
        "position_m": shape.pose[:3, 3],
        "quaternion": matrix_to_quaternion(shape.pose[:3, :3]),
        **{key: [known[one] for one in names] for key, names in STDS.items()},
        "footprint_m": local_footprint(shape).ravel(),
    }
    texts = {key: " ".join(f"{value:.9g}" for value in row) for key, row in numbers.items()}
    status = status_message(name, texts, message=describe(part))
    status.hardware_id = "object"
    return status


def shape_from_message(message: DiagnosticArray) -> tuple[Link, ...]:
    """Return the parts of `/object/shape`.

    Raises:
        MessageError: another frame, or a value is missing or cannot be one.
    """
    if message.header.frame_id != WORLD:
        raise MessageError(
            "wrong_frame", f"{OBJECT_SHAPE}: frame_id '{message.header.frame_id}', expected {WORLD}"
        )
    return tuple(_link(status) for status in message.status)


def solid_from_message(message: DiagnosticArray) -> Solid:
    """Return what the parts of `/object/shape` fill, in the axes of the first, as its pose has.

    Raises:
        MessageError: see `shape_from_message`.
        BadInputError: they enclose nothing.
    """
    parts = in_first([link.shape for link in shape_from_message(message)])
    surfaces = [SuperquadricSurface(part) for part in parts]
    return Solid.of_shape(ObjectShape(surfaces), OBJECT_SHAPE)


def _link(status: DiagnosticStatus) -> Link:
    values = status_values(status)
    row = {key: _numbers(status.name, key, count, values) for key, count in LENGTHS.items()}
    pose = np.eye(4)
    length = float(np.linalg.norm(row["quaternion"]))
    if abs(length - 1.0) > 1e-2:
        raise MessageError(
            "bad_quaternion", f"{OBJECT_SHAPE}: {status.name}: quaternion has length {length:.3g}"
        )
    pose[:3, :3] = quaternion_to_matrix(row["quaternion"] / length)
    pose[:3, 3] = row["position_m"]
    try:
        shape = Superquadric(row["semi_axes_m"], row["exponents"], row["taper"], pose)
    except BadInputError as error:
        raise MessageError("bad_shape", f"{OBJECT_SHAPE}: {status.name}: {error}") from error
    std = {
        name: float(value)
        for key, names in STDS.items()
        for name, value in zip(names, row[key], strict=True)
    }
    return Link(status.name, shape, std, status.message)


def _numbers(link: str, key: str, count: int, values: Mapping[str, str]) -> Array:
    """Return the numbers of a key of a link."""
    try:
        found = np.array([float(word) for word in values[key].split()])
    except (KeyError, ValueError) as error:
        raise MessageError("bad_shape", f"{OBJECT_SHAPE}: {link}: no numbers {key}") from error
    if found.shape != (count,) or not np.all(np.isfinite(found)):
        raise MessageError(
            "bad_shape", f"{OBJECT_SHAPE}: {link}: {key} '{values[key]}', expected {count} numbers"
        )
    return found


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
