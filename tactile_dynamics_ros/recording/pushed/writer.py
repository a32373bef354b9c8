"""Streams of a pushed object as a rosbag2 recording, and the names of its topics."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.arrays import frame_of_normal
from tactile_dynamics_ros.recording.bag_writer import Table, encode_table, write_tables
from tactile_dynamics_ros.recording.pushed import writer as names

SUPPORT_POSE = "/support/pose"
PUSHER_POSE, PUSHER_TARGET = "/pusher/pose", "/pusher/target"
POLYGON_STAMPED = "geometry_msgs/msg/PolygonStamped"
NEEDED = re.compile(
    rf"/object(/link_\d+)?/(pose|footprint)|{SUPPORT_POSE}|{PUSHER_POSE}|{PUSHER_TARGET}"
    r"|/contact/[^/]+/(force|force_std|pose)"
)
"""Topics that a recording of a pushed object is made of."""
_MOST_LINKS = 2


def link_topic(index: int, kind: str) -> str:
    """Return the topic of a link's pose or footprint; link_1 is the object itself."""
    return f"/object/{kind}" if index == 0 else f"/object/link_{index + 1}/{kind}"


def link_frame(index: int) -> str:
    """Return the name of a link's frame."""
    return "object" if index == 0 else f"link_{index + 1}"


def links_of(names: Iterable[str]) -> int:
    """Return how many links have poses, counted without gaps."""
    known, count = set(names), 0
    while count < _MOST_LINKS and link_topic(count, "pose") in known:
        count += 1
    return count


def suffice(names: Iterable[str]) -> bool:
    """Whether topics hold the motion of an object, its outline and a contact or a pusher."""
    known = set(names)
    contact = any(topics.CONTACT_TOPIC.match(name) for name in known) or PUSHER_POSE in known
    return contact and {link_topic(0, "pose"), link_topic(0, "footprint")} <= known


def marks_a_push(names: Iterable[str]) -> bool:
    """Whether topics, in any namespace, are a footprint, a support or a pusher."""
    marks = (link_topic(0, "footprint"), SUPPORT_POSE, PUSHER_POSE)
    return any(name.endswith(marks) for name in names)


def write_pushed(streams: PushedStreams, path: Path, epoch_ns: int = 0) -> Path:
    """Write streams to a new rosbag2 directory, or to a single file that ends in .mcap.

    The world of the messages is upright: its z axis is against gravity.

    Raises:
        BadInputError: the path exists already or cannot be written.
    """
    up = -streams.gravity / np.linalg.norm(streams.gravity)
    R_WS = frame_of_normal(up[None])[0].T
    start = min(float(link.time[0]) for link in streams.links)
    still = np.concatenate([np.zeros((1, 3)), matrix_to_quaternion(R_WS[None])], axis=1)
    tables = [_encode(names.SUPPORT_POSE, topics.POSE_STAMPED, np.array([start]), still, epoch_ns)]
    for k, link in enumerate(streams.links):
        tables += [_link(k, link, R_WS, epoch_ns), _footprint(k, link.footprint, start, epoch_ns)]
    for contact in streams.contacts.values():
        tables += _contact(contact, R_WS, epoch_ns)
    if streams.pusher_time is not None and streams.pusher_yaw is not None and streams.contacts:
        tables.append(_pusher(streams, R_WS, epoch_ns))
    return write_tables(tables, path)


def _pusher(streams: PushedStreams, R_WS: Array, epoch_ns: int) -> Table:
    """Pose of the pusher: its axes, and the place of the first contact."""
    assert streams.pusher_time is not None and streams.pusher_yaw is not None
    contact = next(iter(streams.contacts.values()))
    place = np.stack(
        [np.interp(streams.pusher_time, contact.pose_time, p) for p in contact.point.T], axis=1
    )
    turn = matrix_to_quaternion(R_WS @ _about_normal(streams.pusher_yaw))
    values = np.concatenate([place @ R_WS.T, turn], axis=1)
    return _encode(names.PUSHER_POSE, topics.POSE_STAMPED, streams.pusher_time, values, epoch_ns)


def _about_normal(yaw: Array) -> Array:
    c, s, zero = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    rows = [c, -s, zero, s, c, zero, zero, zero, zero + 1.0]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


def _encode(topic: str, kind: str, time: Array, values: Array, epoch_ns: int) -> Table:
    return encode_table(topic, kind, time, epoch_ns, topics.WORLD, values)


def _link(k: int, link: LinkStream, R_WS: Array, epoch_ns: int) -> Table:
    x, y, yaw = link.pose.T
    zero, turn = np.zeros_like(yaw), _about_normal(yaw)
    position = np.stack([x, y, zero], axis=1) @ R_WS.T
    values = np.zeros((len(yaw), 43))
    values[:, :3], values[:, 3:7] = position, matrix_to_quaternion(R_WS @ turn)
    if link.pose_std is not None:
        across, _, about = link.pose_std
        values[:, 7:] = np.diag(np.repeat([across**2, about**2], 3)).reshape(-1)
    topic, kind = names.link_topic(k, "pose"), topics.POSE_WITH_COVARIANCE
    return _encode(topic, kind, link.time, values, epoch_ns)


def _footprint(k: int, corners: Array, start: float, epoch_ns: int) -> Table:
    store = get_typestore(Stores.ROS2_JAZZY)
    types, stamp = store.types, epoch_ns + round(start * 1e9)
    points = [types["geometry_msgs/msg/Point32"](x=float(x), y=float(y), z=0.0) for x, y in corners]
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    message = types[names.POLYGON_STAMPED](
        header=types["std_msgs/msg/Header"](stamp=time, frame_id=names.link_frame(k)),
        polygon=types["geometry_msgs/msg/Polygon"](points=points),
    )
    data = bytes(store.serialize_cdr(message, names.POLYGON_STAMPED))
    topic = names.link_topic(k, "footprint")
    return topic, names.POLYGON_STAMPED, np.array([stamp], dtype=np.int64), [data]


def _contact(contact: PushContact, R_WS: Array, epoch_ns: int) -> list[Table]:
    turn = R_WS @ frame_of_normal(contact.normal)
    where = np.concatenate([contact.point @ R_WS.T, matrix_to_quaternion(turn)], axis=1)
    if contact.point_std is None:
        kind = topics.POSE_STAMPED
    else:
        kind = topics.POSE_WITH_COVARIANCE
        covariance = np.diag([contact.point_std**2] * 3 + [0.0] * 3).reshape(-1)
        where = np.concatenate([where, np.tile(covariance, (len(where), 1))], axis=1)
    pose = topics.contact_topic(contact.name, "pose")
    tables = [_encode(pose, kind, contact.pose_time, where, epoch_ns)]
    if not len(contact.time):
        return tables
    torque = np.zeros_like(contact.force) if contact.torque is None else contact.torque
    wrench = np.concatenate([contact.force @ R_WS.T, torque @ R_WS.T], axis=1)
    topic = topics.contact_topic(contact.name, "force")
    tables.append(_encode(topic, topics.WRENCH_STAMPED, contact.time, wrench, epoch_ns))
    if contact.force_std is not None:
        std = np.tile(contact.force_std, (len(contact.time), 1))
        topic = topics.contact_topic(contact.name, "force_std")
        tables.append(_encode(topic, topics.VECTOR_STAMPED, contact.time, std, epoch_ns))
    return tables
