"""Where the links and sensors of a recorded robot are: by joints and URDF, by /tf."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import (
    matrix_to_quaternion,
    quaternion_to_matrix,
    turned_by,
)
from tactile_dynamics_ros.core.robot.kinematic_tree import chain, independent, read_tree
from tactile_dynamics_ros.core.robot.robot import Joint
from tactile_dynamics_ros.recording.importers.bag_reader import POSE_COLUMNS
from tactile_dynamics_ros.recording.importers.bag_tables import Edge, has_frames, read_frames
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.bag_topics import Topic
from tactile_dynamics_ros.recording.importers.guess.groups import find_groups, read_name, read_names
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.importers.guess.times import find_time
from tactile_dynamics_ros.recording.importers.guess.weight import Weighing
from tactile_dynamics_ros.recording.importers.joint_angles import (
    read_link,
    urdf_text,
)
from tactile_dynamics_ros.recording.topics import ROBOT_DESCRIPTION


@dataclass(frozen=True)
class Arm:
    """An arm of which the joint angles were recorded.

    Attributes:
        path: of the recording.
        urdf: where its URDF is, as mappings have it.
        tree: its joints.
        topic: of the joint angles.
    """

    path: Path
    urdf: str
    tree: tuple[Joint, ...]
    topic: Topic

    @classmethod
    def find(cls, path: Path, topics: Sequence[Topic], urdf: str | None) -> Arm | None:
        """Return the arm, or None where no URDF or no joint angles are known.

        Args:
            path: of the recording.
            topics: of the recording.
            urdf: file; None for what the recording holds.

        Raises:
            BadInputError: the URDF cannot be read, or its joints are on no topic.
        """
        source = urdf or ROBOT_DESCRIPTION
        text = urdf_text(source, path.parent, path, required=urdf is not None)
        if text is None:
            return None
        tree = read_tree(text, source)
        moving = {joint.name for joint in tree if joint.axis is not None}
        states = [topic for topic in topics if topic.is_joints]
        best = max(states, key=lambda t: len(moving & set(t.columns)), default=None)
        if best is None or not moving & set(best.columns):
            if urdf is None:
                return None
            raise BadInputError(
                f"{path}: no topic has the joints of {urdf}: {', '.join(sorted(moving))}"
            )
        return cls(path, source, tree, best)

    @property
    def links(self) -> list[str]:
        """Links that recorded joints move."""
        return [joint.child for joint in self.tree if self._is_moved(joint.child)]

    def tip(self, usual: Sequence[str], answers: Answers) -> str:
        """Return the link at the end of the arm.

        Raises:
            Question: there are several.
        """
        links = self.links
        named = [link for link in usual if link in links]
        if named:
            return named[0]
        parents = {joint.parent for joint in self.tree}
        ends = [link for link in links if link not in parents]
        if len(ends) == 1:
            return ends[0]
        if not ends:
            raise Question(f"{self.topic.name} misses joints that every link of {self.urdf} needs")
        return answers.choose("pose", ends, "several links may carry the sensor")

    def source(self, link: str, answers: Answers) -> Source:
        """Return the poses of a link as a table."""
        angles = self.topic.source(self.path, answers)
        place = {**angles.place, "urdf": self.urdf, "frame": link}
        found = read_link(self.urdf, place, angles.table, self.path.parent)
        named = matrix_to_quaternion(found["rotation"])
        values = np.column_stack([angles.table.column("time"), found["position"], named])
        table = replace(
            angles.table,
            names=("time", *POSE_COLUMNS),
            values=values,
            layout=f"'{link}' by joint angles",
        )
        groups = find_groups(read_names(table.names, {"time": "s"}))
        time = find_time(table, [read_name("time", "s")], answers)
        return Source(place, table, groups, time)

    def _is_moved(self, link: str) -> bool:
        """Whether all joints that move a link were recorded, and at least one does."""
        children = {joint.child for joint in self.tree}
        root = next(joint.parent for joint in self.tree if joint.parent not in children)
        names = {joint.name for joint in independent(chain(self.tree, root, link))}
        return bool(names) and names <= set(self.topic.columns)


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
