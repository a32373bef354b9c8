"""Forces of three-axis sensors in a tip and in pads to contacts on an object's outline."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import (
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from std_msgs.msg import Float64

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.contact_state import (
    OutlineContact,
    OutlineContactConfig,
    nearest_side,
)
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.ros.conversions import (
    MessageError,
    StampGate,
    pose_to_core,
    std_to_core,
    to_seconds,
    wrench_to_core,
)
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    GRIPPER_WIDTH,
    PUSHER_POSE,
    fingertip_topic,
    link_topic,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.pusher_streams import (
    PUSHER_FRAME,
    WORLD,
    ContactStreams,
    SensedConfig,
)
from tactile_dynamics_ros.ros.robot import JointHistory
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.wire import Stamp, Stamped

WAITING = 200
LINKS = ("link_1", "link_2")
SIDE = {"pad_left": 1.0, "pad_right": -1.0}


class _Touch(NamedTuple):
    """A force (3,) that waits for poses at its time, axes of the gripper."""

    name: str
    stamp: Stamp
    time: float
    force: Array


class PushedContacts:
    """Places each force where tip and object were at its time.

    A tip touches the nearest outline; a pad touches in the middle of its face.

    Args:
        node: that listens and publishes; its `process` has to call this one's.
    """

    def __init__(self, node: Shell) -> None:
        self._node = node
        self.config = declare_config(node, OutlineContactConfig, "outline.")
        self.names = declare_config(node, SensedConfig).contacts
        self._std: dict[str, Array] = {}
        self._width = 0.0
        self._pusher = JointHistory()
        self._links: dict[str, JointHistory] = {}
        self._outlines: dict[str, Array] = {}
        self._waiting: deque[_Touch] = deque(maxlen=WAITING)
        self._told = ContactStreams(node, self.names)
        take = self._pose_taker(PUSHER_POSE, self._pusher)
        node.listen(PoseStamped, PUSHER_POSE, take, need=Need.ALWAYS)
        node.listen(Float64, GRIPPER_WIDTH, self._on_width)
        for link in LINKS:
            topic, outline = link_topic(link, "pose"), link_topic(link, "footprint")
            history = self._links[link] = JointHistory()
            node.listen(PoseWithCovarianceStamped, topic, self._pose_taker(topic, history))
            node.listen(PolygonStamped, outline, self._outline_taker(link), LATCHED)
        for name in self.names:
            force, std = (fingertip_topic(name, kind, "pad") for kind in ("force", "force_std"))
            node.listen(Vector3Stamped, std, self._std_taker(name, std))
            node.listen(WrenchStamped, force, self._force_taker(name, force), need=Need.ONCE)

    def process(self) -> None:
        """Place the forces for whose time poses are known; each contact's in their order."""
        held: set[str] = set()
        for _ in range(len(self._waiting)):
            touch = self._waiting.popleft()
            if touch.name in held or not self._publish_if_known(touch):
                held.add(touch.name)
                self._waiting.append(touch)

    def _publish_if_known(self, touch: _Touch) -> bool:
        """Publish a force; False where it has to wait for poses."""
        if np.linalg.norm(touch.force) < self.config.touch_force:
            self._publish(touch, np.zeros(3), None)
            return True
        histories = [self._pusher, *(self._links[link] for link in self._outlines)]
        if not self._outlines or any(history.newest < touch.time for history in histories):
            return False
        frames = [frame for history in histories if (frame := history.at(touch.time)) is not None]
        if len(frames) < len(histories):
            self._node.faults.add("force_older_than_poses")
        else:
            self._place(touch, *frames)
        return True

    def _place(self, touch: _Touch, pusher: Array, *links: Array) -> None:
        """Publish a contact with the pusher and the links where they were."""
        turn = _turn(pusher[3])
        force = np.array([*(turn @ touch.force[:2]), touch.force[2]])
        if touch.name in SIDE:
            out = SIDE[touch.name] * turn[:, 1]
            contact = OutlineContact(pusher[:2] + 0.5 * self._width * out, -out, 0.0)
        else:
            outlines = [
                link[:2] + corners @ _turn(link[3]).T
                for link, corners in zip(links, self._outlines.values(), strict=True)
            ]
            contact = nearest_side(pusher[:2], outlines)
        if contact.gap - self.config.tip_radius > self.config.reach:
            self._node.faults.add("touch_off_the_object", "a tip feels a force far from the object")
            return
        pose = np.eye(4)
        normal = np.array([*contact.normal, 0.0])
        across = np.array([-normal[1], normal[0], 0.0])
        pose[:3, :3] = np.column_stack([across, [0.0, 0.0, 1.0], normal])
        pose[:3, 3] = [*contact.point, pusher[2]]
        self._publish(touch, force, pose)

    def _publish(self, touch: _Touch, force: Array, pose: Array | None) -> None:
        std = self._std[touch.name]
        told = self._told.messages(
            touch.name, force, std, np.eye(4) if pose is None else pose, touch.stamp
        )
        for publisher, message in told if pose is not None else told[-1:]:
            publisher.publish(message)

    def _pose_taker(self, topic: str, history: JointHistory) -> Callable[[Stamped], None]:
        gate, last = StampGate(topic), [0.0]

        def take(message: Stamped) -> None:
            pose = pose_to_core(message, topic, WORLD)
            if gate.check(message.stamp):
                self._node.faults.add("clock_restarted")
                history.clear()
                self._waiting.clear()
            turn = np.arctan2(pose[1, 0], pose[0, 0]) - last[0]
            last[0] += (turn + np.pi) % (2.0 * np.pi) - np.pi
            history.add(to_seconds(message.stamp), np.array([*pose[:3, 3], last[0]]))

        return take

    def _outline_taker(self, link: str) -> Callable[[PolygonStamped], None]:
        def take(message: PolygonStamped) -> None:
            corners = np.array([[p.x, p.y] for p in message.polygon.points], dtype=float)
            if len(corners) < 3 or not np.isfinite(corners).all():
                topic = link_topic(link, "footprint")
                raise MessageError("bad_outline", f"{topic}: {len(corners)} corners; expected 3")
            self._outlines = dict(sorted({**self._outlines, link: corners}.items()))

        return take

    def _std_taker(self, name: str, topic: str) -> Callable[[Stamped], None]:
        def take(message: Stamped) -> None:
            self._std[name] = std_to_core(message, topic)

        return take

    def _force_taker(self, name: str, topic: str) -> Callable[[Stamped], None]:
        gate = StampGate(topic)

        def take(message: Stamped) -> None:
            wrench = wrench_to_core(message, topic, PUSHER_FRAME)
            gate.check(message.stamp)
            if name not in self._std:
                raise NotIdentifiableError(f"{topic}_std has not come yet")
            if len(self._waiting) == WAITING:
                text = "forces come but no poses of pusher and object, or no outline"
                self._node.faults.add("poses_missing", text)
            self._waiting.append(_Touch(name, message.stamp, to_seconds(message.stamp), wrench[3:]))

        return take

    def _on_width(self, message: Float64) -> None:
        self._width = float(message.data)


def _turn(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
