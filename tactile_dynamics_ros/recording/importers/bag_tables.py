"""Topics of a recording as tables: poses, wrenches, joint angles, and frames of /tf."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion, quaternion_to_matrix
from tactile_dynamics_ros.core.streams.streams import between_turns
from tactile_dynamics_ros.recording.bag_files import (
    DAMAGE,
    ROS1_SUFFIX,
    STORAGE_SUFFIXES,
    named_connections,
    one_line,
)
from tactile_dynamics_ros.recording.bag_limits import check_readable
from tactile_dynamics_ros.recording.importers.tables import Table

Array = NDArray[np.float64]

POSE_COLUMNS = (*(f"position.{a}" for a in "xyz"), *(f"orientation.{a}" for a in "xyzw"))
"""Columns of a topic of poses."""
WRENCH_COLUMNS = (*(f"force.{a}" for a in "xyz"), *(f"torque.{a}" for a in "xyz"))
"""Columns of a topic of wrenches."""
TF, TF_STATIC = "/tf", "/tf_static"
"""Topics of frames; that of those which never move is looked at too."""
_TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Types of these topics in ROS 2 and in ROS 1."""
_PAUSE = 5.0
"""Step over the median step of a frame from which it is not interpolated: nothing is invented in a
gap. Three messages lost in a row make 4."""


def is_bag(path: Path) -> bool:
    """Whether a path is that of a recording instead of a text table."""
    return path.is_dir() or path.suffix in (*STORAGE_SUFFIXES, ROS1_SUFFIX)


def topic_types(path: Path) -> dict[str, str]:
    """Return the message type of every topic.

    Raises:
        BadInputError: the recording cannot be read.
    """
    with _opened(path) as reader:
        return {c.topic: c.msgtype for c in named_connections(reader)}


def read_topic(path: Path, topic: str) -> Table:
    """Return one topic of poses, wrenches or joint angles as a table with its stamps in s.

    Raises:
        BadInputError: the topic is not there, or its type has none of these.
    """
    rows, frames, names = [], [], ()
    for message in _messages(path, topic):
        found = _row(message)
        if found is None:
            kind = type(message).__name__
            raise BadInputError(
                f"{topic} in {path} is a {kind}; expected poses, wrenches, transforms, odometry or "
                "joint states with a header"
            )
        names, values = found
        rows.append([_seconds(message.header), *values])
        frames.append(str(message.header.frame_id))
    if not rows:
        raise BadInputError(f"{topic} in {path} holds no message")
    values = np.array([row for row in rows if len(row) == len(names) + 1], dtype=np.float64)
    frame = max(set(frames), key=frames.count)
    return Table(f"{path}: {topic}", ("time", *names), values, layout=f"frame '{frame}'")


def frame_of(path: Path, topic: str) -> str:
    """Return the frame of the first message of a topic; "" without any."""
    return next((str(m.header.frame_id).lstrip("/") for m in _messages(path, topic)), "")


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


def read_frames(path: Path) -> dict[str, Edge]:
    """Return how each frame moves in its parent, by the name of the child.

    Raises:
        BadInputError: there are no frames.
    """
    samples: dict[tuple[str, str], list[tuple[float, Any]]] = defaultdict(list)
    types = topic_types(path)
    for topic in (TF, TF_STATIC):
        if types.get(topic) in _TF_TYPES:
            for message in _messages(path, topic):
                for part in message.transforms:
                    names = (
                        str(part.child_frame_id).lstrip("/"),
                        str(part.header.frame_id).lstrip("/"),
                    )
                    samples[names].append((_seconds(part.header), part.transform))
    if not samples:
        raise BadInputError(f"{path} has no frames on {TF}; the topics are {', '.join(types)}")
    return {child: _edge(parent, found) for (child, parent), found in samples.items()}


def _edge(parent: str, samples: Sequence[tuple[float, Any]]) -> Edge:
    stamps, first = np.unique([stamp for stamp, _ in samples], return_index=True)
    parts = [samples[k][1] for k in first]
    places = np.array([_three(part.translation) for part in parts])
    named = np.array([_four(part.rotation) for part in parts])
    return Edge(parent, stamps, places, quaternion_to_matrix(named / _length(named)))


def read_frame(path: Path, frame: str, base: str | None = None) -> Table:
    """Return the pose of a frame in the root of its tree, or in another frame, as a table.

    Raises:
        BadInputError: there is no such frame, or it never moves.
    """
    edges = read_frames(path)
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


def _row(message: Any) -> tuple[tuple[str, ...], list[float]] | None:
    """Names and numbers of one message; None if it is of another kind."""
    if not hasattr(message, "header"):
        return None
    if hasattr(message, "wrench"):
        return WRENCH_COLUMNS, [*_three(message.wrench.force), *_three(message.wrench.torque)]
    if hasattr(message, "transform"):
        part = message.transform
        return POSE_COLUMNS, [*_three(part.translation), *_four(part.rotation)]
    if hasattr(message, "pose"):
        pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        return POSE_COLUMNS, [*_three(pose.position), *_four(pose.orientation)]
    if hasattr(message, "name") and hasattr(message, "position"):
        return tuple(map(str, message.name)), [float(v) for v in message.position]
    return None


def _three(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _four(quaternion: Any) -> list[float]:
    return [quaternion.x, quaternion.y, quaternion.z, quaternion.w]


def _length(named: Array) -> Array:
    length = np.linalg.norm(named, axis=1, keepdims=True)
    return np.where(length > 0.0, length, np.nan)


def _seconds(header: Any) -> float:
    return float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)


def _messages(path: Path, topic: str) -> Iterator[Any]:
    """Yield the messages of a topic.

    Raises:
        BadInputError: the recording cannot be read, or has no such topic.
    """
    with _opened(path) as reader:
        named = named_connections(reader)
        connections = [c for c in named if c.topic == topic]
        if not connections:
            present = ", ".join(sorted({c.topic for c in named}))
            raise BadInputError(f"{path} has no topic {topic}; the topics are {present}")
        try:
            for connection, _, data in reader.messages(connections=connections):
                yield reader.deserialize(data, connection.msgtype)
        except (AnyReaderError, *DAMAGE) as error:
            raise BadInputError(f"{path}: {topic} is damaged: {one_line(error)}") from error


class _opened:  # noqa: N801 - used as a function
    """A reader of any recording, whose errors are one line."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reader: AnyReader | None = None

    def __enter__(self) -> AnyReader:
        if not self._path.exists():
            raise BadInputError(
                f"{self._path}: no such file or directory; expected a recording"
                + nearest_file(self._path)
            )
        check_readable(self._path)
        ros1 = self._path.suffix == ROS1_SUFFIX
        store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
        return self._guarded(lambda: self._open(store))

    def __exit__(self, *error: object) -> None:
        if self._reader is not None:
            self._reader.close()

    def _open(self, store: Any) -> AnyReader:
        self._reader = AnyReader([self._path], default_typestore=store)
        self._reader.open()
        return self._reader

    def _guarded(self, action: Callable[[], AnyReader]) -> AnyReader:
        try:
            return action()
        except (AnyReaderError, *DAMAGE) as error:
            self._reader = None
            raise BadInputError(f"{self._path} cannot be read: {one_line(error)}") from error
