"""Limits of recordings: regular files, tables of rows, blocks that expand to what can be held."""

from __future__ import annotations

import bz2
import mmap
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_yaml, require_file
from tactile_dynamics_ros.recording.salvage import (
    CHUNK,
    CHUNK_HEADER,
    MAGIC,
    RECORD_HEADER,
    ZSTD_ERROR,
    zstd,
)

METADATA = "metadata.yaml"
LARGEST_BLOCK = 128 << 20
"""Bytes to which one compressed block may expand. Writers close a block after 1 to 4 MB, or after
the message that exceeds that; the largest messages, images and clouds, have 50 MB."""
FREE = 8 << 20
"""Bytes to which any recording may expand: read in 10 s even if they are records of 9 bytes."""
MOST_EXPANSION = 200
"""Bytes for each byte of the file to which a recording may expand beyond `FREE`. Streams of a robot
shrink to a third, those of one that stands still to a thirtieth, clouds and images less."""

_OPENERS: dict[str, Callable[[BytesIO], Any]] = {
    "zstd": zstd.open,
    "lz4": lz4.frame.open,
    "bz2": bz2.open,
}
_PIECE = 1 << 20
"""Bytes that are expanded at a time; they are counted and forgotten."""
_DAMAGE = (ZSTD_ERROR, OSError, EOFError, RuntimeError, ValueError)
"""What the decompressors raise where a block is damaged; the reader meets the same."""
_ROS1_CHUNK = b"op=\x05"
"""Field in the header of a block of compressed messages in bags of ROS 1."""


def check_limits(path: Path) -> None:
    """Refuse a recording that would fill the memory or never end.

    Args:
        path: an existing directory or file of a recording.

    Raises:
        BadInputError: a pipe or device stands for a file, a table is none, or a file expands beyond
            what its size allows; says which.
    """
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        if not file.is_dir():
            about = require_file(file, "a file of a recording").stat()
            _check_file(file, about.st_mtime_ns, about.st_size)


def check_readable(path: Path) -> None:
    """Refuse also a directory without readable metadata, for readers that salvage nothing.

    Raises:
        BadInputError: see `check_limits` and `metadata_of`.
    """
    check_limits(path)
    if path.is_dir():
        metadata_of(path)


def metadata_of(directory: Path) -> dict[str, Any]:
    """Return what a directory says of its recording.

    Raises:
        BadInputError: there is no such file, or it is no yaml.
    """
    found = read_yaml(directory / METADATA, "the metadata of a recording")
    inside = found.get("rosbag2_bagfile_information") if isinstance(found, dict) else None
    return inside if isinstance(inside, dict) else {}


@lru_cache(maxsize=256)
def _check_file(file: Path, changed: int, size: int) -> None:
    """Check one file; once for each of its states, since topics are read one after the other.

    Args:
        file: of a recording.
        changed: when it was written, ns.
        size: of it, bytes.
    """
    del changed
    if size == 0:
        return
    if file.suffix == ".db3":
        blocks = _database_blocks(file)
    elif file.suffix == ".mcap":
        blocks = _mcap_blocks(file)
    elif file.suffix == ".bag":
        blocks = _ros1_blocks(file)
    elif file.suffix == ".zstd":
        blocks = iter([("zstd", file.read_bytes())])
    else:
        return
    _count(file, blocks, FREE + MOST_EXPANSION * size)


def _count(file: Path, blocks: Iterator[tuple[str, bytes]], allowed: int) -> None:
    total = 0
    for kind, content in blocks:
        if kind not in _OPENERS:
            continue
        block = 0
        with suppress(*_DAMAGE), _OPENERS[kind](BytesIO(content)) as stream:
            while piece := stream.read(_PIECE):
                block += len(piece)
                if block > LARGEST_BLOCK or total + block > allowed:
                    break
        total += block
        if file.suffix != ".zstd" and block > LARGEST_BLOCK:
            raise BadInputError(
                f"{file}: a block of {len(content)} bytes expands to more than "
                f"{LARGEST_BLOCK >> 20} MB; no message is so large"
            )
        if total > allowed:
            raise BadInputError(
                f"{file}: expands to more than {allowed >> 20} MB, {MOST_EXPANSION} times its size "
                "and more; if it is a recording, write it anew without compression"
            )


def _mcap_blocks(file: Path) -> Iterator[tuple[str, bytes]]:
    """Yield compression and content of the chunks of an MCAP file."""
    with _mapped(file) as data:
        position = len(MAGIC)
        while position + RECORD_HEADER.size <= len(data):
            opcode, length = RECORD_HEADER.unpack_from(data, position)
            position += RECORD_HEADER.size
            if opcode == CHUNK:
                body = data[position : position + length]
                start = CHUNK_HEADER.size + 4
                name = int.from_bytes(body[CHUNK_HEADER.size : start], "little")
                kind = body[start : start + name].decode("ascii", "replace")
                yield kind, body[start + name + 8 :]
            position += length


def _ros1_blocks(file: Path) -> Iterator[tuple[str, bytes]]:
    """Yield compression and content of the chunks of a bag of ROS 1."""
    with _mapped(file) as data:
        position = data.find(b"\n") + 1
        while position + 8 <= len(data):
            (size,) = struct.unpack_from("<I", data, position)
            header = data[position + 4 : position + 4 + size]
            position += 4 + size
            length = int.from_bytes(data[position : position + 4], "little")
            if _ROS1_CHUNK in header:
                kind = next((k for k in _OPENERS if b"compression=" + k.encode() in header), "")
                yield kind, data[position + 4 : position + 4 + length]
            position += 4 + length


def _database_blocks(file: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the messages of an SQLite file whose directory says that each is compressed.

    Raises:
        BadInputError: what should be a table of rows is computed, perhaps without end.
    """
    with closing(sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True)) as database:
        try:
            kinds = database.execute("SELECT type, name FROM sqlite_master").fetchall()
            computed = [name for kind, name in kinds if kind == "view"]
            if computed:
                raise BadInputError(f"{file}: '{computed[0]}' is a view, expected tables of rows")
            if _compresses_messages(file.parent):
                for (content,) in database.execute("SELECT data FROM messages"):
                    yield "zstd", bytes(content)
        except (sqlite3.Error, TypeError, UnicodeDecodeError):  # the reader salvages it
            return


def _compresses_messages(directory: Path) -> bool:
    try:
        mode = metadata_of(directory).get("compression_mode")
    except BadInputError:
        return False
    return str(mode).lower() == "message"


def _mapped(file: Path) -> mmap.mmap:
    with file.open("rb") as stream:
        return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
