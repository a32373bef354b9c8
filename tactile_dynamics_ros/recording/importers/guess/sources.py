"""Tables with what their names and clocks tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.recording.importers.fields import UNITS
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.groups import (
    Group,
    Groups,
    find_groups,
    read_names,
)
from tactile_dynamics_ros.recording.importers.guess.orientations import is_by_rows
from tactile_dynamics_ros.recording.importers.guess.times import TimeColumn, find_time
from tactile_dynamics_ros.recording.importers.guess.unnamed import groups_of_numbers
from tactile_dynamics_ros.recording.importers.tables import Table, read_tables

_FARTHEST, _LEAST_MM = 3.0, 20.0
"""Distance from the world's origin, m, that no arm reaches; and that from which numbers are
millimetres for sure. Between them it is asked."""
_JUMP = 0.05
"""Turn, rad, from row to row of a table without time from which rows are poses of their own: at 100
Hz no arm turns by 3 degrees per row."""
_SEPARATE_S = 1.0
"""Seconds from row to row from which rows that jump are poses of their own, stamps or not."""


@dataclass(frozen=True)
class Source:
    """One table.

    Attributes:
        place: file, and topic or frame of a recording, as mappings have them.
        table: rows and columns.
        groups: columns that belong together.
        time: None where no column is one.
    """

    place: dict[str, str]
    table: Table
    groups: Groups
    time: TimeColumn | None

    @classmethod
    def read(cls, path: Path, answers: Answers, alone: bool = True) -> list[Source]:
        """Read the tables of a file and take their names apart.

        Args:
            path: of the file.
            answers: to questions.
            alone: whether it must hold both pose and force.

        Raises:
            BadInputError: it cannot be read.
            Question: a column may be the time in units that differ.
        """
        tables = read_tables(path)
        alone &= len(tables) == 1
        return [cls._of({"file": path.name}, table, answers, alone) for table in tables]

    @classmethod
    def _of(cls, place: dict[str, str], table: Table, answers: Answers, alone: bool) -> Source:
        names = read_names(table.names, table.units)
        time = find_time(table, names, answers)
        named = table.has_header
        groups = find_groups(names) if named else groups_of_numbers(table, time, alone)
        return cls(place, table, groups, time)

    @classmethod
    def of_topic(cls, place: dict[str, str], table: Table, answers: Answers) -> Source:
        """Take the table of a topic, whose columns have plain names."""
        names = read_names(table.names, {"time": "s"})
        return cls(place, table, find_groups(names), find_time(table, names, answers))

    @property
    def label(self) -> str:
        """Name for people."""
        return " ".join(self.place[key] for key in ("file", "topic", "frame") if key in self.place)

    def turn(self, answers: Answers) -> Group:
        """Return the columns of the orientation.

        Raises:
            Question: there are several, of different bodies.
        """
        order = ("quaternion", "matrix9", "matrix12", "matrix16", "quad", "turn3", "abc", "euler")
        groups = sorted(self.groups.turn, key=lambda g: order.index(g.kind))
        if len({group.body for group in groups}) == 1:
            return groups[0]
        return choose_group(groups, "pose", "several orientations are in the table", answers)

    def position(self, turn: Group, answers: Answers) -> Group | None:
        """Return the columns of the position that belongs to an orientation, if there are any.

        Raises:
            Question: there are several.
        """
        if turn.kind in ("matrix12", "matrix16"):
            by_rows = turn.kind == "matrix12" or is_by_rows(self.table.columns(*turn.columns))
            at = (3, 7, 11) if by_rows else (12, 13, 14)
            columns = tuple(turn.columns[k] for k in at)
            return Group("position", columns, turn.stem, turn.unit)
        groups = self.groups.position
        if len(groups) > 1:
            groups = [group for group in groups if group.body == turn.body] or groups
        if len(groups) > 1:
            return choose_group(groups, "pose", "several positions are in the table", answers)
        return groups[0] if groups else None

    def length_unit(self, position: Group, answers: Answers) -> str:
        """Return the unit of a position.

        Raises:
            Question: neither name nor size tell it.
        """
        if answers.get("position_unit") is not None:
            return answers.choose("position_unit", UNITS["length"], "")
        if position.unit in UNITS["length"]:
            return position.unit
        values = self.table.columns(*position.columns)
        far = float(np.nanmedian(np.linalg.norm(values, axis=1)))
        if far <= _FARTHEST:
            return "m"
        if far >= _LEAST_MM:
            return "mm"
        return answers.choose(
            "position_unit", ("mm", "cm", "m"), f"the position is {far:.3g} from the origin"
        )

    def describe_time(self) -> str:
        """Column, unit and rate of the time, for people."""
        assert self.time is not None
        step = float(np.median(np.diff(self.time.values)))
        length = float(self.time.values[-1] - self.time.values[0])
        columns = " and ".join(self.time.columns)
        unit = self.time.entry.get("unit", "s")
        return f"{columns} in {unit}: {1.0 / step:.4g} Hz, {length:.4g} s"


def choose_group(groups: Sequence[Group], key: str, problem: str, answers: Answers) -> Group:
    """Return the group that the user names.

    Raises:
        Question: none was named.
    """
    labels = [group.label for group in groups]
    return groups[labels.index(answers.choose(key, labels, problem))]


def beside(groups: Sequence[Group], force: Group) -> Group | None:
    """Return the torque that belongs to a force, if there is one.

    Raises:
        Question: there are several.
    """
    same = [group for group in groups if group.body == force.body] or list(groups)
    if len(same) > 1:
        raise Question(
            f"several torques may belong to {force.label}: {', '.join(g.label for g in same)}; "
            "name the columns in a yaml file (docs/recordings.md)"
        )
    return same[0] if same else None


def rows_jump(rotation: Array) -> bool:
    """Whether rows (N, 3, 3) are poses of their own instead of samples of a motion."""
    known = rotation[np.isfinite(rotation).all(axis=(1, 2))]
    turn = np.linalg.norm(log_so3(np.swapaxes(known[:-1], 1, 2) @ known[1:]), axis=1)
    return bool(len(turn) and np.median(turn) > _JUMP)


def rows_are_separate(time: TimeColumn, rotation: Array) -> bool:
    """Whether rows with stamps are poses of their own: seconds apart, turned far."""
    return float(np.median(np.diff(time.values))) >= _SEPARATE_S and rows_jump(rotation)
