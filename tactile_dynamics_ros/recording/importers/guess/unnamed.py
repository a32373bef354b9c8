"""Columns of a table without names: the order in which loggers write them, tested on the weight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.recording.importers.guess.answers import Question
from tactile_dynamics_ros.recording.importers.guess.groups import Group, Groups
from tactile_dynamics_ros.recording.importers.guess.orientations import (
    is_by_rows,
    readings_of,
)
from tactile_dynamics_ros.recording.importers.guess.times import TimeColumn
from tactile_dynamics_ros.recording.importers.guess.weight import Measured, Scene
from tactile_dynamics_ros.recording.importers.tables import Table

_WIDTHS = {
    "position": 3,
    "quad": 4,
    "turn3": 3,
    "matrix9": 9,
    "matrix16": 16,
    "force": 3,
    "torque": 3,
}
"""Columns of each quantity."""
_ORDERS = (
    ("position", "turn", "force", "torque"),
    ("turn", "position", "force", "torque"),
    ("force", "torque", "position", "turn"),
    ("force", "torque", "turn", "position"),
    ("turn", "force", "torque"),
    ("force", "torque", "turn"),
    ("position", "turn", "force"),
    ("force", "position", "turn"),
    ("turn", "force"),
    ("force", "turn"),
)
"""Orders in which tables of a pose and a wrench are written."""
_CLEARLY_BETTER = 1.5
"""Misfit of the second best order over that of the best from which the best is the right one."""
_EVEN = 0.02
"""Deviation from unit length, relative, up to which four columns are quaternions."""


def groups_of_numbers(table: Table, time: TimeColumn | None, alone: bool) -> Groups:
    """Return the groups under the order of columns that agrees with gravity best.

    Args:
        table: without names.
        time: its time, or None.
        alone: False if pose and force may be in different tables.

    Raises:
        Question: no order agrees, or several do.
    """
    left = [
        name
        for name in table.names
        if name not in table.texts
        and not (time and name in time.columns)
        and not _is_counter(table.column(name))
    ]
    part = None if alone else _one_part(left, table)
    if part is not None:
        return part
    tried = [(_misfit(groups, table, time), groups) for groups in _orders(left, table)]
    known = sorted(
        ((misfit, g) for misfit, g in tried if misfit is not None), key=lambda pair: pair[0]
    )
    if not known or (len(known) > 1 and known[1][0] < _CLEARLY_BETTER * known[0][0]):
        many = "several orders of" if known else "no usual order of"
        raise Question(
            f"the table has no names, and {many} its {len(left)} columns agree with gravity: name "
            "the columns in a yaml file, columns: [1, 2, 3] (docs/recordings.md)"
        )
    return known[0][1]


def _one_part(columns: Sequence[str], table: Table) -> Groups | None:
    """Groups of a table of poses or of wrenches; None if it may be both or neither."""
    if len(columns) == 6:
        return _cut(columns, ("force", "torque"))
    if len(columns) != 7:
        return None
    for kinds in (("position", "quad"), ("quad", "position")):
        groups = _cut(columns, kinds)
        if _may_turn(groups.turn[0], table):
            return groups
    return None


def _is_counter(values: Array) -> bool:
    """Whether a column counts rows, or never changes and is no part of a rotation."""
    steps = np.diff(values)
    return bool(len(steps) and np.all(steps == 1.0))


def _orders(columns: Sequence[str], table: Table) -> Iterator[Groups]:
    """All groups of the columns that have the right widths and could be rotations."""
    for order in _ORDERS:
        for turn in ("quad", "turn3", "matrix9", "matrix16"):
            kinds = [turn if kind == "turn" else kind for kind in order]
            if turn == "matrix16" and "position" in kinds:
                continue
            if sum(_WIDTHS[kind] for kind in kinds) != len(columns):
                continue
            groups = _cut(columns, kinds)
            if _may_turn(groups.turn[0], table):
                yield groups


def _cut(columns: Sequence[str], kinds: Sequence[str]) -> Groups:
    groups, first = Groups(), 0
    for kind in kinds:
        width = _WIDTHS[kind]
        groups.add(Group(kind, tuple(columns[first : first + width]), ()))
        first += width
    return groups


def _may_turn(group: Group, table: Table) -> bool:
    values = table.columns(*group.columns)
    if group.kind == "quad":
        length = np.linalg.norm(values, axis=1)
        return bool(np.nanmax(np.abs(length / np.nanmedian(length) - 1.0)) < _EVEN)
    if group.kind == "matrix16":
        last = [12, 13, 14] if is_by_rows(values) else [3, 7, 11]
        return bool(np.nanmax(np.abs(values[:, last])) < 1e-9)
    if group.kind == "matrix9":
        square = values.reshape(-1, 3, 3)
        defect = np.abs(np.einsum("nij,nkj->nik", square, square) - np.eye(3)).max(axis=(1, 2))
        return bool(np.nanmedian(defect) < _EVEN)
    return True


def _misfit(groups: Groups, table: Table, time: TimeColumn | None) -> float | None:
    """Least share of the forces that no load explains; None if none is seen."""
    force = table.columns(*groups.force[0].columns)
    clock = None if time is None else time.values
    found = []
    for reading in (r for r in readings_of(groups.turn[0], table) if not r.inside):
        rotation = reading.rotations(table)
        scene = Scene(Measured(force, clock, rotation, clock))
        found += [w for w in (scene.weigh("sensor"), scene.weigh("world")) if w.seen]
    good = [w.rms / w.size for w in found if abs(w.mass) * 9.81 > 0.2 * w.bias]
    return min(good) if good else None
