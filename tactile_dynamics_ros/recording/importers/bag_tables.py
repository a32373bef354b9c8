"""Topics of a robot's recording as tables of numbers; frames of /tf in another."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion, quaternion_to_matrix
from tactile_dynamics_ros.core.streams.streams import between_turns
from tactile_dynamics_ros.recording.bag_files import ROS1_SUFFIX, STORAGE_SUFFIXES
from tactile_dynamics_ros.recording.importers.bag_reader import (
    POSE_COLUMNS,
    BagReader,
    Getter,
    columns_of,
    joints_of,
    member_of,
)
from tactile_dynamics_ros.recording.importers.tables import Table
from tactile_dynamics_ros.recording.topics import NO_STAMPS, RECEIVE

TF, TF_STATIC = "/tf", "/tf_static"
"""Topics of frames; that of those which never move is looked at too."""
_TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Types of these topics in ROS 2 and in ROS 1."""
_PAUSE = 5.0
"""Step over the median step of a frame from which it is not interpolated: nothing is invented in a
gap. Three messages lost in a row make 4."""


@dataclass(frozen=True)
class Edge:
    """How one frame moves in another: stamps (N,) s, places (N, 3) m and turns (N, 3, 3)."""

    parent: str
    time: Array
    position: Array
    rotation: Array

    @property
    def is_fixed(self) -> bool:
        """Whether it never moves."""
        return len(self.time) == 1 or bool(
            np.ptp(self.position, axis=0).max() == 0.0
            and np.ptp(self.rotation, axis=0).max() == 0.0
        )

    def at(self, time: Array) -> tuple[Array, Array]:
        """Return places and turns at other times, NaN in gaps and beyond the ends."""
        if self.is_fixed:
            count = len(time)
            return np.repeat(self.position[:1], count, 0), np.repeat(self.rotation[:1], count, 0)
        place = np.stack([np.interp(time, self.time, axis) for axis in self.position.T], axis=1)
        turn = between_turns(self.time, self.rotation, time)
        usual = float(np.median(np.diff(self.time)))
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        lost = self.time[after] - self.time[after - 1] > _PAUSE * usual
        lost |= (time < self.time[0] - usual) | (time > self.time[-1] + usual)
        lost &= ~np.isin(time, self.time)
        place[lost], turn[lost] = np.nan, np.nan
        return place, turn


def has_frames(path: Path) -> bool:
    """Whether a recording has frames."""
    with BagReader(path) as reader:
        return any(reader.types.get(topic) in _TF_TYPES for topic in (TF, TF_STATIC))


def read_frames(path: Path, stamps: str = "header") -> dict[str, Edge]:
    """Return how each frame moves in its parent, by the name of the child.

    Args:
        path: of the recording.
        stamps: "header", or "receive" for the times at which messages were received.

    Raises:
        BadInputError: there are no frames.
    """
    samples: dict[tuple[str, str], list[tuple[float, Any]]] = defaultdict(list)
    with BagReader(path) as reader:
        types = reader.types
        for topic in (TF, TF_STATIC):
            messages = reader.messages(topic) if types.get(topic) in _TF_TYPES else ()
            for received, message in messages:
                for part in message.transforms:
                    parent = str(part.header.frame_id).lstrip("/")
                    stamp = 1e-9 * received if stamps == RECEIVE else stamp_of(part)
                    named = (str(part.child_frame_id).lstrip("/"), parent)
                    samples[named].append((stamp, part.transform))
    if not samples:
        raise BadInputError(f"{path} has no frames on {TF}; the topics are {', '.join(types)}")
    return {child: _edge(parent, found) for (child, parent), found in samples.items()}


def _edge(parent: str, samples: Sequence[tuple[float, Any]]) -> Edge:
    stamps, first = np.unique([stamp for stamp, _ in samples], return_index=True)
    parts = [samples[k][1] for k in first]
    places = np.array([_three(part.translation) for part in parts])
    named = np.array([_four(part.rotation) for part in parts])
    return Edge(parent, stamps, places, quaternion_to_matrix(named / _length(named)))


def read_frame(path: Path, frame: str, base: str | None = None, stamps: str = "header") -> Table:
    """Return the pose of a frame in the root of its tree, or in another frame, as a table.

    Args:
        path: of the recording.
        frame: that moves.
        base: frame in which; the root if None.
        stamps: "header", or "receive" for the times at which messages were received.

    Raises:
        BadInputError: there is no such frame, or it never moves.
    """
    edges = read_frames(path, stamps)
    chain = frame_chain(edges, frame, base, str(path))
    moving = [edge for edge in chain if not edge.is_fixed]
    if not moving:
        raise BadInputError(f"{path}: frame '{frame}' never moves in '{chain[0].parent}'")
    time = max((edge.time for edge in moving), key=len)
    place, turn = np.zeros((len(time), 3)), np.tile(np.eye(3), (len(time), 1, 1))
    for edge in chain:
        step, twist = edge.at(time)
        place = place + np.einsum("nij,nj->ni", turn, step)
        turn = turn @ twist
    known = np.isfinite(turn).all(axis=(1, 2))
    named = np.full((len(time), 4), np.nan)
    named[known] = matrix_to_quaternion(turn[known])
    values = np.concatenate([time[:, None], place, named], axis=1)
    root = chain[0].parent
    return Table(f"{path}: {TF}", ("time", *POSE_COLUMNS), values, layout=f"'{frame}' in '{root}'")


def frame_chain(edges: dict[str, Edge], frame: str, base: str | None, source: str) -> list[Edge]:
    """Return the edges from the base, or the root, to a frame.

    Raises:
        BadInputError: there is no such frame, or the base does not carry it.
    """
    if frame not in edges:
        raise BadInputError(f"{source}: no frame '{frame}' on {TF}; there are {', '.join(edges)}")
    chain, seen = [edges[frame]], {frame}
    while chain[0].parent in edges and chain[0].parent != base:
        if chain[0].parent in seen:
            raise BadInputError(f"{source}: the frames on {TF} run in a circle at '{frame}'")
        seen.add(chain[0].parent)
        chain.insert(0, edges[chain[0].parent])
    if base is not None and chain[0].parent != base:
        raise BadInputError(f"{source}: frame '{frame}' does not hang on '{base}'")
    return chain


def _three(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _four(quaternion: Any) -> list[float]:
    return [quaternion.x, quaternion.y, quaternion.z, quaternion.w]


def _length(named: Array) -> Array:
    length = np.linalg.norm(named, axis=1, keepdims=True)
    return np.where(length > 0.0, length, np.nan)


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
