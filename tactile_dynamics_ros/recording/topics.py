"""Topics of a recording as columns of numbers, in the order and units of core."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.core.streams.streams import between_turns
from tactile_dynamics_ros.recording.cdr import MessageTable
from tactile_dynamics_ros.recording.cleaning import Mask, ProblemLog, find_not_increasing

ROBOT_DESCRIPTION = "/robot_description"
"""Topic on which robots publish their URDF."""


@dataclass(frozen=True)
class PoseColumns:
    """Poses as they were measured.

    Attributes:
        label: topic or array name for messages to the user.
        time: (N,) s.
        position: (N, 3) m.
        quaternion: (N, 4) xyzw.
        covariance: (N, 6, 6) [rotation, position], or None.
    """

    label: str
    time: Array
    position: Array
    quaternion: Array
    covariance: Array | None = None


@dataclass(frozen=True)
class WrenchColumns:
    """Wrenches of one contact as they were measured.

    Attributes:
        label: topic or array name for messages to the user.
        time: (N,) s.
        force: (N, 3) N on the object, world axes.
        torque: (N, 3) N m about the contact point, world axes.
    """

    label: str
    time: Array
    force: Array
    torque: Array

    def in_world_axes(self, pose: PoseColumns) -> WrenchColumns:
        """Return a wrench of a sensor's own axes in those of the world, turned by its poses.

        Where no pose is a rotation the wrench is not finite.
        """
        length = np.linalg.norm(pose.quaternion, axis=1)
        known = np.isfinite(pose.time) & np.isfinite(length) & (length > 0.0)
        if not known.any() or not len(self.time):
            return replace(self, force=np.full_like(self.force, np.nan))
        stamps, first = np.unique(pose.time[known], return_index=True)
        order = np.flatnonzero(known)[first]
        turned = quaternion_to_matrix(pose.quaternion[order] / length[order, None])
        time = np.where(np.isfinite(self.time), self.time, stamps[0])
        rotation = between_turns(stamps, turned, time)
        return replace(
            self,
            force=np.einsum("nij,nj->ni", rotation, self.force),
            torque=np.einsum("nij,nj->ni", rotation, self.torque),
        )


@dataclass(frozen=True)
class StdColumns:
    """Standard deviations of a contact's force: (M,) s and (M, 3) N."""

    label: str
    time: Array
    std: Array


@dataclass(frozen=True)
class ImuColumns:
    """An IMU on the object as it was measured; absent columns are None.

    Attributes:
        label: topic or array name for messages to the user.
        time: (N,) s.
        specific_force: (N, 3) m/s^2, body axes.
        quaternion: (N, 4) xyzw, or None.
        angular_velocity: (N, 3) rad/s, body axes, or None.
        specific_force_std: m/s^2 per axis, or None.
    """

    label: str
    time: Array
    specific_force: Array
    quaternion: Array | None = None
    angular_velocity: Array | None = None
    specific_force_std: float | None = None


OBJECT_POSE = "/object/pose"
HAND_POSE = "/object/pose/kinematic"
VISION_POSE = "/object/pose/vision"
OBJECT_IMU = "/object/imu"
WORLD = "world"
CONTACT_TOPIC = re.compile(r"^/contact/(?P<name>[^/]+)/(?P<kind>force|force_std|pose)$")

NEEDED = re.compile(
    rf"{OBJECT_POSE}(/kinematic)?|{OBJECT_IMU}|/contact/[^/]+/(force|force_std|pose)"
)
"""Topics that a recording is made of."""

POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"
VECTOR_STAMPED = "geometry_msgs/msg/Vector3Stamped"
IMU = "sensor_msgs/msg/Imu"

POSE, WRENCH, TWIST = (f"geometry_msgs/msg/{kind}" for kind in ("Pose", "Wrench", "Twist"))
"""Types without a stamp and a frame."""

EXPECTED_TYPES = {
    "object_pose": (POSE_WITH_COVARIANCE, POSE_STAMPED, POSE),
    "object_imu": (IMU,),
    "force": (WRENCH_STAMPED, WRENCH, TWIST),
    "force_std": (VECTOR_STAMPED,),
    "pose": (POSE_STAMPED, POSE_WITH_COVARIANCE, POSE),
}
RECEIVE = "receive"
"""Word for stamps that are the times at which the recorder received the messages."""
NO_STAMPS = "unstamped: taken at their receive times"
"""Line on messages whose stamps are not there or were never set."""

ROTATION_THEN_POSITION = np.array([3, 4, 5, 0, 1, 2])
"""Swaps the two halves of a 6-vector between ROS's order and that of core."""


def contact_topic(name: str, kind: str) -> str:
    """Return the topic of one contact's force, force_std or pose."""
    return f"/contact/{name}/{kind}"


def topic_kind(topic: str) -> str | None:
    """Return what a topic holds for a recording, or None if it is not needed."""
    if topic == OBJECT_POSE:
        return "object_pose"
    if topic == HAND_POSE:
        return "hand_pose"
    if topic == OBJECT_IMU:
        return "object_imu"
    match = CONTACT_TOPIC.match(topic)
    return match["kind"] if match else None


def discover_contacts(types: dict[str, str]) -> list[str]:
    """Return the names of all contacts that publish a force, sorted."""
    matches = [CONTACT_TOPIC.match(topic) for topic in types]
    return sorted({m["name"] for m in matches if m and m["kind"] == "force"})


def suffice(names: Iterable[str]) -> bool:
    """Whether topics hold a motion and the force of a contact."""
    kinds = {topic_kind(name) for name in names}
    return "force" in kinds and not kinds.isdisjoint(("object_pose", "object_imu"))


def check_types(types: dict[str, str], source: str) -> None:
    """Check that every topic that counts has a message type that can be read.

    The hand's pose may be of any: it is left out then.

    Raises:
        BadInputError: names the topic, its type and the expected ones.
    """
    for topic, msgtype in types.items():
        kind = topic_kind(topic)
        if kind in EXPECTED_TYPES and msgtype not in EXPECTED_TYPES[kind]:
            expected = " or ".join(EXPECTED_TYPES[kind])
            raise BadInputError(f"{topic} in {source} is a {msgtype}; expected {expected}")


def require_topics(types: dict[str, str], source: str, contacts_required: bool) -> None:
    """Check that motion and contacts are recorded at all.

    Raises:
        BadInputError: names the missing topic, the file, topics that look alike, and what to do.
    """
    if OBJECT_POSE not in types and OBJECT_IMU not in types:
        raise BadInputError(
            _missing(f"{OBJECT_POSE} (or {OBJECT_IMU})", OBJECT_POSE, types, source)
        )
    names = discover_contacts(types)
    if contacts_required and not names:
        wanted = contact_topic("<finger>", "force")
        raise BadInputError(_missing(wanted, contact_topic("finger", "force"), types, source))
    for name in names:
        pose = contact_topic(name, "pose")
        if pose not in types:
            raise BadInputError(_missing(pose, pose, types, source))


def _missing(wanted: str, pattern: str, types: dict[str, str], source: str) -> str:
    """Return the message for a missing topic, with the nearest recorded name."""
    others = [topic for topic in types if topic_kind(topic) in (None, "hand_pose")]
    near = difflib.get_close_matches(pattern, others, n=1, cutoff=0.5)
    present = ", ".join(sorted(types)) or "none"
    hint = f"if {near[0]} is meant, remap it ({near[0]}:={pattern})" if near else "record it"
    return f"{wanted} is missing in {source} (topics: {present}); {hint}"


@dataclass(frozen=True)
class Clock:
    """Turns header stamps to seconds since the recording's first pose.

    Attributes:
        epoch_ns: stamp that becomes time zero.
    """

    epoch_ns: int

    def seconds(self, table: MessageTable) -> Array:
        """Return (N,) seconds."""
        return np.asarray((stamps_of(table) - self.epoch_ns) * 1e-9)

    @staticmethod
    def starting_at(table: MessageTable) -> Clock:
        """Return the clock that is zero at the first stamp in order of a table."""
        stamps = stamps_of(table)
        if not len(stamps):
            return Clock(0)
        return Clock(int(stamps[~find_not_increasing(stamps.astype(np.float64))][0]))


def stamps_of(table: MessageTable) -> NDArray[np.int64]:
    """Return the header stamps, or receive times where no header was ever stamped."""
    unset = len(table) > 1 and not np.any(table.stamp_ns)
    return table.receive_ns if unset else table.stamp_ns


def check_messages(topic: str, table: MessageTable, log: ProblemLog) -> None:
    """Count what is wrong with a topic's messages as messages."""
    log.note(topic, "message malformed (dropped)", table.malformed)
    if len(table) > 1 and not np.any(table.stamp_ns):
        log.note(topic, NO_STAMPS, len(table))
    if not len(table):
        log.note(topic, "topic without messages", 1)


def rows_of(table: MessageTable, mask: Mask) -> MessageTable:
    """Return some of the messages."""
    return MessageTable(
        table.stamp_ns[mask], table.receive_ns[mask], table.frame_id[mask], table.values[mask]
    )


def pose_columns(topic: str, table: MessageTable, clock: Clock) -> PoseColumns:
    """Return the columns of a PoseStamped or PoseWithCovarianceStamped topic."""
    covariance = None
    if table.values.shape[1] > 7:
        order = ROTATION_THEN_POSITION
        covariance = table.values[:, 7:].reshape(-1, 6, 6)[:, order][:, :, order]
    position, quaternion = table.values[:, :3], table.values[:, 3:7]
    return PoseColumns(topic, clock.seconds(table), position, quaternion, covariance)


def wrench_columns(topic: str, table: MessageTable, clock: Clock) -> WrenchColumns:
    """Return the columns of a WrenchStamped topic; messages carry the force first."""
    return WrenchColumns(topic, clock.seconds(table), table.values[:, :3], table.values[:, 3:])


def std_columns(topic: str, table: MessageTable, clock: Clock) -> StdColumns:
    """Return the columns of a Vector3Stamped topic of standard deviations."""
    return StdColumns(topic, clock.seconds(table), table.values)


def imu_columns(topic: str, table: MessageTable, clock: Clock) -> ImuColumns | None:
    """Return the columns of an Imu topic; a covariance that starts with -1 marks absence."""
    values = table.values
    orientation, turn, force = values[:, 4:13], values[:, 16:25], values[:, 28:37]
    if not len(values) or force[0, 0] == -1.0:
        return None
    variance = float(np.median(force[:, [0, 4, 8]]))
    return ImuColumns(
        label=topic,
        time=clock.seconds(table),
        specific_force=values[:, 25:28],
        quaternion=None if orientation[0, 0] == -1.0 else values[:, :4],
        angular_velocity=None if turn[0, 0] == -1.0 else values[:, 13:16],
        specific_force_std=float(np.sqrt(variance)) if variance > 0.0 else None,
    )
