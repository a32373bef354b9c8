"""What nodes hear of a pushed object, in the frame of its support and in the order of time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from time import monotonic
from typing import Any, Protocol

import numpy as np
from geometry_msgs.msg import (
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce, touches
from tactile_dynamics_ros.core.streams.stamps import Reordered
from tactile_dynamics_ros.ros.conversions import (
    MessageError,
    pose_to_core,
    wrench_to_core,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    OBJECT_POSE,
    PUSHER_POSE,
    SUPPORT_POSE,
    contact_topic,
    link_topic,
)
from tactile_dynamics_ros.ros.object_state import Following, ObjectState
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.stated_noise import read_force_std, read_tracked_pose
from tactile_dynamics_ros.ros.stream_clock import StreamClock
from tactile_dynamics_ros.ros.wire import Stamped

WORLD = "world"
HOLD = 0.03
"""How long a reading waits for those that were taken before it and come later, s: three samples at
100 Hz."""
NEAR = 0.03
"""Distance of a force's stamp to a pose's beyond which they do not belong together, s."""
FORCE_STD = np.full(3, 0.03)
"""Noise of a force, N, presumed before one is stated."""


class PushedLink(Protocol):
    """Takes what is heard of one part; x, y and yaw are in the frame of the support."""

    def set_outline(self, outline: Array) -> bool:
        """Take the footprint (V, 2), m; return whether it is that of another object."""

    def add_pose(self, time: float, pose: Array, std: Array | None) -> None:
        """Take x, y, yaw (3,) of the part and their std."""


class PushedObject(PushedLink, Protocol):
    """Takes what is heard; x, y, z and yaw are in the frame of the support."""

    gravity: Array

    def add_pusher(self, time: float, pose: Array) -> None:
        """Take x, y, z, yaw (4,) of the pusher, yaw unwrapped."""

    def add_contact(self, measured: ContactForce) -> None:
        """Take a force."""


class PushingStreams:
    """Subscriptions to pose, footprint, pusher, support and contacts.

    Args:
        node: that subscribes.
        contacts: their names.
        thing: that takes what is heard, in the order of time.
        forget: called when the clock of the streams was set or stepped back; a push has one clock.
        second: that takes what is heard of link_2, for an object of two parts.
    """

    def __init__(
        self,
        node: Shell,
        contacts: Sequence[str],
        thing: PushedObject,
        forget: Callable[[], None],
        second: PushedLink | None = None,
    ) -> None:
        self._node, self._thing = node, thing
        self._X_SW, self._yaw = np.eye(4), 0.0
        self.clock = StreamClock(node)
        self._pusher = Reordered[Array]()
        self._following = Following(monotonic())
        self.clock.on_move += [self._pusher.clear, self._begin_anew, forget]
        parts = [thing] if second is None else [thing, second]
        self._links = [_Link(node, k, part, self.clock) for k, part in enumerate(parts)]
        node.listen(PoseStamped, PUSHER_POSE, self._on_pusher, sole=True, need=Need.ALWAYS)
        node.listen(PoseStamped, SUPPORT_POSE, self._on_support, LATCHED)
        self._contacts = [_Contact(node, name, self.clock) for name in contacts]

    @property
    def state(self) -> ObjectState:
        """Whether the object is followed now, and since when."""
        state = self._following.state(monotonic(), self._links[0].outlined)
        return replace(state, troubles=self._node.inputs.troubles)

    @property
    def pose(self) -> Array | None:
        """(4, 4) of the object in the world, the newest; None before the first."""
        return self._links[0].pose

    def release(self) -> float:
        """Hand on what need not wait any longer; return up to which time, s."""
        until = self.clock.newest if self.clock.is_idle else self.clock.newest - HOLD
        for time, pose in self._pusher.take(until):
            placed = self._X_SW @ pose
            turn = np.arctan2(placed[1, 0], placed[0, 0]) - self._yaw
            self._yaw += (turn + np.pi) % (2.0 * np.pi) - np.pi
            self._thing.add_pusher(time, np.append(placed[:3, 3], self._yaw))
            self._following.hear(PUSHER_POSE, monotonic())
        before = self.pose
        for link in self._links:
            link.release(until, self._X_SW)
        if self.pose is not before:
            self._following.hear(OBJECT_POSE, monotonic())
        for contact in self._contacts:
            for measured in contact.take(until, self._X_SW):
                self._thing.add_contact(measured)
                if touches(measured):
                    self._following.hear_touch(monotonic())
        return until

    def _begin_anew(self) -> None:
        self._following.clear(monotonic())

    def _on_pusher(self, message: Stamped) -> None:
        pose = pose_to_core(message, PUSHER_POSE, WORLD)
        _add(self._pusher, self.clock.admit(message.stamp, PUSHER_POSE), pose, PUSHER_POSE)

    def _on_support(self, message: Stamped) -> None:
        self._X_SW = np.linalg.inv(pose_to_core(message, SUPPORT_POSE, WORLD))
        self._thing.gravity = self._X_SW[:3, :3] @ np.array([0.0, 0.0, -9.81])


class _Link:
    """Pose and outline of one part.

    Args:
        node: that subscribes.
        index: 0 for link_1.
        part: that takes what is heard.
        clock: of the node's streams.

    Attributes:
        pose: (4, 4) in the world, the newest; None before the first.
        outlined: whether the footprint has come.
    """

    def __init__(self, node: Shell, index: int, part: PushedLink, clock: StreamClock) -> None:
        self._node, self._part, self._clock = node, part, clock
        self.pose: Array | None = None
        self.outlined = False
        self._poses = Reordered[tuple[Array, Array | None]]()
        clock.on_move.append(self._poses.clear)
        link = f"link_{index + 1}"
        self._pose_topic, self._outline = (link_topic(link, k) for k in ("pose", "footprint"))
        need = Need.ALWAYS if index == 0 else Need.OPTIONAL
        node.listen(
            PoseWithCovarianceStamped, self._pose_topic, self._on_pose, sole=True, need=need
        )
        node.listen(PolygonStamped, self._outline, self._on_outline, LATCHED)

    def release(self, until: float, X_SW: Array) -> None:
        """Hand on the poses up to a time, s, in the frame of the support."""
        for time, (pose, covariance) in self._poses.take(until):
            self.pose, placed = pose, X_SW @ pose
            flat = np.array([*placed[:2, 3], np.arctan2(placed[1, 0], placed[0, 0])])
            self._part.add_pose(time, flat, _planar_std(covariance, X_SW[:3, :3]))

    def _on_pose(self, message: Stamped) -> None:
        both = read_tracked_pose(message, self._pose_topic, WORLD, self._node.faults, planar=True)
        time = self._clock.admit(message.stamp, self._pose_topic)
        _add(self._poses, time, both, self._pose_topic)

    def _on_outline(self, message: PolygonStamped) -> None:
        corners = np.array([[p.x, p.y] for p in message.polygon.points], dtype=float)
        if len(corners) < 3 or not np.isfinite(corners).all():
            raise MessageError("bad_outline", f"{self._outline}: {len(corners)} corners, not 3")
        self.outlined = True
        after = np.roll(corners, -1, axis=0)
        area = float(np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]))
        if self._part.set_outline(corners if area > 0.0 else corners[::-1].copy()):
            self._node.faults.add("outline_changed", f"{self._outline}: another object; forgotten")


def _planar_std(covariance: Array | None, turn: Array) -> Array | None:
    """Std (3,) of x, y and yaw in S from a covariance [rotation, position] in the world."""
    if covariance is None:
        return None
    place, angle = (turn @ covariance[k : k + 3, k : k + 3] @ turn.T for k in (3, 0))
    return np.sqrt(np.maximum([place[0, 0], place[1, 1], angle[2, 2]], 0.0))


class _Contact:
    """Force, standard deviation and place of one contact; silent or zero where nothing is touched.

    Args:
        node: that subscribes.
        name: of the contact.
        clock: of the node's streams.
    """

    def __init__(self, node: Shell, name: str, clock: StreamClock) -> None:
        self._node, self._name, self._clock = node, name, clock
        self._forces = Reordered[Array]()
        self._places = Reordered[Array]()
        self._recent: deque[tuple[float, Array]] = deque(maxlen=20)
        self._std = FORCE_STD
        clock.on_move += [self._forces.clear, self._places.clear, self._recent.clear]
        self._topics = {kind: contact_topic(name, kind) for kind in ("force", "force_std", "pose")}
        node.listen(PoseStamped, self._topics["pose"], self._on_pose, sole=True)
        node.listen(Vector3Stamped, self._topics["force_std"], self._on_std, sole=True)
        node.listen(WrenchStamped, self._topics["force"], self._on_force, sole=True)

    def take(self, until: float, X_SW: Array) -> list[ContactForce]:
        """Return the forces up to a time (s), in the frame of the support."""
        self._recent.extend(self._places.take(until))
        measured = []
        for time, force in self._forces.take(until):
            place = min(self._recent, key=lambda row: abs(row[0] - time), default=None)
            pose = X_SW
            if force.any():
                if place is None or abs(place[0] - time) > NEAR:
                    text = f"{self._topics['force']}: no pose of the contact within {NEAR} s"
                    self._node.faults.add(f"force_without_pose_{self._name}", text)
                    continue
                pose = X_SW @ place[1]
            std = np.abs(X_SW[:3, :3]) @ self._std
            turned = X_SW[:3, :3] @ force
            measured.append(ContactForce(self._name, time, turned, std, pose[:3, 3], pose[:3, 2]))
        return measured

    def _on_pose(self, message: Stamped) -> None:
        pose = pose_to_core(message, self._topics["pose"], WORLD)
        time = self._clock.admit(message.stamp, self._topics["pose"])
        _add(self._places, time, pose, self._topics["pose"])

    def _on_std(self, message: Stamped) -> None:
        std = read_force_std(message, self._topics["force_std"], self._node.faults)
        self._std = FORCE_STD if std is None else std

    def _on_force(self, message: Stamped) -> None:
        wrench = wrench_to_core(message, self._topics["force"], WORLD)
        time = self._clock.admit(message.stamp, self._topics["force"])
        _add(self._forces, time, wrench[3:], self._topics["force"])


def _add(held: Reordered[Any], time: float, item: Any, topic: str) -> None:
    """Hold a reading.

    Raises:
        MessageError: its stamp repeats or is passed already.
    """
    if not held.add(time, item):
        raise MessageError(
            "stamp_repeated", f"{topic}: stamp {time:.6f} s repeats or comes too late"
        )
