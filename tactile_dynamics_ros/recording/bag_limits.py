"""Limits of recordings, and what of those that were cut off can be read."""

from __future__ import annotations

import bz2
import mmap
import sqlite3
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_yaml, require_file

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZSTD_ERROR = zstd.ZstdError
MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x03, 0x04, 0x05, 0x06
RECORD_HEADER = struct.Struct("<BQ")
MESSAGE_HEADER = struct.Struct("<HIQQ")
CHUNK_HEADER = struct.Struct("<QQQI")

_LATEST = 2**63 - 1
"""Latest time that 64 bits with a sign hold, ns: in the year 2262; later ones are damaged."""

Wanted = Callable[[str], bool]


def salvage_messages(
    file: Path, types: dict[str, str], wanted: Wanted
) -> Iterator[tuple[str, str, int, bytes]]:
    """Yield the wanted messages of a damaged .mcap or .db3 file up to where it breaks off.

    Args:
        file: the storage file.
        types: is filled with the message type of every topic met.
        wanted: tells whether a topic is needed.
    """
    if file.suffix == ".db3":
        yield from _salvage_sqlite(file, types, wanted)
    elif file.suffix == ".mcap":
        data = memoryview(file.read_bytes())
        if bytes(data[: len(MAGIC)]) == MAGIC:
            yield from _McapScan(types, wanted).messages(data[len(MAGIC) :])


class _McapScan:
    """Walks the records of an MCAP file in file order."""

    def __init__(self, types: dict[str, str], wanted: Wanted) -> None:
        self._types = types
        self._wanted = wanted
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def messages(
        self, data: memoryview, inside: bool = False
    ) -> Iterator[tuple[str, str, int, bytes]]:
        """Yield the wanted messages of a run of records, entering chunks.

        Args:
            data: the records.
            inside: of a chunk, in which there is no other one.
        """
        for opcode, body, complete in _records(data):
            if opcode == CHUNK and not inside:
                yield from self.messages(memoryview(_chunk_content(body)), inside=True)
            elif not complete:
                return
            elif opcode == SCHEMA:
                name, _ = _string(body, 2)
                self._schemas[_uint16(body)] = name
            elif opcode == CHANNEL:
                self._add_channel(body)
            elif opcode == MESSAGE and len(body) >= MESSAGE_HEADER.size:
                channel, _, log_time, _ = MESSAGE_HEADER.unpack_from(body)
                topic, msgtype = self._channels.get(channel, ("", ""))
                if topic and self._wanted(topic) and log_time <= _LATEST:
                    yield topic, msgtype, log_time, bytes(body[MESSAGE_HEADER.size :])

    def _add_channel(self, body: memoryview) -> None:
        """Remember the topic and type of a channel record."""
        topic, _ = _string(body, 4)
        msgtype = self._schemas.get(_uint16(body[2:]), "")
        self._channels[_uint16(body)] = (topic, msgtype)
        self._types[topic] = msgtype


def _records(data: memoryview) -> Iterator[tuple[int, memoryview, bool]]:
    """Yield opcode, content and completeness of consecutive records until the bytes end."""
    position = 0
    while position + RECORD_HEADER.size <= len(data):
        opcode, length = RECORD_HEADER.unpack_from(data, position)
        position += RECORD_HEADER.size
        yield opcode, data[position : position + length], position + length <= len(data)
        position += length


def _chunk_content(body: memoryview) -> bytes:
    """Return the records of a chunk, as many of them as its bytes still hold."""
    if len(body) < CHUNK_HEADER.size + 4:
        return b""
    compression, start = _string(body, CHUNK_HEADER.size)
    content = body[start + 8 :]
    decompressors: dict[str, Any] = {"zstd": zstd.ZstdDecompressor, "lz4": LZ4FrameDecompressor}
    if compression not in decompressors:
        return bytes(content) if compression == "" else b""
    try:
        return bytes(decompressors[compression]().decompress(bytes(content)))
    except (ZSTD_ERROR, RuntimeError, EOFError):
        return b""


def _uint16(data: memoryview) -> int:
    """Return a little-endian unsigned 16-bit number."""
    return int.from_bytes(data[:2], "little")


def _string(data: memoryview, offset: int) -> tuple[str, int]:
    """Return a length-prefixed string and the offset behind it."""
    length = int.from_bytes(data[offset : offset + 4], "little")
    end = offset + 4 + length
    return bytes(data[offset + 4 : end]).decode("utf-8", "replace"), end


def _salvage_sqlite(
    file: Path, types: dict[str, str], wanted: Wanted
) -> Iterator[tuple[str, str, int, bytes]]:
    """Yield the rows of a rosbag2 SQLite file until the first one that cannot be read."""
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch) / "copy.db3"
        copy.write_bytes(_with_actual_page_count(file.read_bytes()))
        connection = sqlite3.connect(copy)
        try:
            rows = connection.execute("SELECT id, name, type FROM topics").fetchall()
            topics = {
                key: (name, msgtype)
                for key, name, msgtype in rows
                if isinstance(name, str) and isinstance(msgtype, str)
            }
            types.update(dict(topics.values()))
            query = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
            for key, received, data in connection.execute(query):
                name, msgtype = topics.get(key, ("", ""))
                sound = isinstance(received, int) and isinstance(data, bytes)
                if name and wanted(name) and sound:
                    yield name, msgtype, received, data
        except (sqlite3.DatabaseError, UnicodeDecodeError):  # of a name, or of the error's text
            return
        finally:
            connection.close()


def _with_actual_page_count(data: bytes) -> bytes:
    """Return a database cut at a page and its header's page count set to what is there.

    SQLite refuses to open a file that is shorter than its header says.
    """
    page = int.from_bytes(data[16:18], "big")
    if len(data) < 100 or page < 512:
        return data
    pages = len(data) // page
    return data[:28] + pages.to_bytes(4, "big") + data[32 : pages * page]


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
