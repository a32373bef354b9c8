"""Writes a recording message by message; a full disk ends it as a whole and readable one."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import refuse_existing
from tactile_dynamics_ros.recording.bag_writer import is_single_file, keep_single_file

RESERVE = 16 << 20
"""Bytes that are kept free for the end of a recording: the block of messages that is not written
yet (1 MB, or one larger message), and the index, 100 bytes for each MB and topic recorded."""


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
        self._types = get_typestore(Stores.ROS2_JAZZY)
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
