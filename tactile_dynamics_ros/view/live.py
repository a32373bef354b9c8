"""What running nodes publish, read ten times a second for the page."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import (
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from visualization_msgs.msg import MarkerArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.ros.conversions import to_seconds
from tactile_dynamics_ros.ros.diagnostics import Statuses
from tactile_dynamics_ros.ros.listening import take_messages
from tactile_dynamics_ros.ros.names import (
    CAMERA_TARGET,
    ESTIMATOR_STATUS,
    EXPLORE_PROGRESS,
    JOINT_STATES,
    MODEL_DIAGNOSIS,
    MODEL_ERROR,
    OBJECT_FOOTPRINT,
    OBJECT_MARKERS,
    OBJECT_POSE,
    PROBE_ESTIMATE,
    PROPERTY_STATUS,
    PUSH_PROGRESS,
    ROBOT_DESCRIPTION,
    link_topic,
)
from tactile_dynamics_ros.ros.shell import LATCHED, Polled
from tactile_dynamics_ros.ros.statuses import read_inertia_status
from tactile_dynamics_ros.view.state import (
    Body,
    Force,
    Quantity,
    State,
    take_diagnosis,
    take_markers,
    take_progress,
    take_property_status,
)

_NEWEST = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
)
"""Only the newest message waits: older ones are dropped before Python sees them, which is what lets
a page of 10 Hz follow topics of 100 Hz at little cost."""
_SILENT = 0.5
"""Time without a message after which an arrow disappears, s of the contact's own clock. Shorter
makes arrows flicker where messages come in bursts, longer shows forces that are gone."""


class LiveSource:
    """Reads topics into a state.

    Args:
        node: that subscribes, in the namespace of the hand.
    """

    def __init__(self, node: Node) -> None:
        self.state = State()
        self._node = node
        self._group = Polled()
        self._subscriptions: list[tuple[Subscription, Callable[[Any], None]]] = []
        self._points: dict[str, Array] = {}
        self._stds: dict[str, Array] = {}
        self._heard: dict[str, float] = {}
        self._newest = 0.0
        self._known: set[str] = set()
        for kind, topic, handle, profile in (
            (PoseWithCovarianceStamped, OBJECT_POSE, self._on_pose, _NEWEST),
            (JointState, JOINT_STATES, self._on_joints, _NEWEST),
            (String, ROBOT_DESCRIPTION, self._on_robot, LATCHED),
            (String, f"/{ROBOT_DESCRIPTION}", self._on_robot, LATCHED),
            (DiagnosticArray, ESTIMATOR_STATUS, self._on_estimate, LATCHED),
            (Float64, MODEL_ERROR, self._on_error, LATCHED),
            (DiagnosticArray, MODEL_DIAGNOSIS, self._on_diagnosis, LATCHED),
            (DiagnosticStatus, PROBE_ESTIMATE, self._on_friction, LATCHED),
            (MarkerArray, OBJECT_MARKERS, self._on_markers, LATCHED),
            (PoseStamped, CAMERA_TARGET, self._on_target, 10),
            (PolygonStamped, OBJECT_FOOTPRINT, self._on_footprint, LATCHED),
            (PoseWithCovarianceStamped, link_topic("link_2", "pose"), self._on_second, _NEWEST),
            (PolygonStamped, link_topic("link_2", "footprint"), self._on_second_outline, LATCHED),
            (DiagnosticArray, PROPERTY_STATUS, self._on_properties, LATCHED),
            (DiagnosticStatus, EXPLORE_PROGRESS, self._on_progress, LATCHED),
            (DiagnosticStatus, PUSH_PROGRESS, self._on_progress, LATCHED),
        ):
            self._subscribe(kind, topic, handle, profile)

    def discover(self) -> None:
        """Subscribe to contacts that have appeared since the last call."""
        space = self._node.get_namespace().rstrip("/")
        for topic, _ in self._node.get_topic_names_and_types():
            words = topic.removeprefix(space).split("/")
            if topic in self._known or not topic.startswith(f"{space}/contact/") or len(words) != 4:
                continue
            name, kind = words[2:]
            handler = {"force": self._on_force, "force_std": self._on_std, "pose": self._on_contact}
            types = {"force": WrenchStamped, "force_std": Vector3Stamped, "pose": PoseStamped}
            if kind in handler:
                self._known.add(topic)
                handle = handler[kind]
                self._subscribe(types[kind], topic, _named(handle, name), _NEWEST)

    def read(self) -> None:
        """Take what waits and bring the state up to date."""
        for subscription, handle in self._subscriptions:
            for taken in take_messages(subscription)[-1:]:
                handle(taken.message)
        for name, time in list(self._heard.items()):
            if self._newest - time > _SILENT:
                del self._heard[name]
                self.state.forces.pop(name, None)

    def _subscribe(
        self, kind: Any, topic: str, handle: Callable[[Any], None], profile: QoSProfile | int
    ) -> None:
        subscription = self._node.create_subscription(
            kind, topic, lambda _: None, profile, callback_group=self._group
        )
        self._subscriptions.append((subscription, handle))

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = _matrix(message.pose.pose)
        if pose is not None:
            self.state.object_pose = pose
            if self.state.shape is not None and self.state.shape_pose is None:
                self.state.shape_pose = pose
            self._newest = to_seconds(message.header.stamp)

    def _on_joints(self, message: JointState) -> None:
        self.state.joints.update(zip(message.name, message.position, strict=False))

    def _on_robot(self, message: String) -> None:
        self.state.urdf = message.data

    def _on_target(self, message: PoseStamped) -> None:
        self.state.next_view = _matrix(message.pose)

    def _on_contact(self, name: str, message: PoseStamped) -> None:
        pose = _matrix(message.pose)
        if pose is not None:
            self._points[name] = pose[:3, 3]

    def _on_std(self, name: str, message: Vector3Stamped) -> None:
        self._stds[name] = _vector(message.vector)

    def _on_force(self, name: str, message: WrenchStamped) -> None:
        force = _vector(message.wrench.force)
        time = to_seconds(message.header.stamp)
        self._newest = max(self._newest, time)
        if name not in self._points or not np.any(force) or not np.all(np.isfinite(force)):
            self.state.forces.pop(name, None)
            return
        self._heard[name] = time
        self.state.forces[name] = Force(self._points[name], force, self._stds.get(name))

    def _on_estimate(self, message: DiagnosticArray) -> None:
        state, time = self.state, to_seconds(message.header.stamp)
        said = read_inertia_status(message.status)
        state.remark, state.good, state.body = said.text, said.good, None
        state.effects = said.effects
        if not said.known:
            return
        mass, std = said.value[0], said.std[0]
        ten = said.value, said.std
        centre, inertia = ([part[rows] for part in ten] for rows in (slice(1, 4), slice(4, 10)))
        state.body = Body(Quantity(mass, std), *centre, *inertia)
        state.note("mass", time, 1e3 * mass, 1e3 * std)
        state.note("com", time, 1e3 * said.value[1], 1e3 * said.std[1])

    def _on_error(self, message: Float64) -> None:
        if not self.state.pushed:  # the error of a pushed object is that of its estimate
            self.state.error = message.data
            self.state.note("error", self._newest, message.data)

    def _on_diagnosis(self, message: DiagnosticArray) -> None:
        take_diagnosis(self.state, message.status)

    def _on_friction(self, message: DiagnosticStatus) -> None:
        read = Statuses([message])
        for region in read.words(message.name, "regions"):
            keys = f"{region}.static", f"{region}.std"
            found = Quantity(*read.numbers(message.name, keys))
            if math.isfinite(found.value):
                self.state.friction = found
                self.state.note("friction", self._newest, found.value, found.std)

    def _on_markers(self, message: MarkerArray) -> None:
        take_markers(self.state, message.markers)

    def _on_footprint(self, message: PolygonStamped) -> None:
        self.state.footprint = _corners(message)

    def _on_second(self, message: PoseWithCovarianceStamped) -> None:
        pose = _matrix(message.pose.pose)
        self.state.second_pose = self.state.second_pose if pose is None else pose

    def _on_second_outline(self, message: PolygonStamped) -> None:
        self.state.second_footprint = _corners(message)

    def _on_properties(self, message: DiagnosticArray) -> None:
        take_property_status(self.state, to_seconds(message.header.stamp), message.status)

    def _on_progress(self, message: DiagnosticStatus) -> None:
        take_progress(self.state, message)


def _named(handle: Callable[[str, Any], None], name: str) -> Callable[[Any], None]:
    return lambda message: handle(name, message)


def _corners(message: PolygonStamped) -> Array:
    return np.array([[p.x, p.y] for p in message.polygon.points])


def _vector(vector: Any) -> Array:
    return np.array([vector.x, vector.y, vector.z])


def _matrix(pose: Any) -> Array | None:
    """Return a pose as a matrix; None if it is none."""
    place, turn = pose.position, pose.orientation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    found = np.eye(4)
    found[:3, 3] = _vector(place)
    size = float(np.linalg.norm(quaternion))
    if not np.all(np.isfinite(found)) or not 0.5 < size < 2.0:
        return None
    found[:3, :3] = quaternion_to_matrix(quaternion / size)
    return found
