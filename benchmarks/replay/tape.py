"""A recording as the messages of its topics, in the order in which they are sent."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.ros.wire import COUNTS, Stamp, encode_stamped

NANOSECONDS = 10**9
OBJECT_POSE = "/object/pose"
KINDS: dict[str, type[Any]] = {
    "force": WrenchStamped,
    "force_std": Vector3Stamped,
    "pose": PoseStamped,
}
COUNTED = {stream: COUNTS[kind] for stream, kind in KINDS.items()}
"""Doubles of the messages of each stream."""
_SWAP = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])
_RANK = {"force_std": 1, "force": 2, "pose": 3}
"""Order of the messages of one finger and instant, as contact_state sends them."""


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """One message that waits to be sent.

    Attributes:
        due: time of the replay at which it is sent, s.
        topic: it is sent on.
        stamp_ns: of its header, before the player's epoch is added.
        values: doubles behind the header.
        frame_id: of the header.
        sender: which of several publishers of the topic sends it; "" is the usual one.
        garble: done to the serialised message before it is sent, if not None.
        absolute: the stamp is sent as it is, without the epoch.
    """

    due: float
    topic: str
    stamp_ns: int
    values: Array
    frame_id: str = "world"
    sender: str = ""
    garble: Callable[[bytes], bytes] | None = None
    absolute: bool = False

    @property
    def finger(self) -> str:
        """Name of the contact, or "" for poses of the object."""
        parts = self.topic.split("/")
        return parts[2] if parts[1] == "contact" else ""

    @property
    def stream(self) -> str:
        """What it is of a contact: force, force_std or pose; "object" for poses of the object."""
        return self.topic.rsplit("/", 1)[1] if self.finger else "object"

    def encoded(self, epoch_ns: int) -> bytes:
        """Return the serialised message, its stamp counted from the epoch."""
        stamp = self.stamp_ns + (0 if self.absolute else epoch_ns)
        raw = encode_stamped(Stamp(*divmod(stamp, NANOSECONDS)), self.frame_id, self.values)
        return raw if self.garble is None else self.garble(raw)


def message_kind(topic: str) -> type[Any]:
    """Return the type of a topic's messages."""
    if topic.startswith("/contact/"):
        return KINDS[topic.rsplit("/", 1)[1]]
    return PoseWithCovarianceStamped


def messages_of(streams: Streams) -> list[Message]:
    """Return all messages of a recording by stamp; each is due at its stamp."""
    found = list(_object_messages(streams.pose)) if streams.pose else []
    for contact in streams.contacts.values():
        found += _contact_messages(contact)
    return sorted(found, key=lambda m: (m.stamp_ns, m.finger, _RANK.get(m.stream, 0)))


def _object_messages(poses: PoseStream) -> Iterator[Message]:
    quaternions = matrix_to_quaternion(poses.rotation)
    for n, time in enumerate(poses.time.tolist()):
        covariance = np.zeros((6, 6)) if poses.covariance is None else poses.covariance[n][_SWAP]
        values = np.concatenate([poses.position[n], quaternions[n], covariance.ravel()])
        yield _message(time, OBJECT_POSE, values)


def _contact_messages(contact: ContactStream) -> Iterator[Message]:
    topic = f"/contact/{contact.name}"
    for n, time in enumerate(contact.time.tolist()):
        if contact.force_std is not None:
            yield _message(time, f"{topic}/force_std", contact.force_std[n])
        wrench = np.concatenate([contact.force[n], contact.torque[n]])
        yield _message(time, f"{topic}/force", wrench)
    quaternions = matrix_to_quaternion(contact.rotation)
    for n, time in enumerate(contact.pose_time.tolist()):
        yield _message(time, f"{topic}/pose", np.concatenate([contact.position[n], quaternions[n]]))


def _message(time: float, topic: str, values: Array) -> Message:
    return Message(time, topic, round(time * NANOSECONDS), values)
