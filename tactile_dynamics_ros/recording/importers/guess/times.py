"""Which column is the time, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.clock import is_time_of_day
from tactile_dynamics_ros.recording.importers.fields import UNITS, read_field
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.groups import ColumnName
from tactile_dynamics_ros.recording.importers.tables import Table

Array = NDArray[np.float64]

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
