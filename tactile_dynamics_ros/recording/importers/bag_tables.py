"""Topics of a recording as tables of numbers, whatever their types."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.bag_files import ROS1_SUFFIX, STORAGE_SUFFIXES
from tactile_dynamics_ros.recording.importers.bag_reader import BagReader
from tactile_dynamics_ros.recording.importers.message_columns import (
    Getter,
    columns_of,
    joints_of,
    member_of,
)
from tactile_dynamics_ros.recording.importers.tables import Table
from tactile_dynamics_ros.recording.topics import NO_STAMPS, RECEIVE

_STATES = 20
"""Joint states among which that of an arm is, where a gripper publishes at up to ten times its
rate."""


def is_bag(path: Path) -> bool:
    """Whether a path is that of a recording instead of a text table."""
    return path.is_dir() or path.suffix in (*STORAGE_SUFFIXES, ROS1_SUFFIX)


def topic_types(path: Path) -> dict[str, str]:
    """Return the message type of every topic.

    Raises:
        BadInputError: the recording cannot be read.
    """
    with BagReader(path) as reader:
        return reader.types


def first_messages(path: Path) -> dict[str, Any]:
    """Return the first message of every topic whose type is known and that can be read.

    Of joint states it is that of the most joints: an arm and its gripper may share a topic.

    Raises:
        BadInputError: the recording cannot be read.
    """
    found = {}
    with BagReader(path) as reader:
        for topic in reader.types:
            with suppress(BadInputError):
                count = _STATES if reader.types[topic].endswith("JointState") else 1
                first = [message for _, message in islice(reader.messages(topic), count)]
                found |= {topic: max(first, key=lambda one: len(joints_of(one)))} if first else {}
    return found


def read_topic(path: Path, topic: str, field: str = "", stamps: str = "header") -> Table:
    """Return the numbers of one topic as a table with its stamps in s.

    Args:
        path: of the recording.
        topic: of any type whose definition is known.
        field: path of the part of the messages that is meant, as `o_t_ee`; "" for all.
        stamps: "header", or "receive" for the times at which messages were received.

    Raises:
        BadInputError: the topic or the field is not there, or holds no numbers.
    """
    if stamps not in ("header", RECEIVE):
        raise BadInputError(f"{topic}: stamps '{stamps}'; expected header or {RECEIVE}")
    kinds: dict[tuple[str, ...], _Rows] = {}
    with BagReader(path) as reader:
        for received, message in reader.messages(topic):
            try:
                part = member_of(message, field)
            except BadInputError as error:
                raise BadInputError(f"{topic} in {path}: {error}") from error
            key = joints_of(part)
            if key not in kinds:
                kinds[key] = _Rows(*columns_of(part))
            kinds[key].add(message, part, received)
    if not kinds:
        raise BadInputError(f"{topic} in {path} holds no message")
    rows = kinds[max(kinds, key=len)]
    if not rows.names:
        raise BadInputError(f"{topic} in {path} ({topic_types(path)[topic]}) holds no numbers")
    table = rows.table(f"{path}: {topic}", stamps)
    others = sum(len(one.values) for one in kinds.values()) - len(rows.values)
    lines = (f"{others} messages with fewer joints (left out)",) if others else ()
    label = f"{topic}.{field}" if field else topic
    return replace(table, problems=table.problems + lines, label=label)


@dataclass
class _Rows:
    """Numbers of messages that are alike."""

    names: tuple[str, ...]
    get: Getter
    values: list[list[float]] = field(default_factory=list)
    times: list[tuple[float, float]] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)

    def add(self, message: Any, part: Any, received: int) -> None:
        """Take a message; one with another count of numbers is left out."""
        numbers = list(self.get(part))
        if len(numbers) == len(self.names):
            self.values.append(numbers)
            self.times.append((stamp_of(message), 1e-9 * received))
            self.frames.append(str(getattr(getattr(message, "header", None), "frame_id", "")))

    def table(self, source: str, stamps: str) -> Table:
        """Return the table, at the stamps of the headers or at receive times."""
        stamped, received = np.array(self.times).T
        unstamped = stamps == "header" and not np.any(stamped)
        time = received if unstamped or stamps == RECEIVE else stamped
        usual = max(set(self.frames), key=self.frames.count)
        return Table(
            source,
            ("time", *self.names),
            np.column_stack([time, np.array(self.values)]),
            problems=(NO_STAMPS,) if unstamped else (),
            layout=f"frame '{usual}'" if usual else "no frame",
        )


def stamp_of(message: Any) -> float:
    """Return the header stamp in s; 0 for a message without."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0.0 if stamp is None else float(stamp.sec) + 1e-9 * float(stamp.nanosec)
