"""Raw messages of recordings: rosbag2 directories, MCAP and SQLite files, bags of ROS 1."""

from __future__ import annotations

import re
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import apsw
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file
from tactile_dynamics_ros.recording.bag_limits import (
    ZSTD_ERROR,
    check_limits,
    metadata_of,
    salvage_messages,
)
from tactile_dynamics_ros.recording.cdr import (
    DOUBLES,
    UNSTAMPED_DOUBLES,
    MessageTable,
    decode_messages,
    join_tables,
)

STORAGE_SUFFIXES = (".mcap", ".db3")
ROS1_SUFFIX = ".bag"
BLOCK = 20_000
DAMAGE = (
    ReaderError,
    Ros1ReaderError,
    SerdeError,
    apsw.Error,
    ZSTD_ERROR,
    struct.error,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""Exceptions that the reader raises on damaged files: it trusts most bytes that it unpacks."""

RawMessage = tuple[str, str, int, bytes]
"""Topic, message type, receive time in nanoseconds, serialised message."""


@dataclass
class BagTables:
    """Decoded topics of one recording.

    Attributes:
        tables: messages of every wanted topic that has a known fixed-layout type.
        types: message type of every topic of the recording.
        problems: what was wrong with the files, and how often.
    """

    tables: dict[str, MessageTable] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    problems: Counter[str] = field(default_factory=Counter)


def read_tables(path: Path, wanted: Callable[[str], bool]) -> BagTables:
    """Read and decode the wanted topics of a rosbag2 recording.

    Args:
        path: the recording's directory, or an .mcap or .db3 file.
        wanted: tells whether a topic is needed.

    Raises:
        BadInputError: there is no recording at the path, or nothing in it can be read.
    """
    bag = BagTables()
    for part in storage_parts(path):
        try:
            found = _decode(_regular_messages(part, bag.types, wanted))
        except DAMAGE as error:
            found = _decode(_salvaged_messages(part, bag.types, wanted))
            rows = sum(len(table) for table in found.values())
            bag.problems[f"{part.name}: damaged ({one_line(error)}); messages salvaged"] += rows
        for topic, table in found.items():
            known = bag.tables.get(topic)
            bag.tables[topic] = table if known is None else join_tables([known, table])
    if not bag.types:
        raise BadInputError(
            f"{path}: no message could be read; expected a rosbag2 recording (MCAP or SQLite) "
            "that was closed properly or holds at least one complete chunk"
        )
    return bag


def recorded_types(path: Path) -> dict[str, str]:
    """Message type of every topic of a recording; of a damaged one, as far as it can be read.

    Raises:
        BadInputError: there is no recording at the path.
    """
    return read_tables(path, lambda topic: False).types


def read_messages(path: Path, topic: str) -> Iterator[RawMessage]:
    """Yield the serialised messages of one topic; of a damaged recording those that can be read.

    Raises:
        BadInputError: there is no recording at the path.
    """
    for part in storage_parts(path):
        count = 0
        try:
            for message in _regular_messages(part, {}, lambda name: name == topic):
                yield message
                count += 1
        except DAMAGE:
            saved = _salvaged_messages(part, {}, lambda name: name == topic)
            yield from islice(saved, count, None)


def storage_parts(path: Path) -> list[Path]:
    """Return what to open: the directory if it is complete, otherwise its storage files.

    Raises:
        BadInputError: there is no recording at the path, or it exceeds a limit.
    """
    if not path.exists():
        raise BadInputError(
            f"{path}: no such file or directory; expected a rosbag2 recording" + nearest_file(path)
        )
    check_limits(path)
    if path.is_dir():
        if _opens(path):
            return [path]
        files = _storage_files(path)
        if not files:
            raise BadInputError(f"{path}: holds no .mcap, .db3 or .bag; expected a recording")
        return files
    if path.suffix not in (*STORAGE_SUFFIXES, ROS1_SUFFIX):
        raise BadInputError(
            f"{path}: unknown kind of file; expected a rosbag2 directory, .mcap or .db3, or a .bag "
            "of ROS 1 (see `tactile-dynamics import` for CSV)"
        )
    return [path]


def _digits_as_numbers(file: Path) -> list[Any]:
    """Return a key that sorts run_2 before run_10, as recorders number the parts."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)]


def _storage_files(path: Path) -> list[Path]:
    """Return the storage files of a directory in order, or the file itself."""
    if path.is_dir():
        suffixes = (*STORAGE_SUFFIXES, ROS1_SUFFIX)
        files = [f for f in path.iterdir() if f.suffix in suffixes]
        return sorted(files, key=_digits_as_numbers)
    return [path]


def _opens(directory: Path) -> bool:
    """Return whether a recording's directory and all files named in it can be opened."""
    try:
        metadata_of(directory)
        with Reader(directory):
            return True
    except (BadInputError, *DAMAGE):
        return False


def _regular_messages(
    part: Path, types: dict[str, str], wanted: Callable[[str], bool]
) -> Iterator[RawMessage]:
    """Yield the wanted messages of an intact recording."""
    if part.suffix == ROS1_SUFFIX:
        yield from _ros1_messages(part, types, wanted)
        return
    with Reader(part) as reader:
        named = named_connections(reader)
        types.update({c.topic: c.msgtype for c in named})
        connections = [c for c in named if wanted(c.topic)]
        if connections:
            for connection, received, data in reader.messages(connections=connections):
                if not isinstance(data, bytes | memoryview):  # a number in a damaged database
                    raise TypeError(f"{connection.topic}: a message is no bytes")
                yield connection.topic, connection.msgtype, received, bytes(data)


def named_connections(reader: Any) -> list[Any]:
    """Return the topics of a reader whose names and types are text; a damaged one has others."""
    return [
        c for c in reader.connections if isinstance(c.topic, str) and isinstance(c.msgtype, str)
    ]


def _ros1_messages(
    file: Path, types: dict[str, str], wanted: Callable[[str], bool]
) -> Iterator[RawMessage]:
    """Yield the wanted messages of a bag of ROS 1, serialised as ROS 2 does.

    Those of types that ROS 2 does not bring are left out.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    with Ros1Reader(file) as reader:
        types.update({c.topic: c.msgtype for c in reader.connections})
        known = [c for c in reader.connections if wanted(c.topic) and c.msgtype in store.types]
        if known:
            for connection, received, data in reader.messages(connections=known):
                message = store.ros1_to_cdr(data, connection.msgtype)
                yield connection.topic, connection.msgtype, received, bytes(message)


def _salvaged_messages(
    part: Path, types: dict[str, str], wanted: Callable[[str], bool]
) -> Iterator[RawMessage]:
    """Yield the wanted messages of a damaged recording as far as each of its files goes."""
    for file in _storage_files(part):
        if file.suffix == ROS1_SUFFIX:
            raise BadInputError(f"{file}: damaged or not indexed; run `rosbag reindex {file.name}`")
        yield from salvage_messages(file, types, wanted)


def _decode(messages: Iterator[RawMessage]) -> dict[str, MessageTable]:
    """Decode a stream of messages block by block, so that few serialised ones are held."""
    tables: dict[tuple[str, str], list[MessageTable]] = defaultdict(list)
    blocks: dict[tuple[str, str], tuple[list[bytes], list[int]]] = {}
    for topic, msgtype, received, data in messages:
        if msgtype not in DOUBLES and msgtype not in UNSTAMPED_DOUBLES:
            continue
        key = (topic, msgtype)
        raw, times = blocks.setdefault(key, ([], []))
        raw.append(data)
        times.append(received)
        if len(raw) >= BLOCK:
            tables[key].append(decode_messages(msgtype, *blocks.pop(key)))
    for key, block in blocks.items():
        tables[key].append(decode_messages(key[1], *block))
    return {topic: join_tables(parts) for (topic, _), parts in tables.items()}


def one_line(error: Exception) -> str:
    """Return the first line of an error's text, or its kind where it has none."""
    text = str(error).strip().splitlines()
    return text[0] if text else type(error).__name__
