"""Topics of a recording as tables of numbers, whatever their types."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.bag_files import ROS1_SUFFIX, STORAGE_SUFFIXES
from tactile_dynamics_ros.recording.importers.bag_reader import BagReader
from tactile_dynamics_ros.recording.importers.message_columns import columns_of, member_of
from tactile_dynamics_ros.recording.importers.tables import Table
from tactile_dynamics_ros.recording.topics import NO_STAMPS, RECEIVE


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

    Raises:
        BadInputError: the recording cannot be read.
    """
    found = {}
    with BagReader(path) as reader:
        for topic in reader.types:
            with suppress(BadInputError):
                for _, message in islice(reader.messages(topic), 1):
                    found[topic] = message
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
    where = f"{topic}.{field}" if field else topic
    rows: list[list[float]] = []
    times: list[tuple[float, float]] = []
    frames: list[str] = []
    names: tuple[str, ...] = ()
    with BagReader(path) as reader:
        for received, message in reader.messages(topic):
            part = member_of(message, field)
            if not rows:
                names, get = columns_of(part)
                if not names:
                    kind = type(message).__name__
                    raise BadInputError(f"{where} in {path} ({kind}) holds no numbers")
            rows.append(get(part))
            times.append((stamp_of(message), 1e-9 * received))
            frames.append(str(getattr(getattr(message, "header", None), "frame_id", "")))
    if not rows:
        raise BadInputError(f"{topic} in {path} holds no message")
    whole = [k for k, row in enumerate(rows) if len(row) == len(names)]
    stamped, received_at = np.array(times)[whole].T
    unstamped = stamps == "header" and not np.any(stamped)
    time = received_at if unstamped or stamps == RECEIVE else stamped
    values = np.column_stack([time, np.array([rows[k] for k in whole])])
    return Table(
        f"{path}: {topic}",
        ("time", *names),
        values,
        problems=(NO_STAMPS,) if unstamped else (),
        layout=_layout(frames),
        label=where,
    )


def stamp_of(message: Any) -> float:
    """Return the header stamp in s; 0 for a message without."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0.0 if stamp is None else float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _layout(frames: Sequence[str]) -> str:
    usual = max(set(frames), key=frames.count)
    return f"frame '{usual}'" if usual else "no frame"
