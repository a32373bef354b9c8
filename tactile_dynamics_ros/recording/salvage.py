"""Messages of recordings that were cut off: a sequential scan that stops where the bytes end."""

from __future__ import annotations

import sqlite3
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

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
