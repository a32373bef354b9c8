"""Where /tf and /tf_static say that a sensor sits on the frame whose pose was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import (
    matrix_to_quaternion,
    quaternion_to_matrix,
    turned_by,
)
from tactile_dynamics_ros.recording.importers.bag_frames import Edge, has_frames, read_frames
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.importers.guess.weight import Weighing
from tactile_dynamics_ros.recording.importers.message_columns import POSE_COLUMNS

Array = NDArray[np.float64]

_CLEARLY_BETTER = 0.77
"""Misfit over that of the next mounting below which the weight tells a sensor's mounting, as of
readings of an orientation."""
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
        away = float(np.linalg.norm(self.position))
        return turned_by(self.rotation) < _SAME_TURN and away < _SAME_PLACE

    def is_turned_like(self, other: Mount) -> bool:
        """Whether the sensor is turned as in another mounting."""
        return turned_by(self.rotation.T @ other.rotation) < _SAME_TURN

    @property
    def words(self) -> str:
        """Angle and distance, for people."""
        angle = np.degrees(turned_by(self.rotation))
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
        carried = self.carried(values[:, columns[:3]], values[:, columns[3:]])
        values[:, columns] = np.hstack(carried)
        return replace(poses, table=replace(table, values=values))

    def carried(self, position: Array, quaternion: Array) -> tuple[Array, Array]:
        """Return position (N, 3) and quaternion (N, 4) of the sensor, from those of the frame."""
        length = np.linalg.norm(quaternion, axis=1, keepdims=True)
        known = (np.isfinite(length) & (length > 0.0))[:, 0]
        place, named = position.copy(), np.full_like(quaternion, np.nan)
        turn = quaternion_to_matrix(quaternion[known] / length[known])
        place[known] += turn @ self.position
        named[known] = matrix_to_quaternion(turn @ self.rotation)
        return place, named


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


def fitting_mount(
    mounts: Sequence[Mount], weigh: Callable[[Mount], Weighing | None]
) -> Mount | None:
    """Return the mounting under which forces fit gravity, None if several do or none.

    Args:
        mounts: that may be meant; of those that are turned alike the nearest is taken.
        weigh: returns the load that the forces show under a mounting.
    """
    weighed = [(weigh(mount), mount) for mount in mounts]
    fits = [(load.rms, mount) for load, mount in weighed if load is not None and load.seen]
    if not fits:
        return None
    least, best = min(fits, key=lambda fit: fit[0])
    others = [rms for rms, mount in fits if not mount.is_turned_like(best)]
    if others and least > _CLEARLY_BETTER * min(others):
        return None
    alike = [mount for _, mount in fits if mount.is_turned_like(best)]
    return min(alike, key=lambda mount: float(np.linalg.norm(mount.position)))


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
