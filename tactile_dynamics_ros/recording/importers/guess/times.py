"""Which column is the time, in which unit, and when something changes at once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.recording.importers.clock import is_time_of_day
from tactile_dynamics_ros.recording.importers.fields import UNITS, read_field
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.groups import ColumnName
from tactile_dynamics_ros.recording.importers.guess.weight import Measured, Scene
from tactile_dynamics_ros.recording.importers.tables import Table

_WORDS = frozenset(
    ["utime", "epoch", "utc", "datetime", "date"]
    + ["time", "t", "timestamp", "timestamps", "stamp", "zeit", "elapsed", "clock", "ts"]
)
"""Words for a time."""
_WHOLE = frozenset(["sec", "secs", "second", "seconds"])
"""Words for whole seconds beside nanoseconds."""
_REST = frozenset(["nanosec", "nanosecs", "nsec", "nsecs", "nanosecond", "nanoseconds", "ns"])
"""Words for nanoseconds beside whole seconds."""
_EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}
"""Stamps since 1970 in each unit, about: 1e9 s was in 2001, 3e9 s will be in 2065."""
_FASTEST, _SLOWEST = 1e-4, 1.0
"""Steps, s, between samples that loggers of forces write: 10 kHz to 1 Hz."""
_SHORTEST, _LONGEST = 0.8, 86400.0
"""Length of a recording, s."""


@dataclass(frozen=True)
class TimeColumn:
    """Time of a table.

    Attributes:
        entry: its field in a mapping.
        units: units that are possible, the likeliest first; one if it is known.
        values: (N,) s in the first of them.
        columns: names.
    """

    entry: dict[str, Any]
    units: tuple[str, ...]
    values: Array
    columns: tuple[str, ...]

    def read_as(self, unit: str) -> TimeColumn:
        """Return the time in another of its units."""
        factor = UNITS["time"][unit] / UNITS["time"][self.units[0]]
        entry = {**self.entry, "unit": unit}
        return TimeColumn(entry, (unit,), self.values * factor, self.columns)


def find_time(table: Table, names: Sequence[ColumnName], answers: Answers) -> TimeColumn | None:
    """Return the time of a table, or None if no column is one.

    Raises:
        Question: several columns may be.
        BadInputError: the one that was named is not there.
    """
    given = answers.get("time")
    if given == "none":
        return None
    if given is not None:
        if given not in table.names:
            raise BadInputError(f"--say time={given}: {table.source} has {', '.join(table.names)}")
        return _column(table, next(n for n in names if n.column == given), answers)
    pair = _pair(names)
    if pair is not None:
        entry = {"columns": list(pair)}
        return TimeColumn(entry, ("s",), read_field(table.source, "time", entry, table), pair)
    found = [name for name in names if _named_time(name)]
    usable = [name for name in found if _may_be_time(table, name.column)]
    if not usable:
        return None if table.has_header else _first_that_runs(table, names, answers)
    usable.sort(key=lambda name: _rank(name))
    return _column(table, usable[0], answers)


def _named_time(name: ColumnName) -> bool:
    words = [*name.stem, name.part]
    if {"valid", "status", "mode"} & set(words):
        return False
    return bool(_WORDS & set(words)) or (name.quantity == "time" and bool(words))


def _rank(name: ColumnName) -> int:
    """Stamps of the measurement before times of logging."""
    words = set(name.stem)
    return 0 if {"header", "stamp"} <= words else 1 if {"stamp", "timestamp"} & words else 2


def _pair(names: Sequence[ColumnName]) -> tuple[str, str] | None:
    """Columns of whole seconds and of nanoseconds."""
    last = {n: (n.stem[-1] if n.stem else "") for n in names}
    rests = [n for n in names if last[n] in _REST or re.search(r"nano_?sec|nsec", n.column.lower())]
    for rest in rests:
        shared = set(rest.stem[:-1]) - {"nano"}
        for whole in names:
            word = re.search(r"(?<!nano)(?<!nano_)(?<!n)secs?(onds)?$", whole.column.lower())
            if whole is not rest and word and shared <= set(whole.stem):
                return whole.column, rest.column
    return None


def _may_be_time(table: Table, column: str) -> bool:
    """Whether a column rises, or holds times of day in words."""
    if column in table.texts:
        return is_time_of_day(table.texts[column][0])
    return _runs(table, column)


def _runs(table: Table, column: str) -> bool:
    """Whether a column rises from row to row, but for a few."""
    values = table.column(column)
    steps = np.diff(values[np.isfinite(values)])
    return len(steps) > 0 and float(np.mean(steps > 0.0)) > 0.9


def _first_that_runs(
    table: Table, names: Sequence[ColumnName], answers: Answers
) -> TimeColumn | None:
    """The first column that rises evenly, of a table without names."""
    pair = _stamp_in_two(table)
    if pair is not None:
        entry = {"columns": list(pair)}
        return TimeColumn(entry, ("s",), read_field(table.source, "time", entry, table), pair)
    for name in names[:3]:
        if name.column in table.texts or not _runs(table, name.column):
            continue
        values = table.column(name.column)
        steps = np.diff(values)
        if np.all(values == np.round(values)) and np.all(steps == 1.0) and len(names) > 1:
            continue
        if np.median(np.abs(steps - np.median(steps))) < 0.3 * np.median(steps):
            return _column(table, name, answers)
    return None


def _stamp_in_two(table: Table) -> tuple[str, str] | None:
    """The first two columns if they are seconds since 1970 and nanoseconds."""
    if len(table.names) < 2 or set(table.names[:2]) & set(table.texts):
        return None
    whole, part = table.columns(*table.names[:2]).T
    since = _EPOCHS["s"] < np.min(whole) and np.max(whole) < 3.0 * _EPOCHS["s"]
    inside = np.min(part) >= 0.0 and 1e3 < np.max(part) < 1e9
    entire = np.all(whole == np.round(whole)) and np.all(part == np.round(part))
    return (table.names[0], table.names[1]) if since and inside and entire else None


def _column(table: Table, name: ColumnName, answers: Answers) -> TimeColumn:
    """The time that one column holds."""
    if name.column in table.texts:
        entry: dict[str, Any] = {"columns": name.column}
        values = read_field(f"{table.source}: time", "time", entry, table)
        return TimeColumn(entry, ("s",), values, (name.column,))
    values = table.column(name.column)
    units = _units(name, values, answers)
    entry = {"columns": name.column, "unit": units[0]}
    return TimeColumn(entry, units, values * UNITS["time"][units[0]], (name.column,))


def _units(name: ColumnName, values: Array, answers: Answers) -> tuple[str, ...]:
    """Units that a column of times may have.

    Raises:
        Question: none is plausible.
    """
    given = answers.get("time_unit")
    if given is not None:
        return (answers.choose("time_unit", UNITS["time"], ""),)
    if name.quantity == "time":
        return (name.unit,)
    if name.stem and name.stem[-1] in _REST:
        return ("ns",)
    finite = values[np.isfinite(values)]
    for unit, size in _EPOCHS.items():
        if size < np.median(finite) < 3.0 * size:
            return (unit,)
    step = float(np.median(np.diff(finite)))
    length = float(finite[-1] - finite[0])
    possible = [
        unit
        for unit, factor in UNITS["time"].items()
        if _FASTEST <= step * factor <= _SLOWEST and _SHORTEST <= length * factor <= _LONGEST
    ]
    if not possible:
        slow = step > _SLOWEST and length <= _LONGEST
        if slow and np.any(finite != np.round(finite)):
            return ("s",)
        raise Question(
            f"column '{name.column}' rises by {step:g} per row: which unit has it? answer with "
            "--say time_unit=s (or ms, us, ns)"
        )
    return tuple(possible)


_CLEARLY_LESS = 0.5
"""What two laws, before and after, leave at most of what one leaves, and one whose numbers drift
with time, RMS: a step of twice the noise. At 0.9 bends of a drift are taken for a change."""
_EDGE = 0.08
"""Share of a table at either end in which no change is looked for: 44 numbers need some rows."""
_COARSE = 10
"""Rows from one time that is tried to the next, before those between are; more may pass a short
stretch by, fewer cost time."""
_FEWEST = 300
"""Rows that a table needs: at 100 Hz some 3 s, over which a motion turns far enough."""


def find_change(measured: Measured) -> float | None:
    """Time, s, of the first row after a change of the forces; None without one, or if untold."""
    if measured.force_time is None or measured.time is None:
        return None
    scene = Scene(replace(measured, change=None))
    if len(scene.rows) < _FEWEST:
        return None
    time = measured.force_time[scene.rows]
    columns, force = _columns(scene), scene.force
    share = ((time - time[0]) / (time[-1] - time[0]))[:, None]
    whole = _left(columns, force)
    drifting = _left(np.hstack([columns, share * columns]), force)
    sums = _Sums.of(columns, force)
    first, last = int(_EDGE * len(time)), int((1.0 - _EDGE) * len(time))
    best = sums.best(np.arange(first, last, _COARSE))
    best = sums.best(np.arange(max(best - _COARSE, first), min(best + _COARSE, last) + 1))
    left = sums.left(np.array([best]))[0]
    if left > _CLEARLY_LESS**2 * min(whole, drifting):
        return None
    return float(time[best])


def _columns(scene: Scene) -> Array:
    """(n, 13 or 22) what each component of the force is linear in, of unit size."""
    parts = [np.ones((len(scene.rows), 1)), scene.rotation.reshape(-1, 9)]
    if scene.motion is not None:
        moved, rate, change = scene.motion
        parts += [moved, (skew(change) + skew(rate) @ skew(rate)).reshape(-1, 9)]
    columns = np.hstack(parts)
    size = np.sqrt(np.mean(columns**2, axis=0))
    return np.asarray(columns / np.where(size > 0.0, size, 1.0))


def _left(columns: Array, force: Array) -> float:
    """Sum of squares that a law leaves."""
    solution = np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.sum((force - columns @ solution) ** 2))


class _Sums:
    """Normal equations of all rows up to each."""

    def __init__(self, information: Array, aim: Array, squares: Array) -> None:
        self._information, self._aim, self._squares = information, aim, squares

    @classmethod
    def of(cls, columns: Array, force: Array) -> _Sums:
        """Sums over rows (n, k) and forces (n, 3)."""
        return cls(
            np.cumsum(columns[:, :, None] * columns[:, None, :], axis=0),
            np.cumsum(columns[:, :, None] * force[:, None, :], axis=0),
            np.cumsum(np.sum(force**2, axis=1)),
        )

    def best(self, rows: NDArray[np.int64]) -> int:
        """The row before which a change leaves least."""
        return int(rows[np.argmin(self.left(rows))])

    def left(self, rows: NDArray[np.int64]) -> Array:
        """Sums of squares (m,) that laws before and from each row leave."""
        before = (self._information[rows - 1], self._aim[rows - 1], self._squares[rows - 1])
        whole = (self._information[-1], self._aim[-1], self._squares[-1])
        after = tuple(a - b for a, b in zip(whole, before, strict=True))
        return _least(*before) + _least(*after)


def _least(information: Array, aim: Array, squares: Array) -> Array:
    """Sums of squares (m,) that the best numbers leave."""
    ridge = 1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None]
    solution = np.linalg.solve(information + ridge * np.eye(information.shape[1]), aim)
    return np.asarray(np.maximum(squares - np.sum(solution * aim, axis=(1, 2)), 0.0))
