"""Write streams as a rosbag2 (MCAP) without help from the package: an independent second writer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

EPOCH_NS = 1_700_000_000_000_000_000
_STORE = get_typestore(Stores.ROS2_JAZZY)
_TYPES = _STORE.types


def write_bag(streams: Streams, path: Path) -> Path:
    """Write all streams; the messages are in the order of their stamps.

    Raises:
        FileExistsError: the path exists.
    """
    if path.exists():
        raise FileExistsError(f"{path} exists; choose a new directory")
    messages = _pose_messages(streams.pose) if streams.pose else []
    for contact in streams.contacts.values():
        messages += _contact_messages(contact)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for stamp, topic, message in sorted(messages, key=lambda entry: entry[0]):
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, message.__msgtype__, typestore=_STORE
                )
            data = _STORE.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[topic], stamp, data)
    return path


def _create(kind: str, **fields: object) -> object:
    return _TYPES[kind](**fields)


def _stamp_ns(seconds: float) -> int:
    return EPOCH_NS + round(seconds * 1e9)


def _header(stamp: int) -> object:
    time = _create("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return _create("std_msgs/msg/Header", stamp=time, frame_id="world")


def _vector(kind: str, xyz: np.ndarray) -> object:
    return _create(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", map(float, xyz), strict=True)))


def _pose(position: np.ndarray, quaternion: np.ndarray) -> object:
    turn = _create(
        "geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, quaternion), strict=True))
    )
    return _create("geometry_msgs/msg/Pose", position=_vector("Point", position), orientation=turn)


def _pose_messages(poses: PoseStream) -> list[tuple]:
    order = [3, 4, 5, 0, 1, 2]
    messages = []
    quaternions = Rotation.from_matrix(poses.rotation).as_quat()
    for n, time in enumerate(poses.time):
        stamp = _stamp_ns(time)
        covariance = np.zeros(36)
        if poses.covariance is not None:
            covariance = poses.covariance[n][np.ix_(order, order)].reshape(36)
        body = _create(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=_pose(poses.position[n], quaternions[n]),
            covariance=covariance,
        )
        message = _create(
            "geometry_msgs/msg/PoseWithCovarianceStamped", header=_header(stamp), pose=body
        )
        messages.append((stamp, "/object/pose", message))
    return messages


def _contact_messages(contact: ContactStream) -> list[tuple]:
    messages = []
    topic = f"/contact/{contact.name}"
    for n, time in enumerate(contact.time):
        stamp = _stamp_ns(time)
        wrench = _create(
            "geometry_msgs/msg/Wrench",
            force=_vector("Vector3", contact.force[n]),
            torque=_vector("Vector3", contact.torque[n]),
        )
        message = _create("geometry_msgs/msg/WrenchStamped", header=_header(stamp), wrench=wrench)
        messages.append((stamp, f"{topic}/force", message))
        if contact.force_std is not None:
            std = _vector("Vector3", contact.force_std[n])
            message = _create("geometry_msgs/msg/Vector3Stamped", header=_header(stamp), vector=std)
            messages.append((stamp, f"{topic}/force_std", message))
    quaternions = Rotation.from_matrix(contact.rotation).as_quat()
    for n, time in enumerate(contact.pose_time):
        stamp = _stamp_ns(time)
        pose = _pose(contact.position[n], quaternions[n])
        message = _create("geometry_msgs/msg/PoseStamped", header=_header(stamp), pose=pose)
        messages.append((stamp, f"{topic}/pose", message))
    return messages
