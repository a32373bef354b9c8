"""Messages of any recording with their definitions, as columns of numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
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


Getter = Callable[[Any], Iterable[float]]
"""Takes the numbers of a message."""

POSE_COLUMNS = (*(f"position.{a}" for a in "xyz"), *(f"orientation.{a}" for a in "xyzw"))
"""Columns of poses and transforms."""
WRENCH_COLUMNS = (*(f"force.{a}" for a in "xyz"), *(f"torque.{a}" for a in "xyz"))
"""Columns of wrenches."""
TWIST_COLUMNS = (*(f"linear.{a}" for a in "xyz"), *(f"angular.{a}" for a in "xyz"))
"""Columns of twists, as which some drivers of force sensors publish wrenches too."""
_KINDS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("force", "torque", WRENCH_COLUMNS),
    ("position", "orientation", POSE_COLUMNS),
    ("translation", "rotation", POSE_COLUMNS),
    ("linear", "angular", TWIST_COLUMNS),
)
"""The two members of a vector kind of geometry_msgs, and its columns."""
_WRAPPED = ("wrench", "pose", "transform", "twist")
"""Members that hold one of these in a stamped message; of odometry it is the pose."""
_LONGEST = 64
"""Numbers of an array that become columns: matrices have 16, covariances 36, clouds thousands."""
_DEEPEST = 5
"""Levels of messages within messages that are looked into; drivers nest three."""


def columns_of(message: Any) -> tuple[tuple[str, ...], Getter]:
    """Return the names of a message's numbers, and what takes them from messages alike.

    Poses, wrenches, twists and joint states have plain names; the numbers of other types are named
    by their path, as `o_t_ee.position.x` or `data.3`; those of an array are 0, 1, ...
    """
    if isinstance(message, np.ndarray):
        return tuple(str(k) for k in range(message.size)), lambda one: np.ravel(one).tolist()
    parts = _parts(message, "", 0)
    names = tuple(name for part in parts for name in part[0])
    getters = [part[1] for part in parts]
    return names, lambda one: [float(number) for get in getters for number in get(one)]


def joints_of(message: Any) -> tuple[str, ...]:
    """Return the names of the joints of a joint state, in order; none of another message."""
    known = hasattr(message, "name") and hasattr(message, "position")
    return tuple(sorted(map(str, message.name))) if known and len(message.position) else ()


def _by_name(path: str, joints: Sequence[str]) -> Getter:
    """Return what takes the positions of joints, in whatever order messages have them."""
    get = attrgetter(path) if path else lambda message: message

    def positions(message: Any) -> list[float]:
        state = get(message)
        at = dict(zip(map(str, state.name), state.position, strict=False))
        return [at.get(name, float("nan")) for name in joints]

    return positions


def member_of(message: Any, field: str) -> Any:
    """Return the part of a message at a path such as `state.o_t_ee`; all of it for "".

    Raises:
        BadInputError: it has none there.
    """
    for name in filter(None, field.split(".")):
        known = [key for key in getattr(message, "__dataclass_fields__", {}) if key[:2] != "__"]
        if name not in known:
            raise BadInputError(f"no field '{name}'; it has {', '.join(known) or 'none'}")
        message = getattr(message, name)
    return message


def _parts(message: Any, path: str, depth: int) -> list[tuple[Sequence[str], Getter]]:
    """Return names and getters of a message and of those in it."""
    vectors = _vectors(message)
    if vectors is not None:
        inside, names = vectors
        own = [".".join(filter(None, (path, member))) for member in inside]
        return [([_joined(path, name) for name in names], attrgetter(*own))]
    if joints := joints_of(message):
        return [([_joined(path, name) for name in joints], _by_name(path, joints))]
    found = []
    for key in getattr(message, "__dataclass_fields__", {}):
        if not key.startswith("__") and key not in ("header", "layout", "stamp"):
            found += _member_parts(getattr(message, key), _joined(path, key), depth)
    return found


def _member_parts(value: Any, path: str, depth: int) -> list[tuple[Sequence[str], Getter]]:
    """Return names and getters of one member: a number, an array, or a message."""
    if isinstance(value, bool | int | float | np.number):
        get = attrgetter(path)
        return [([path], lambda message: (get(message),))]
    if isinstance(value, np.ndarray):
        flat = value.ravel()
        if flat.dtype.kind not in "fiub" or not 0 < len(flat) <= _LONGEST:
            return []
        return [([f"{path}.{k}" for k in range(len(flat))], _member(path))]
    if hasattr(value, "__dataclass_fields__") and depth < _DEEPEST:
        return _parts(value, path, depth + 1)
    return []


def _vectors(message: Any) -> tuple[list[str], tuple[str, ...]] | None:
    """Return the paths of six or seven components of a vector kind, and their columns."""
    inside, prefix = message, ""
    while wrapped := [key for key in _WRAPPED if hasattr(inside, key)]:
        if len(wrapped) > 1 and wrapped != ["pose", "twist"]:
            return None
        inside, prefix = getattr(inside, wrapped[0]), _joined(prefix, wrapped[0])
    for first, second, names in _KINDS:
        pair = (first, second)
        if all(hasattr(getattr(inside, member, None), "x") for member in pair):
            axes = "xyzw"[: len(names) - 3]
            members = [f"{first}.{a}" for a in "xyz"] + [f"{second}.{a}" for a in axes]
            return [_joined(prefix, member) for member in members], names
    return None


def _member(path: str) -> Getter:
    get = attrgetter(path)
    return lambda message: np.ravel(get(message))


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name
