"""Writes recordings as rosbag2 in MCAP: streams at once, or message by message."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, refuse_existing
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream, Streams
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.cdr import encode_messages
from tactile_dynamics_ros.share import share_file

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


RESERVE = 16 << 20
"""Bytes that are kept free for the end of a recording: the block of messages that is not written
yet (1 MB, or one larger message), and the index, 100 bytes for each MB and topic recorded."""


def _known_types() -> Typestore:
    """Return the message types of ROS and those of interfaces/."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in ("Effect", "Estimate", "Verdict"):
        text = share_file(f"interfaces/msg/{name}.msg").read_text()
        store.register(get_types_from_msg(text, f"tactile_dynamics_msgs/msg/{name}"))
    return store


class LiveWriter:
    """Writes to a new rosbag2 directory, or to a file that ends in .mcap.

    A file is written in the directory `<path>.part`, which stays readable if the process is killed.
    Beside the recording lies a file of `RESERVE` bytes. Once a message cannot be written, it makes
    room for what is not written yet, the index and the metadata.

    Args:
        path: new directory or file; folders above it are made.

    Raises:
        BadInputError: it, or the directory of a file, is there already.
        OSError: there is no room for the reserve; nothing is left.

    Attributes:
        folder: in which the recording grows.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder = path.with_name(f"{path.name}.part") if is_single_file(path) else path
        refuse_existing(self.folder)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._types = _known_types()
        self._writer = Writer(self.folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self._reserve = self.folder / ".reserve"
        self._storage: Any = self._writer.storage
        self._file = self.folder / f"{self.folder.name}.mcap"
        self._continue_at(self._storage.bio.tell())
        try:
            with self._reserve.open("wb") as stream:
                os.posix_fallocate(stream.fileno(), 0, RESERVE)
        except OSError:
            self._writer.abort()
            shutil.rmtree(self.folder)
            raise

    def add_connection(self, topic: str, kind: str) -> Connection:
        """Return a new topic of a message type.

        Raises:
            KeyError: the type is unknown.
            WriterError: the topic is there already.
        """
        return self._writer.add_connection(topic, kind, typestore=self._types)

    def write(self, connection: Connection, time: int, data: bytes) -> None:
        """Write a message.

        Args:
            connection: its topic.
            time: when it was received, ns.
            data: serialised.

        Raises:
            OSError: it cannot be written, as on a full disk. `close` then ends the recording with
                all messages, this one included.
        """
        try:
            self._writer.write(connection, time, data)
        except OSError:
            self._writer.counts[connection.id] += 1  # it is in the block that is written at the end
            raise
        if len(self._storage.chunks) != self._blocks:
            self._blocks, self._end = len(self._storage.chunks), self._storage.bio.tell()

    def close(self) -> None:
        """Finish the recording.

        Raises:
            OSError: not even the reserve suffices; what was written before can be salvaged.
        """
        self._reserve.unlink(missing_ok=True)
        if self._storage.bio.tell() != self._end:  # a block of which only a part was written
            self._continue_at(self._end)
        try:
            self._writer.close()
        except OSError:
            with suppress(OSError):
                self._writer.abort()
            raise
        if self.folder != self.path:
            keep_single_file(self.folder, self.path)

    def _continue_at(self, position: int) -> None:
        """Write on from a position in the file; what stands behind it is dropped."""
        with suppress(OSError):
            self._storage.bio.close()
        os.truncate(self._file, position)
        self._storage.bio = Unbuffered(FileIO(self._file, "r+b"))
        self._storage.bio.seek(position)
        self._blocks, self._end = len(self._storage.chunks), position


class Unbuffered(BufferedWriter):
    """A file that is full when it is written to, not when it is closed."""

    def write(self, data: Any) -> int:
        """Write all bytes to the disk.

        Raises:
            OSError: they do not fit.
        """
        count = super().write(data)
        self.flush()
        return count
