"""Where /tf and /tf_static say that a sensor sits on the frame whose pose was recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import (
    log_so3,
    matrix_to_quaternion,
    quaternion_to_matrix,
)
from tactile_dynamics_ros.recording.importers.bag_frames import Edge, has_frames, read_frames
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.importers.message_columns import POSE_COLUMNS

Array = NDArray[np.float64]

_SAME_TURN, _SAME_PLACE = 0.01, 1e-4
"""Angle, rad, and distance, m, below which a sensor is in the frame itself: files round."""


@dataclass(frozen=True)
class Mount:
    """A sensor in the frame of a pose.

    Attributes:
        frame: that the pose may be of.
        position: (3,) m of the sensor in it; rotation: (3, 3) sensor to frame.
    """

    frame: str
    position: Array
    rotation: Array

    @property
    def is_none(self) -> bool:
        """Whether the sensor is in the frame itself."""
        turn = float(np.linalg.norm(log_so3(self.rotation[None])[0]))
        return turn < _SAME_TURN and float(np.linalg.norm(self.position)) < _SAME_PLACE

    def is_turned_like(self, other: Mount) -> bool:
        """Whether the sensor is turned as in another mounting."""
        turn = log_so3((self.rotation.T @ other.rotation)[None])[0]
        return float(np.linalg.norm(turn)) < _SAME_TURN

    @property
    def words(self) -> str:
        """Angle and distance, for people."""
        angle = np.degrees(np.linalg.norm(log_so3(self.rotation[None])[0]))
        return f"turned by {angle:.3g} deg, {np.linalg.norm(self.position):.3g} m away"

    @property
    def entry(self) -> dict[str, Any]:
        """Content of `sensor_pose` in a mapping."""
        named = matrix_to_quaternion(self.rotation[None])[0]
        return {
            "position": [round(float(v), 6) for v in self.position],
            "quaternion": [round(float(v), 9) for v in named],
        }

    def apply(self, poses: Source) -> Source:
        """Return the poses of the sensor."""
        table, values = poses.table, poses.table.values.copy()
        columns = [table.names.index(name) for name in POSE_COLUMNS]
        turn = quaternion_to_matrix(values[:, columns[3:]])
        values[:, columns[:3]] += turn @ self.position
        values[:, columns[3:]] = matrix_to_quaternion(turn @ self.rotation)
        return replace(poses, table=replace(table, values=values))


def mounts_of(path: Path, sensor: str) -> list[Mount]:
    """Return the frames that carry a sensor rigidly, the sensor's own first.

    Raises:
        BadInputError: the recording cannot be read.
    """
    edges = read_frames(path) if has_frames(path) else {}
    found = {sensor: Mount(sensor, np.zeros(3), np.eye(3))}
    waiting = [sensor]
    while waiting:
        near = found[waiting.pop(0)]
        for frame, position, rotation in _rigid_neighbours(edges, near.frame):
            if frame not in found:
                placed = position + rotation @ near.position
                found[frame] = Mount(frame, placed, rotation @ near.rotation)
                waiting.append(frame)
    return list(found.values())


def _rigid_neighbours(edges: dict[str, Edge], frame: str) -> list[tuple[str, Array, Array]]:
    """Return frames beside one, with position and rotation of the one in them."""
    found = []
    for child, edge in edges.items():
        if not edge.is_fixed:
            continue
        position, rotation = edge.position[0], edge.rotation[0]
        if child == frame:
            found.append((edge.parent, position, rotation))
        elif edge.parent == frame:
            found.append((child, -rotation.T @ position, rotation.T))
    return found
