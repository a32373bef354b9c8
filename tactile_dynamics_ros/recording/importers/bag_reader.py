"""Messages of any recording with their definitions: split, compressed, of ROS 2 or of ROS 1."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.bag_files import (
    DAMAGE,
    ROS1_SUFFIX,
    named_connections,
    one_line,
    storage_parts,
)

_IDL_MARK = "=" * 80 + "\n"
"""Line between the files of a definition in IDL, as rosbag2 writes it."""
_BAD_TYPES = (TypesysError, *DAMAGE)
"""What reading a definition raises; the topics of other types can be read all the same."""


class BagReader:
    """Topics of one recording; types come from the recording itself, else from ROS.

    Raises:
        BadInputError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stack = ExitStack()
        self._is_ros1 = False
        self._readers: list[Any] = []
        self.connections: list[Any] = []

    def __enter__(self) -> BagReader:
        """Open all files."""
        parts = storage_parts(self.path)
        self._is_ros1 = parts[0].suffix == ROS1_SUFFIX
        try:
            for part in parts:
                reader = Ros1Reader(part) if self._is_ros1 else Reader(part)
                self._readers.append(self._stack.enter_context(reader))
            self.connections = [c for r in self._readers for c in named_connections(r)]
            self._store = self._types()
        except _BAD_TYPES as error:
            self._stack.close()
            raise BadInputError(f"{self.path} cannot be read: {one_line(error)}") from error
        return self

    def __exit__(self, *error: object) -> None:
        """Close all files."""
        self._stack.close()

    @property
    def types(self) -> dict[str, str]:
        """Message type of every topic."""
        return {c.topic: c.msgtype for c in self.connections}

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield receive time (ns) and message of one topic.

        Raises:
            BadInputError: there is no such topic, its type is not known, or it is damaged.
        """
        if topic not in self.types:
            present = ", ".join(sorted(self.types))
            raise BadInputError(f"{self.path} has no topic {topic}; the topics are {present}")
        store, name = self._store, self.types[topic]
        if name not in store.fielddefs:
            raise BadInputError(
                f"{self.path}: {topic} is a {name}, whose definition is not in the recording; "
                "record it as MCAP"
            )
        decode = store.deserialize_ros1 if self._is_ros1 else store.deserialize_cdr
        try:
            for reader in self._readers:
                own = [c for c in reader.connections if c.topic == topic]
                if own:
                    for _, received, data in reader.messages(connections=own):
                        yield received, decode(data, name)
        except _BAD_TYPES as error:
            raise BadInputError(f"{self.path}: {topic} is damaged: {one_line(error)}") from error

    def _types(self) -> Any:
        """Return all types that are known: those of ROS, replaced by those of the recording."""
        known = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_JAZZY)
        found = dict(known.fielddefs)
        for connection in self.connections:
            found |= _definitions(connection)
        store = get_typestore(Stores.EMPTY)
        store.register(found)
        return store


def _definitions(connection: Any) -> dict[str, Any]:
    """Return the types that a connection defines; none if they cannot be read."""
    text, kind = connection.msgdef.data, connection.msgdef.format
    try:
        if kind == MessageDefinitionFormat.MSG:
            return get_types_from_msg(text, connection.msgtype)
        if kind == MessageDefinitionFormat.IDL:
            files = text.split(_IDL_MARK)
            found: dict[str, Any] = {}
            for part in files:
                body = part.partition("\n")[2] if part.startswith("IDL: ") else part
                found |= get_types_from_idl(body) if body.strip() else {}
            return found
    except _BAD_TYPES:
        pass
    return {}
