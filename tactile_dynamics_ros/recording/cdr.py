"""Fixed-layout ROS messages as numpy tables: mostly a header and a constant number of doubles.

A message of such a type is an encapsulation of 4 bytes, a ``std_msgs/Header`` (stamp, frame id)
and then doubles aligned to 8 bytes, so that thousands of equally long messages are one array.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array

DOUBLES = {
    "geometry_msgs/msg/PoseStamped": 7,
    "geometry_msgs/msg/PoseWithCovarianceStamped": 43,
    "geometry_msgs/msg/Vector3Stamped": 3,
    "geometry_msgs/msg/WrenchStamped": 6,
    "sensor_msgs/msg/Imu": 37,
}
UNSTAMPED_DOUBLES = {
    "geometry_msgs/msg/Pose": 7,
    "geometry_msgs/msg/Twist": 6,
    "geometry_msgs/msg/Wrench": 6,
}
"""Doubles of types without a header; some drivers of force sensors publish wrenches as twists."""
ENCAPSULATION = 4
LITTLE_ENDIAN = 1
STAMP_AND_LENGTH = 12
NANOSECONDS = 1_000_000_000

BIOTAC_RAW, BIOTAC_ENCODING = "/biotac/raw", "16UC1"
"""Topic and encoding of the images of raw counts of all fingertips."""


@dataclass(frozen=True)
class MessageTable:
    """Messages of one topic, one row each, in the order in which they were received.

    Attributes:
        stamp_ns: (N,) header stamp, int64 nanoseconds.
        receive_ns: (N,) time at which the recorder received the message, int64 nanoseconds.
        frame_id: (N,) header frame, bytes.
        values: (N, K) the doubles in message order.
        malformed: number of messages that could not be decoded.
    """

    stamp_ns: NDArray[np.int64]
    receive_ns: NDArray[np.int64]
    frame_id: NDArray[np.bytes_]
    values: Array
    malformed: int = 0

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.stamp_ns)

    def as_received(self) -> MessageTable:
        """Return the messages with their receive times as stamps."""
        return replace(self, stamp_ns=self.receive_ns)


def decode_messages(msgtype: str, raw: Sequence[bytes], receive_ns: Sequence[int]) -> MessageTable:
    """Decode serialised messages of one fixed-layout type.

    Args:
        msgtype: one of ``DOUBLES`` or ``UNSTAMPED_DOUBLES``; the latter have stamps of zero.
        raw: N CDR byte strings.
        receive_ns: N receive times in nanoseconds.
    """
    if msgtype in UNSTAMPED_DOUBLES:
        return _decode_unstamped(UNSTAMPED_DOUBLES[msgtype], raw, receive_ns)
    groups: dict[tuple[int, bytes, bytes], list[int]] = defaultdict(list)
    for index, data in enumerate(raw):
        groups[len(data), data[:ENCAPSULATION], data[12:16]].append(index)
    order, tables, malformed = [], [], 0
    for (size, encapsulation, length_field), members in groups.items():
        layout = _layout(msgtype, size, encapsulation, length_field)
        if layout is None:
            malformed += len(members)
            continue
        joined = b"".join([raw[i] for i in members])
        tables.append(np.frombuffer(joined, dtype=layout))
        order.extend(members)
    return _assemble(DOUBLES[msgtype], order, tables, receive_ns, malformed)


def _decode_unstamped(
    doubles: int, raw: Sequence[bytes], receive_ns: Sequence[int]
) -> MessageTable:
    """Decode messages that are nothing but doubles."""
    size = ENCAPSULATION + 8 * doubles
    good = [k for k, data in enumerate(raw) if size <= len(data) < size + 8 and data[1] <= 1]
    values = np.array(
        [
            np.frombuffer(raw[k], "<f8" if raw[k][1] == LITTLE_ENDIAN else ">f8", doubles, 4)
            for k in good
        ],
        dtype=np.float64,
    ).reshape(-1, doubles)
    received = np.asarray(receive_ns, dtype=np.int64)[good]
    none = np.zeros(len(good), dtype=np.int64)
    return MessageTable(none, received, np.full(len(good), b""), values, len(raw) - len(good))


def _layout(
    msgtype: str, size: int, encapsulation: bytes, length_field: bytes
) -> np.dtype[np.void] | None:
    """Return the dtype of one message, or None if its bytes cannot be of this type."""
    if size < ENCAPSULATION + STAMP_AND_LENGTH or encapsulation[0] != 0 or encapsulation[1] > 1:
        return None
    order = "<" if encapsulation[1] == LITTLE_ENDIAN else ">"
    length = int(np.frombuffer(length_field, dtype=order + "u4")[0])
    if length > size:
        return None
    layout = message_layout(length, DOUBLES[msgtype], order)
    spare = size - layout.itemsize
    if not 0 <= spare < 8:
        return None
    return np.dtype([("message", layout), ("spare", f"V{spare}")]) if spare else layout


@lru_cache
def message_layout(frame_length: int, doubles: int, order: str = "<") -> np.dtype[np.void]:
    """Return the dtype of a serialised message: header with a frame id, then doubles.

    Args:
        frame_length: bytes of the frame id including its terminating zero.
        doubles: number of doubles that follow the header.
        order: "<" for little-endian CDR, ">" for big-endian.
    """
    header = STAMP_AND_LENGTH + frame_length
    start = ENCAPSULATION + header + (-header) % 8
    frame_type = f"S{frame_length}" if frame_length else "V0"
    return np.dtype(
        {
            "names": ["encapsulation", "sec", "nanosec", "length", "frame", "values"],
            "formats": [
                "4u1",
                order + "i4",
                order + "u4",
                order + "u4",
                frame_type,
                (order + "f8", (doubles,)),
            ],
            "offsets": [0, 4, 8, 12, 16, start],
            "itemsize": start + 8 * doubles,
        }
    )


def _assemble(
    doubles: int,
    order: list[int],
    tables: list[NDArray[np.void]],
    receive_ns: Sequence[int],
    malformed: int,
) -> MessageTable:
    """Put the groups of equally long messages back into the order of reception."""
    plain = [t["message"] if "message" in (t.dtype.names or ()) else t for t in tables]
    if not plain:
        return empty_table(doubles, malformed)
    ranks = np.argsort(order, kind="stable")
    stamps = [t["sec"].astype(np.int64) * NANOSECONDS + t["nanosec"] for t in plain]
    frames = [_frames(t) for t in plain]
    received = np.asarray(receive_ns, dtype=np.int64)[np.asarray(order)]
    return MessageTable(
        stamp_ns=np.concatenate(stamps)[ranks],
        receive_ns=received[ranks],
        frame_id=np.concatenate(frames)[ranks],
        values=np.concatenate([t["values"].astype(np.float64) for t in plain])[ranks],
        malformed=malformed,
    )


def _frames(table: NDArray[np.void]) -> NDArray[np.bytes_]:
    """Return the frame ids of a group; an id of zero length is the empty string."""
    if table.dtype["frame"].itemsize == 0:
        return np.full(len(table), b"")
    return np.array(table["frame"])


def empty_table(doubles: int, malformed: int = 0) -> MessageTable:
    """Return a table without messages."""
    none = np.zeros(0, dtype=np.int64)
    return MessageTable(none, none, np.zeros(0, "S1"), np.zeros((0, doubles)), malformed)


def join_tables(tables: Sequence[MessageTable]) -> MessageTable:
    """Join consecutive tables of one topic."""
    return MessageTable(
        np.concatenate([t.stamp_ns for t in tables]),
        np.concatenate([t.receive_ns for t in tables]),
        np.concatenate([t.frame_id for t in tables]),
        np.concatenate([t.values for t in tables]),
        sum(t.malformed for t in tables),
    )


def encode_messages(
    msgtype: str, stamp_ns: NDArray[np.int64], frame_id: str, values: Array
) -> list[bytes]:
    """Serialise N messages of one fixed-layout type to little-endian CDR.

    Args:
        msgtype: one of ``DOUBLES``.
        stamp_ns: (N,) header stamps in nanoseconds.
        frame_id: frame of every message.
        values: (N, K) the doubles in message order.
    """
    frame = frame_id.encode() + b"\0"
    layout = message_layout(len(frame), DOUBLES[msgtype])
    table = np.zeros(len(stamp_ns), dtype=layout)
    table["encapsulation"] = (0, LITTLE_ENDIAN, 0, 0)
    table["sec"], table["nanosec"] = np.divmod(stamp_ns, NANOSECONDS)
    table["length"] = len(frame)
    table["frame"] = frame
    table["values"] = values
    data, size = table.tobytes(), layout.itemsize
    return [data[i : i + size] for i in range(0, len(data), size)]
