"""Read the statuses of one message; an estimate may be withheld, so any entry may be missing.

Messages are read by their fields: those of running nodes and those of recordings alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OK, STALE = 0, 3
"""Levels of diagnostic_msgs/DiagnosticStatus: all is well; nothing was heard."""


class Statuses:
    """Statuses by name. What is missing reads as "", as no entries, as NaN, as level STALE.

    Args:
        statuses: of one DiagnosticArray; of two with one name the last counts.
    """

    def __init__(self, statuses: Iterable[Any] = ()) -> None:
        self._found = {status.name: status for status in statuses}

    def __contains__(self, name: object) -> bool:
        return name in self._found

    def level(self, name: str) -> int:
        """Return the level of a status."""
        if name not in self._found:
            return STALE
        level = self._found[name].level
        return level[0] if isinstance(level, bytes) else int(level)

    def text(self, name: str) -> str:
        """Return the sentence of a status."""
        return str(self._found[name].message) if name in self._found else ""

    def values(self, name: str) -> dict[str, str]:
        """Return all entries of a status."""
        return status_values(self._found[name]) if name in self._found else {}

    def number(self, name: str, key: str) -> float:
        """Return an entry as a number."""
        return to_number(self.values(name).get(key))

    def numbers(self, name: str, keys: Sequence[str]) -> Array:
        """Return entries as numbers, in the order of the keys."""
        values = self.values(name)
        return np.array([to_number(values.get(key)) for key in keys])

    def words(self, name: str, key: str) -> tuple[str, ...]:
        """Return the parts of an entry that commas separate."""
        return tuple(filter(None, self.values(name).get(key, "").split(",")))


def status_values(status: Any) -> dict[str, str]:
    """Return the entries of a status."""
    return {pair.key: pair.value for pair in status.values}


def to_number(text: str | None) -> float:
    """Return the number that a text is; NaN where it is none or missing."""
    try:
        return float("nan" if text is None else text)
    except ValueError:
        return float("nan")
