"""Frames of /tf and /tf_static: how one moves in another."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion, quaternion_to_matrix
from tactile_dynamics_ros.core.streams.streams import between_turns
from tactile_dynamics_ros.recording.importers.bag_reader import BagReader
from tactile_dynamics_ros.recording.importers.bag_tables import stamp_of
from tactile_dynamics_ros.recording.importers.message_columns import POSE_COLUMNS
from tactile_dynamics_ros.recording.importers.tables import Table
from tactile_dynamics_ros.recording.topics import RECEIVE

Array = NDArray[np.float64]

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
