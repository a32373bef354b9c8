"""What each topic of a recording may hold: a wrench, a pose, joint angles, or several of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.recording.importers.bag_reader import (
    POSE_COLUMNS,
    TWIST_COLUMNS,
    WRENCH_COLUMNS,
    columns_of,
)
from tactile_dynamics_ros.recording.importers.bag_tables import first_messages, read_topic
from tactile_dynamics_ros.recording.importers.guess.answers import Answers
from tactile_dynamics_ros.recording.importers.guess.groups import (
    OTHER,
    WRENCH,
    Group,
    Groups,
    find_groups,
    read_name,
)
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.importers.guess.times import find_time
from tactile_dynamics_ros.recording.importers.tables import Table

_FORCE_WORDS = WRENCH | {"atift", "ati", "sensor", "wrenches", "loadcell", "forcetorque"}
"""Words in a topic of twists or bare numbers that make it one of forces; makers of sensors too."""
_WANTED = frozenset(["target", "desired", "command", "cmd", "goal", "setpoint", "reference", "c"])
"""Words of what a controller wants, not of what was measured."""
_MOVES = 1e-6
"""Change of the numbers of a pose from which it is one that moves: states of drivers have constant
transforms beside it, to the last digit."""


@dataclass(frozen=True)
class Topic:
    """One topic that may be meant.

    Attributes:
        name: of the topic.
        columns: of its first message.
        groups: columns that belong together.
        frame, child: frame of the header, and the one that it says it is of; "" if none.
        is_joints: whether it is one of joint angles.
    """

    name: str
    columns: tuple[str, ...]
    groups: Groups
    frame: str = ""
    child: str = ""
    is_joints: bool = False

    @property
    def words(self) -> frozenset[str]:
        """Words of its name."""
        return frozenset(re.split(r"[^a-z0-9]+", self.name.lower()))

    @property
    def is_wrench(self) -> bool:
        """Whether it is a wrench for sure."""
        twist = self.is_twist and bool(self.words & _FORCE_WORDS)
        return self.columns == WRENCH_COLUMNS or twist

    @property
    def is_twist(self) -> bool:
        """Whether it is a twist, as which some drivers publish wrenches."""
        return self.columns == TWIST_COLUMNS

    @property
    def may_be_wrench(self) -> bool:
        """Whether it may be one where no other topic is: a twist that nothing calls a speed."""
        return self.is_twist and not self.words & OTHER

    @property
    def is_pose(self) -> bool:
        """Whether it is a pose and nothing else."""
        return self.columns == POSE_COLUMNS

    @property
    def is_wanted(self) -> bool:
        """Whether it is what a controller wants."""
        return bool(self.words & _WANTED)

    def is_called(self, frame: str) -> bool:
        """Whether the topic bears the name of a frame, as /tcp_pose or /tool0/pose do."""
        return set(re.split(r"[^a-z0-9]+", frame.lower())) <= self.words

    def source(self, path: Path, answers: Answers) -> Source:
        """Read the topic; groups that a controller wants or that never move are left out."""
        stamps = answers.get("stamps") or "header"
        table = read_topic(path, self.name, stamps=stamps)
        place = {"file": path.name, "topic": self.name}
        place |= {} if stamps == "header" else {"stamps": stamps}
        names = [read_name("time", "s")]
        moving = {
            kind: [group for group in found if _moves(group, table)] or found
            for kind, found in (("turn", self.groups.turn), ("position", self.groups.position))
        }
        groups = replace(self.groups, **moving)
        return Source(place, table, groups, find_time(table, names, answers))


def _moves(group: Group, table: Table) -> bool:
    """Whether a position or an orientation changes."""
    values = table.columns(*group.columns)
    return bool(np.nanmax(np.ptp(values, axis=0)) > _MOVES)


def read_topics(path: Path) -> list[Topic]:
    """Return all topics that hold numbers of a known type, but those of what is wanted.

    Raises:
        BadInputError: the recording cannot be read.
    """
    found = [_topic(name, message) for name, message in first_messages(path).items()]
    return [topic for topic in found if topic.columns and not topic.is_wanted]


def _topic(name: str, message: Any) -> Topic:
    columns, _ = columns_of(message)
    header = getattr(message, "header", None)
    joints = hasattr(message, "name") and hasattr(message, "effort")
    return Topic(
        name,
        columns,
        Groups() if joints else _groups(name, columns),
        str(getattr(header, "frame_id", "")).lstrip("/"),
        str(getattr(message, "child_frame_id", "")).lstrip("/"),
        joints,
    )


def _groups(topic: str, columns: Sequence[str]) -> Groups:
    """Return the groups of a topic's columns; numbers without a name are called like the topic."""
    if columns == TWIST_COLUMNS:
        force, torque = (
            Group(kind, TWIST_COLUMNS[k : k + 3], (kind,))
            for kind, k in (("force", 0), ("torque", 3))
        )
        return Groups(force=[force], torque=[torque])
    bare = all(re.fullmatch(r"data\.\d+", column) for column in columns)
    names = [
        replace(read_name(f"{topic}.{column}" if bare else column), column=column)
        for column in columns
    ]
    groups = find_groups(names)
    kept = {
        kind: [g for g in getattr(groups, kind) if not g.body & _WANTED]
        for kind in ("force", "torque", "turn", "position")
    }
    return _in_sensor_axes(Groups(**kept))


def _in_sensor_axes(groups: Groups) -> Groups:
    """Leave out what Franka's state gives twice: the wrench in axes of the base, beside its own."""
    own = {kind: [g for g in getattr(groups, kind) if "k" in g.stem[:1]] for kind in _WRENCHES}
    return replace(groups, **own) if own["force"] else groups


_WRENCHES = ("force", "torque")
"""Kinds of groups of a wrench."""
