"""Tables of numbers in text files; a row that cannot be read is named by its line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.tables.layout import (
    MISSING,
    Layout,
    find_layout,
    is_number,
)
from tactile_dynamics_ros.recording.importers.tables.text import read_text

Array = NDArray[np.float64]

_MOST_BAD = 0.05
"""Share of rows that cannot be read up to which they are left out and named; a table with more is
refused, since it is probably not laid out as it seems. Loggers that are killed leave one such
row."""
_TEXT = 0.5
"""Share of cells that are no numbers from which a column is text (names of frames, states)."""
_LARGEST = 1e30
"""Largest number that was measured: stamps in ns have 1e18. Larger ones and infinite ones, which
loggers write for what is invalid, count as missing; their squares would overflow."""
_NAMED = 5
"""Bad rows that are named one by one; of more the first are, and the number of all."""


@dataclass(frozen=True)
class Table:
    """Columns of numbers by name.

    Attributes:
        source: file, for messages to the user.
        names: K column names; "1", "2", ... where the file has none.
        values: (N, K); an empty cell is NaN, and so is a column of text.
        texts: columns of text by name.
        units: units of columns by name, where the file has a row of them.
        problems: one line of text for each row that was left out.
        layout: what parts cells and decimals, for people.
        has_header: whether the names come from the file.
        label: topic of a recording, for people; "" for a file.
    """

    source: str
    names: tuple[str, ...]
    values: Array
    texts: dict[str, list[str]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    layout: str = ""
    has_header: bool = True
    label: str = ""

    def columns(self, *names: str) -> Array:
        """Return (N, len(names)) values.

        Raises:
            BadInputError: a column is not there, or holds text.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise BadInputError(
                f"{self.source}: no column '{missing[0]}'; it has {', '.join(self.names)}"
            )
        text = next((name for name in names if name in self.texts), None)
        if text is not None:
            raise BadInputError(
                f"{self.source}: column '{text}' holds '{self.texts[text][0]}'; expected numbers"
            )
        return self.values[:, [self.names.index(name) for name in names]]

    def column(self, name: str) -> Array:
        """Return (N,) values of one column."""
        return self.columns(name)[:, 0]

    def matrices(self, prefix: str) -> Array:
        """Return (N, 3, 3) from columns <prefix>11 .. <prefix>33, row by row."""
        names = [f"{prefix}{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
        return self.columns(*names).reshape(-1, 3, 3)


def read_table(path: Path) -> Table:
    """Read a table; separator, decimal sign, encoding, header, units and comments are found.

    A path below a tar archive, such as ``slides.tar.gz/mat1_1_cw.csv``, names a member of it.

    Raises:
        BadInputError: the file is missing, or no table, or too many of its rows cannot be read.
    """
    text = read_text(path)
    try:
        layout = find_layout(text)
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    if layout is None:
        raise BadInputError(f"{path}: expected a line of column names and rows of numbers")
    words = _text_columns(layout)
    good, bad = _sort_rows(layout, words)
    if not good:
        raise BadInputError(f"{path}: {bad[0]}; expected rows of numbers")
    if len(bad) > max(1.0, _MOST_BAD * len(layout.rows)):
        raise BadInputError(
            f"{path}: {bad[0]}, and {len(bad) - 1} more of {len(layout.rows)} rows cannot be read; "
            f"expected {len(layout.names)} numbers parted by {layout.description}"
        )
    values = _numbers(good, words, layout)
    texts = {layout.names[k]: [cells[k] for cells in good] for k in sorted(words)}
    return Table(
        source=str(path),
        names=layout.names,
        values=values,
        texts=texts,
        units=layout.units,
        problems=tuple(_shortened(bad)),
        layout=layout.description,
        has_header=layout.has_header,
    )


def _text_columns(layout: Layout) -> set[int]:
    """Numbers of the columns that hold words."""
    width = len(layout.names)
    rows = [cells for _, cells in layout.rows if len(cells) == width]
    words = np.array([[_is_word(cell) for cell in cells] for cells in rows], dtype=bool)
    return set(np.flatnonzero(words.reshape(-1, width).mean(axis=0) > _TEXT).tolist())


def _is_word(cell: str) -> bool:
    return not is_number(cell) and cell.lower() not in MISSING


def _is_wrong(cell: str, layout: Layout) -> bool:
    """Whether a cell is no number as those of the table are written."""
    return _is_word(cell) or ("," in cell and "," in layout.plain(cell))


def _sort_rows(layout: Layout, text: set[int]) -> tuple[list[list[str]], list[str]]:
    """Rows that can be read, and one line for each that cannot."""
    good, bad = [], []
    width = len(layout.names)
    for number, cells in layout.rows:
        if len(cells) != width:
            bad.append(f"line {number} has {len(cells)} cells, not {width}")
            continue
        numbers = (k for k in range(width) if k not in text)
        wrong = next((k for k in numbers if _is_wrong(cells[k], layout)), None)
        if wrong is None:
            good.append(cells)
        else:
            name = layout.names[wrong]
            bad.append(f"line {number}: '{cells[wrong][:20]}' under '{name}' is not a number")
    return good, bad


def _numbers(rows: Sequence[Sequence[str]], text: set[int], layout: Layout) -> Array:
    """Return (N, K) numbers; NaN for missing cells and words."""
    width = len(rows[0])
    values = np.full((len(rows), width), np.nan)
    for k in range(width):
        if k not in text:
            values[:, k] = [_number(cells[k], layout) for cells in rows]
    return np.where(np.abs(values) <= _LARGEST, values, np.nan)


def _number(cell: str, layout: Layout) -> float:
    if cell.lower() in MISSING:
        return float("nan")
    return float(layout.plain(cell).replace("D", "e"))


def _shortened(bad: Sequence[str]) -> list[str]:
    """Return the first lines, and how many there are beyond."""
    more = len(bad) - _NAMED
    named = [f"{line} (row left out)" for line in bad[:_NAMED]]
    return named + ([f"{more} more rows cannot be read (left out)"] if more > 0 else [])
