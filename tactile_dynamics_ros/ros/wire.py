"""The messages that come by the hundred per second, read from and written to their CDR bytes.

rclpy makes a tree of Python objects of each message and checks every field of it, which costs
several times what the estimation with it costs. A subscription may take the serialised message
instead, and a publisher may be given one: a header and then doubles, see `recording.cdr`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from numpy.typing import NDArray
from sensor_msgs.msg import Image, JointState

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.recording.cdr import DOUBLES, ENCAPSULATION, LITTLE_ENDIAN, NANOSECONDS

Decoder = Callable[[bytes], Any]

STAMPED = ENCAPSULATION + 8
"""Where the stamp ends."""
FRAME = STAMPED + 4
"""Where the text of the frame id begins, behind its length."""
DOUBLE = {order: np.dtype(f"{order}f8") for order in "<>"}
HEADER = {order: struct.Struct(f"{order}iII") for order in "<>"}
"""Stamp and length of the frame id."""
STAMP = struct.Struct("<iI")
LITTLE = bytes((0, LITTLE_ENDIAN, 0, 0))


class AnyStamp(Protocol):
    """A stamp: `builtin_interfaces/Time` or `Stamp`."""

    @property
    def sec(self) -> int:
        """Whole seconds."""

    @property
    def nanosec(self) -> int:
        """Nanoseconds beyond them."""


class Stamp(NamedTuple):
    """The stamp of a header."""

    sec: int
    nanosec: int


class Stamped(NamedTuple):
    """A message of a header and doubles: PoseStamped, Vector3Stamped, WrenchStamped and so on.

    Attributes:
        stamp: stamp of the header. frame_id: frame of the header. values: (K,) in the order of
            the message.
    """

    stamp: Stamp
    frame_id: str
    values: Array


_NOTHING = np.zeros(0)
"""Efforts of a joint state that has none."""


class Joints(NamedTuple):
    """Part of a JointState that is used: stamp, names, positions (rad) and efforts (N m)."""

    stamp: Stamp
    names: tuple[str, ...]
    positions: Array
    efforts: Array = _NOTHING


class Picture(NamedTuple):
    """An Image, with the fields of the message; its data are the bytes of the rows."""

    stamp: Stamp
    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: bytes


def to_stamp(seconds: float) -> Stamp:
    """Return the stamp of a time in seconds."""
    return Stamp(*divmod(round(seconds * 1e9), NANOSECONDS))


def decoder_of(kind: type[Any]) -> Decoder | None:
    """Return what reads the bytes of a type's messages, None if rclpy has to."""
    if kind is JointState:
        return JointStateDecoder()
    if kind is Image:
        return decode_image
    count = COUNTS.get(kind)
    return None if count is None else lambda data: decode_stamped(data, count)


def decode_stamped(data: bytes, count: int) -> Stamped:
    """Return header and the `count` doubles of a serialised message."""
    order, stamp, end = _read_header(data)
    values = np.frombuffer(data, DOUBLE[order], count, _aligned(end))
    return Stamped(stamp, _text(data[FRAME:end]), values)


def encode_stamped(stamp: AnyStamp, frame_id: str, values: Array) -> bytes:
    """Return the serialised message of a header and doubles (K,)."""
    return _begin(stamp) + _frame(frame_id, 8) + values.astype(DOUBLE["<"], copy=False).tobytes()


def encode_clock(stamp: AnyStamp) -> bytes:
    """Return the serialised Clock of a stamp."""
    return _begin(stamp)


def decode_image(data: bytes) -> Picture:
    """Return a serialised Image."""
    order, stamp, end = _read_header(data)
    at = _aligned(end, 4)
    height, width, length = struct.unpack_from(order + "III", data, at)
    end = at + 12 + length
    at = _aligned(end + 1, 4)
    step, size = struct.unpack_from(order + "II", data, at)
    encoding = _text(data[end - length : end])
    rows = data[at + 8 : at + 8 + size]
    return Picture(stamp, height, width, encoding, data[end], step, rows)


def encode_image(stamp: AnyStamp, frame_id: str, encoding: str, values: NDArray[Any]) -> bytes:
    """Return the serialised Image of values (H, W), whose bytes are little-endian."""
    height, width = values.shape
    head = _begin(stamp) + _frame(frame_id, 4) + struct.pack("<II", height, width)
    head = _padded(head + _string(encoding) + b"\0", 4)
    return head + struct.pack("<II", width * values.itemsize, values.nbytes) + values.tobytes()


class JointStateDecoder:
    """Reads joint states; the names, which seldom change, are read once."""

    def __init__(self) -> None:
        self._same, self._names, self._start = b"\0", (), 0

    def __call__(self, data: bytes) -> Joints:
        """Return stamp, names, positions and efforts of a serialised JointState."""
        order, stamp, end = _read_header(data)
        if not data.startswith(self._same, STAMPED):
            self._learn(data, order, end)
        positions, end = _doubles(data, order, self._start - 4)
        _, end = _doubles(data, order, end)
        efforts, _ = _doubles(data, order, end)
        return Joints(stamp, self._names, positions, efforts)

    def _learn(self, data: bytes, order: str, end: int) -> None:
        """Read the names behind the frame id, and remember the bytes of both."""
        at = _aligned(end, 4)
        (count,) = struct.unpack_from(order + "I", data, at)
        at += 4
        names = []
        for _ in range(count):
            at = _aligned(at, 4)
            (length,) = struct.unpack_from(order + "I", data, at)
            names.append(_text(data[at + 4 : at + 4 + length]))
            at += 4 + length
        self._start = _aligned(at, 4) + 4
        self._same, self._names = data[STAMPED:at], tuple(names)


def encode_joint_state(
    names: Sequence[str],
    stamp: AnyStamp,
    position: Array,
    velocity: Array | None = None,
    effort: Array | None = None,
) -> bytes:
    """Return the serialised JointState, with an empty frame id."""
    message = _begin(stamp) + _joint_names(tuple(names))
    for values in (position, velocity, effort):
        message += struct.pack("<I", 0 if values is None else len(values))
        if values is not None and len(values):
            message = _padded(message, 8) + np.asarray(values, dtype="<f8").tobytes()
    return message


COUNTS: dict[type[Any], int] = {
    kind: DOUBLES[f"geometry_msgs/msg/{kind.__name__}"]
    for kind in (PoseStamped, PoseWithCovarianceStamped, Vector3Stamped, WrenchStamped)
}


def _read_header(data: bytes) -> tuple[str, Stamp, int]:
    """Return the byte order, the stamp, and where the frame id ends."""
    order = "<" if data[1] == LITTLE_ENDIAN else ">"
    sec, nanosec, length = HEADER[order].unpack_from(data, ENCAPSULATION)
    return order, Stamp(sec, nanosec), FRAME + length


def _doubles(data: bytes, order: str, at: int) -> tuple[Array, int]:
    """Return doubles behind their count, and the place of the count that follows them."""
    (count,) = struct.unpack_from(order + "I", data, at)
    start = _aligned(at + 4) if count else at + 4
    return np.frombuffer(data, order + "f8", count, start), start + 8 * count


def _begin(stamp: AnyStamp) -> bytes:
    """Return encapsulation and stamp."""
    return LITTLE + STAMP.pack(stamp.sec, stamp.nanosec)


def _aligned(offset: int, size: int = 8) -> int:
    """Return the next place that is aligned, counted from behind the encapsulation."""
    return offset + (ENCAPSULATION - offset) % size


def _padded(message: bytes, size: int) -> bytes:
    """Return a message, or what precedes the next field, padded to its alignment."""
    return message + bytes(_aligned(len(message), size) - len(message))


@lru_cache
def _text(data: bytes) -> str:
    return data.rstrip(b"\0").decode()


def _string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


@lru_cache
def _frame(frame_id: str, size: int) -> bytes:
    """Return a frame id behind the stamp, padded for a field of `size` bytes."""
    return _padded(bytes(STAMPED) + _string(frame_id), size)[STAMPED:]


@lru_cache
def _joint_names(names: tuple[str, ...]) -> bytes:
    """Return an empty frame id and names behind the stamp, padded for the length that follows."""
    message = bytes(STAMPED) + _frame("", 4) + struct.pack("<I", len(names))
    for name in names:
        message = _padded(message, 4) + _string(name)
    return _padded(message, 4)[STAMPED:]
