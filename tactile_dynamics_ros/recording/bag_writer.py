"""Writes streams as rosbag2 in MCAP: a directory, or a file if the name ends in .mcap."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError, refuse_existing
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream, Streams
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.cdr import encode_messages

Array = NDArray[np.float64]
Table = tuple[str, str, NDArray[np.int64], list[bytes]]
"""Topic, message type, (N,) stamps in nanoseconds, N serialised messages."""

BODY = "object"
NOT_MEASURED = -1.0


def write_bag(streams: Streams, path: Path, epoch_ns: int = 0) -> Path:
    """Write streams to a new rosbag2 directory, or to a single file that ends in .mcap.

    Args:
        streams: what to write.
        path: where; must not exist.
        epoch_ns: stamp of time zero in nanoseconds.

    Raises:
        BadInputError: the path exists already or its parent cannot be written.
    """
    return write_tables(_tables(streams, epoch_ns), path)


def write_tables(tables: list[Table], path: Path) -> Path:
    """Write serialised topics to a new rosbag2 directory, or a single file that ends in .mcap.

    Raises:
        BadInputError: the path exists already or its parent cannot be written.
    """
    refuse_existing(path)
    with written_whole(path) as part:
        if is_single_file(path):
            directory = part.with_name("recording")
            _write_directory(directory, tables)
            keep_single_file(directory, part)
        else:
            _write_directory(part, tables)
    return path


def is_single_file(path: Path) -> bool:
    """Whether a recording of this name is one file, and not a rosbag2 directory."""
    return path.suffix == ".mcap"


def keep_single_file(directory: Path, path: Path) -> None:
    """Replace a finished rosbag2 directory by the one MCAP file in it.

    Args:
        directory: with metadata and one MCAP file; is removed.
        path: of the file.
    """
    (file,) = directory.glob("*.mcap")
    shutil.move(str(file), path)
    shutil.rmtree(directory)


def _write_directory(directory: Path, tables: list[Table]) -> None:
    """Write all messages of all topics in the order of their stamps."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = [writer.add_connection(t, kind, typestore=store) for t, kind, _, _ in tables]
        stamps = np.concatenate([stamp for _, _, stamp, _ in tables])
        owner = np.concatenate([np.full(len(s), k) for k, (_, _, s, _) in enumerate(tables)])
        messages = [data for _, _, _, raw in tables for data in raw]
        for index in np.argsort(stamps, kind="stable").tolist():
            writer.write(connections[owner[index]], int(stamps[index]), messages[index])


def _tables(streams: Streams, epoch_ns: int) -> list[Table]:
    """Return the serialised topics of all streams."""
    tables: list[Table] = []
    if streams.pose is not None:
        tables.append(_pose_table(streams.pose, epoch_ns))
    for contact in streams.contacts.values():
        tables.extend(_contact_tables(contact, epoch_ns))
    if streams.imu is not None:
        tables.append(_imu_table(streams.imu, epoch_ns))
    if not tables:
        raise BadInputError("there is nothing to write: the recording has no stream")
    return tables


def encode_table(
    topic: str, kind: str, time: Array, epoch_ns: int, frame: str, values: Array
) -> Table:
    """Serialise one topic."""
    stamps = np.rint(time * 1e9).astype(np.int64) + epoch_ns
    return topic, kind, stamps, encode_messages(kind, stamps, frame, values)


def _pose_table(pose: PoseStream, epoch_ns: int) -> Table:
    """Serialise the object's poses; a covariance that is not stated is all zero."""
    covariance = np.zeros((len(pose.time), 36))
    if pose.covariance is not None:
        order = topics.ROTATION_THEN_POSITION
        covariance = pose.covariance[:, order][:, :, order].reshape(-1, 36)
    values = np.concatenate([_pose_values(pose.position, pose.rotation), covariance], axis=1)
    kind = topics.POSE_WITH_COVARIANCE
    return encode_table(topics.OBJECT_POSE, kind, pose.time, epoch_ns, topics.WORLD, values)


def _pose_values(position: Array, rotation: Array) -> Array:
    """Return (N, 7) position and quaternion xyzw."""
    return np.concatenate([position, matrix_to_quaternion(rotation)], axis=1)


def _contact_tables(contact: ContactStream, epoch_ns: int) -> list[Table]:
    """Serialise the topics of one contact; messages carry the force before the torque."""
    force, pose, std = (
        topics.contact_topic(contact.name, k) for k in ("force", "pose", "force_std")
    )
    wrench = np.concatenate([contact.force, contact.torque], axis=1)
    where = _pose_values(contact.position, contact.rotation)
    frame = topics.WORLD
    tables = [
        encode_table(force, topics.WRENCH_STAMPED, contact.time, epoch_ns, frame, wrench),
        encode_table(pose, topics.POSE_STAMPED, contact.pose_time, epoch_ns, frame, where),
    ]
    if contact.force_std is not None:
        kind = topics.VECTOR_STAMPED
        tables.append(encode_table(std, kind, contact.time, epoch_ns, frame, contact.force_std))
    return tables


def _imu_table(imu: ImuStream, epoch_ns: int) -> Table:
    """Serialise the IMU; -1 in a covariance marks what it does not measure."""
    values = np.zeros((len(imu.time), 37))
    values[:, 3] = 1.0
    if imu.rotation is None:
        values[:, 4] = NOT_MEASURED
    else:
        values[:, :4] = matrix_to_quaternion(imu.rotation)
    if imu.angular_velocity is None:
        values[:, 16] = NOT_MEASURED
    else:
        values[:, 13:16] = imu.angular_velocity
    values[:, 25:28] = imu.specific_force
    values[:, [28, 32, 36]] = (imu.specific_force_std or 0.0) ** 2
    return encode_table(topics.OBJECT_IMU, topics.IMU, imu.time, epoch_ns, BODY, values)
