"""Pose of an arm's link by joint angles of a recording and the arm's URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.core.robot.kinematic_tree import chain, independent, read_tree
from tactile_dynamics_ros.core.robot.robot import Joint
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.bag_topics import Topic
from tactile_dynamics_ros.recording.importers.guess.groups import find_groups
from tactile_dynamics_ros.recording.importers.guess.names import read_name, read_names
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.importers.guess.times import find_time
from tactile_dynamics_ros.recording.importers.joint_angles import (
    ROBOT_DESCRIPTION,
    read_link,
    urdf_text,
)
from tactile_dynamics_ros.recording.importers.message_columns import POSE_COLUMNS


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
