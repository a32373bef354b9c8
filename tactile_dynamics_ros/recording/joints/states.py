"""Serialised `sensor_msgs/JointState` as arrays, thousands at once, and back."""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.recording.cdr import ENCAPSULATION, LITTLE_ENDIAN, NANOSECONDS

JOINT_STATE = "sensor_msgs/msg/JointState"
_STAMP = ENCAPSULATION
"""Place of the stamp in a message, behind the encapsulation."""
_FRAME = _STAMP + 8
"""Place of the length of the frame's name."""

_LOOKED_AT = 50
"""Messages at the beginning in which one that can be read is looked for."""


@dataclass(frozen=True)
class StateLayout:
    """Where the numbers of equally long messages are.

    Attributes:
        names: of the joints.
        places: first byte and count of position, velocity and effort.
    """

    names: tuple[str, ...]
    places: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, raw: bytes) -> StateLayout | None:
        """Layout of a message; None if it cannot be read."""
        try:
            at = _FRAME + 4 + struct.unpack_from("<I", raw, _FRAME)[0]
            at = _aligned(at, 4)
            count, at = struct.unpack_from("<I", raw, at)[0], at + 4
            names = []
            for _ in range(count):
                at = _aligned(at, 4)
                size, at = struct.unpack_from("<I", raw, at)[0], at + 4
                names.append(raw[at : at + size].rstrip(b"\0").decode())
                at += size
            places = []
            for _ in range(3):
                at = _aligned(at, 4)
                count, at = struct.unpack_from("<I", raw, at)[0], at + 4
                at = _aligned(at, 8) if count else at
                places.append((at, count))
                at += 8 * count
        except (struct.error, UnicodeDecodeError):
            return None
        sound = at <= len(raw) and raw[1] == LITTLE_ENDIAN
        return cls(tuple(names), tuple(places)) if sound else None

    @property
    def is_whole(self) -> bool:
        """Whether every joint has a position and an effort."""
        count = len(self.names)
        return count > 0 and self.places[0][1] == count and self.places[2][1] == count


def _aligned(at: int, size: int) -> int:
    """Next place that is a multiple of a size behind the encapsulation."""
    return at + (-(at - ENCAPSULATION)) % size


@dataclass(frozen=True)
class States:
    """Joint states of one set of joints.

    Attributes:
        names: of the joints.
        time: (N,) s, header stamps, or of reception where there are none.
        position, effort: (N, n).
        problems: what was left out, with counts.
    """

    names: tuple[str, ...]
    time: Array
    position: Array
    effort: Array
    problems: Counter[str]


def decode_states(raw: Sequence[bytes], received: Sequence[int]) -> States | None:
    """Decode messages that have positions and efforts; None if there are none.

    Args:
        raw: serialised messages.
        received: ns, when each was received.
    """
    groups: dict[tuple[int, bytes], list[int]] = defaultdict(list)
    first = next((layout for layout in map(StateLayout.of, raw[:_LOOKED_AT]) if layout), None)
    if first is None:
        return None
    for k, data in enumerate(raw):
        groups[len(data), data[_FRAME : first.places[0][0]]].append(k)
    found: dict[tuple[str, ...], list[Array]] = defaultdict(list)
    left = 0
    for rows in groups.values():
        layout = StateLayout.of(raw[rows[0]])
        if layout is None or not layout.is_whole:
            left += len(rows)
            continue
        block = np.frombuffer(b"".join(raw[k] for k in rows), np.uint8).reshape(len(rows), -1)
        found[layout.names].append(_numbers(block, layout, np.array([received[k] for k in rows])))
    if not found:
        return None
    names = max(found, key=lambda key: (len(key), sum(map(len, found[key]))))
    table = np.concatenate(found[names])
    left += sum(len(part) for key, parts in found.items() if key != names for part in parts)
    problems = Counter(
        {"joint states without effort, or of other joints (left out)": left} if left else {}
    )
    return _sorted(names, table, problems)


def _numbers(block: NDArray[np.uint8], layout: StateLayout, received: NDArray[np.int64]) -> Array:
    """(N, 1 + 2 n) stamp in s, positions, efforts."""
    stamps = np.ascontiguousarray(block[:, _STAMP:_FRAME]).view("<u4").astype(np.int64)
    time = stamps[:, 0] * NANOSECONDS + stamps[:, 1]
    time = np.where(time > 0, time, received)
    parts = [
        np.ascontiguousarray(block[:, at : at + 8 * count]).view("<f8")
        for at, count in (layout.places[0], layout.places[2])
    ]
    return np.column_stack([time * 1e-9, *parts])


def _sorted(names: tuple[str, ...], table: Array, problems: Counter[str]) -> States:
    order = np.argsort(table[:, 0], kind="stable")
    table = table[order]
    new = np.append(True, np.diff(table[:, 0]) > 0.0)
    if not new.all():
        problems["joint states with the stamp of another (left out)"] += int(np.sum(~new))
    table = table[new]
    count = len(names)
    return States(names, table[:, 0], table[:, 1 : 1 + count], table[:, 1 + count :], problems)


def encode_states(
    names: Sequence[str], stamps: NDArray[np.int64], position: Array, effort: Array
) -> list[bytes]:
    """Serialise joint states.

    Args:
        names: of the joints.
        stamps: (N,) ns.
        position: (N, n).
        effort: (N, n).
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    types: Any = store.types
    empty = np.zeros(0)
    first = types[JOINT_STATE](
        header=types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id=""
        ),
        name=list(names),
        position=np.zeros(len(names)),
        velocity=empty,
        effort=np.zeros(len(names)),
    )
    pattern = bytes(store.serialize_cdr(first, JOINT_STATE))
    layout = StateLayout.of(pattern)
    assert layout is not None
    block = np.tile(np.frombuffer(pattern, np.uint8), (len(stamps), 1))
    parts = np.column_stack([stamps // NANOSECONDS, stamps % NANOSECONDS]).astype("<u4")
    block[:, _STAMP:_FRAME] = parts.view(np.uint8)
    for (at, count), values in zip(
        (layout.places[0], layout.places[2]), (position, effort), strict=True
    ):
        block[:, at : at + 8 * count] = np.ascontiguousarray(values, "<f8").view(np.uint8)
    return [row.tobytes() for row in block]
