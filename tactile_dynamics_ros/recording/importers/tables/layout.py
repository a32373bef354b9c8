"""How a text table is laid out: separator, decimal sign, header, comments, units, rows."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tactile_dynamics_ros.core.errors import BadInputError

SEPARATORS = (";", "\t", ",", "|", None)
"""What may part cells; None are blanks."""
COMMENTS = ("#", "%", "//", "!")
"""What a line begins with that is no row; what stands behind it may be the header."""
MOST_COLUMNS = 2000
"""Columns of a table: loggers of whole robots write 500. Each cell is looked at for every
separator, so that a million columns would take minutes."""
MISSING = frozenset(
    ["", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "-nan(ind)", "nan(ind)"]
)
"""Cells, in small letters, that hold no number on purpose."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?inf(inity)?", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?(\d+(,\d*)?|,\d+)([eE][+-]?\d+)?")
_GROUPED = re.compile(
    r"[+-]?\d{1,3}(?:(?:\.\d{3})+(?:,\d*)?|(?:,\d{3})+(?:\.\d*)?"
    r"|(?:['’\u00a0\u202f]\d{3})+(?:[.,]\d*)?)"
)
"""A number whose thousands are parted: 1.234,5, 1,234.5 or 1'234.5, or by blanks that do not break
a line."""
_SAMPLED = 200
"""Lines at the end of a file from which the layout is read: what precedes the rows stands at the
beginning, and so many lines fix separator and width of any table."""
_NUMERIC = 0.5
"""Share of a row's cells that are numbers or missing, of which at least two numbers, from which a
line is a row: loggers put frame names and states beside numbers."""
_UNITS = re.compile(
    r"[\[(<]?(s|sec|seconds?|ms|us|µs|ns|m|cm|mm|n|mn|kn|kgf|lbf|n ?\*?m|nm|n-m|n ?mm|nmm|mnm|"
    r"lbf-?in|rad|deg|°|degrees?|radians?|rad/s|deg/s|m/s|mm/s|m/s\^?2|m/s²|mm/s\^?2|g|a|v|hz|-|1|"
    r"count|unitless)?[\])>]?",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Layout:
    """How the cells of a table are found.

    Attributes:
        separator: between cells; None for blanks.
        decimal_comma: whether numbers are written 0,5.
        thousands: sign between thousands; "" for none.
        names: of the columns; "1", "2", ... without a header.
        units: of the columns by name, as written, where a row of units was found.
        rows: line number (from 1) and cells of each row.
    """

    separator: str | None
    decimal_comma: bool
    names: tuple[str, ...]
    units: dict[str, str]
    rows: list[tuple[int, list[str]]]
    has_header: bool
    thousands: str = ""

    @property
    def description(self) -> str:
        """What parts cells and decimals, for people."""
        words = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars", None: "blanks"}
        decimal = "decimal commas" if self.decimal_comma else "decimal points"
        grouped = f", thousands as 1{self.thousands}000" if self.thousands else ""
        header = "" if self.has_header else ", no header"
        return f"{words[self.separator]}, {decimal}{grouped}{header}"

    def plain(self, cell: str) -> str:
        """Return a number as Python reads it."""
        if self.thousands:
            cell = cell.replace(self.thousands, "")
        return cell.replace(",", ".") if self.decimal_comma else cell


def find_layout(text: str) -> Layout | None:
    """Return the layout of a table, or None if the text holds no rows of numbers.

    Raises:
        BadInputError: it has more columns than anybody could name.
    """
    lines = [(k + 1, line.rstrip()) for k, line in enumerate(text.splitlines())]
    lines = [(k, line) for k, line in lines if line.strip()]
    plain = [line for _, line in lines if not line.lstrip().startswith(COMMENTS)]
    _refuse_wide(max(plain[-_SAMPLED:], key=len, default=""))
    best = max(
        ((*_judge(plain[-_SAMPLED:], s), -k, s) for k, s in enumerate(SEPARATORS)), default=None
    )
    if best is None or best[0] == 0.0:
        return None
    separator, width = best[-1], best[1]
    first = next(
        (
            k
            for k, (_, line) in enumerate(lines)
            if not line.lstrip().startswith(COMMENTS)
            and _is_row(split_line(line, separator), width)
        ),
        None,
    )
    if first is None:
        return None
    rows = [
        (number, split_line(line, separator))
        for number, line in lines[first:]
        if not line.lstrip().startswith(COMMENTS)
    ]
    rows = _without_empty_end(rows, width)
    width = max(Counter(len(cells) for _, cells in rows).items(), key=lambda item: item[1])[0]
    names, units = _header([line for _, line in lines[:first]], separator, width)
    decimal_comma, thousands = _signs(rows)
    named = names or [str(k + 1) for k in range(width)]
    return Layout(separator, decimal_comma, tuple(named), units, rows, bool(names), thousands)


def _refuse_wide(line: str) -> None:
    separators = [separator for separator in SEPARATORS if separator is not None]
    columns = max([line.count(separator) + 1 for separator in separators] + [len(line.split())])
    if columns > MOST_COLUMNS:
        raise BadInputError(f"a line has {columns} cells, expected at most {MOST_COLUMNS} columns")


def split_line(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line without blanks and quotation marks around them."""
    if separator is None:
        return line.split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    return [cell.strip() for cell in line.split(separator)]


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with decimal point or comma, with thousands parted or not."""
    return bool(
        _NUMBER.fullmatch(cell) or _DECIMAL_COMMA.fullmatch(cell) or _GROUPED.fullmatch(cell)
    )


def _judge(lines: Sequence[str], separator: str | None) -> tuple[float, int]:
    """Share of lines that are rows of numbers of one width if parted so, and that width."""
    cells = [split_line(line, separator) for line in lines]
    rows = [c for c in cells if _is_row(c, len(c))]
    if not rows:
        return 0.0, 0
    width, count = Counter(map(len, rows)).most_common(1)[0]
    numeric = sum(sum(map(_counts, c)) for c in rows) / sum(map(len, rows))
    return round(count / len(lines) * numeric, 3), width


def _counts(cell: str) -> bool:
    return is_number(cell) or cell.lower() in MISSING


def _is_row(cells: Sequence[str], width: int) -> bool:
    """Whether a line holds numbers, about as many cells as rows have."""
    if abs(len(cells) - width) > 1 or len(cells) < 2:
        return False
    numbers = sum(map(is_number, cells))
    return numbers >= 2 and sum(map(_counts, cells)) >= _NUMERIC * len(cells)


def _without_empty_end(
    rows: list[tuple[int, list[str]]], width: int
) -> list[tuple[int, list[str]]]:
    """Drop the empty cell behind a separator that ends every row."""
    ends = [cells[-1] == "" for _, cells in rows if len(cells) == width]
    if width < 2 or not ends or not all(ends):
        return rows
    return [(k, cells[:-1] if len(cells) == width else cells) for k, cells in rows]


def _signs(rows: Sequence[tuple[int, list[str]]]) -> tuple[bool, str]:
    """Return whether decimals stand behind a comma, and the sign between thousands.

    One cell with both signs, or with one of them twice, tells. Else both may be in different cells:
    then the one whose cells all look like thousands parts them, unless those of the other do too.
    """
    marked = {cell for _, cells in rows for cell in cells if "," in cell or cell.count(".") > 1}
    present = set("".join("".join(cells) for _, cells in rows)) & set("'’\u00a0\u202f")
    other = next((sign for sign in sorted(present) if _has_groups(rows, sign)), "")
    marked = {cell for cell in marked if is_number(cell)}
    grouped = {
        sign for cell in marked for sign in ".," if _GROUPED.fullmatch(cell) and _tells(cell, sign)
    }
    if len(grouped) == 1:
        sign = grouped.pop()
        return sign == ".", sign
    if not marked:
        return False, other
    points = [cell for _, cells in rows for cell in cells if "." in cell and is_number(cell)]
    if not points:
        return True, other
    by_comma, by_point = (all(map(_GROUPED.fullmatch, cells)) for cells in (marked, points))
    if by_comma != by_point:
        return by_point, "," if by_comma else "."
    return False, other


def _has_groups(rows: Sequence[tuple[int, list[str]]], sign: str) -> bool:
    """Whether a number has thousands parted by a sign that means nothing else."""
    return any(sign in cell and _GROUPED.fullmatch(cell) for _, cells in rows for cell in cells)


def _tells(cell: str, sign: str) -> bool:
    """Whether a number has its thousands parted by a sign for sure."""
    other = "," if sign == "." else "."
    return cell.count(sign) > 1 or (sign in cell and other in cell.partition(sign)[2])


def _header(
    lines: Sequence[str], separator: str | None, width: int
) -> tuple[list[str], dict[str, str]]:
    """Return names and units from what stands before the first row; none if nothing does."""
    levels = [cells for line in lines if (cells := _title_cells(line, separator, width))]
    if not levels:
        return [], {}
    units: list[str] = []
    if len(levels) > 1 and _are_units(levels[-1]):
        units = levels.pop()
    names = [name or f"column {k + 1}" for k, name in enumerate(levels[-1])]
    above = len(levels) - 2
    while len(set(names)) < len(names) and above >= 0:
        names = _qualified(names, levels[above])
        above -= 1
    counts = Counter(names)
    names = [n if counts[n] == 1 else f"{n} ({k + 1})" for k, n in enumerate(names)]
    return names, {n: u.strip("[]()<> ") for n, u in zip(names, units, strict=False) if u}


def _title_cells(line: str, separator: str | None, width: int) -> list[str]:
    """Return the cells of a line that may be a header; none if it has another width."""
    text = line.strip() if separator is None else line
    stripped = text.lstrip()
    for mark in COMMENTS:
        if stripped.startswith(mark):
            text = stripped[len(mark) :]
            break
    cells = split_line(text, separator)
    if len(cells) == width + 1 and not cells[-1]:
        cells = cells[:-1]
    if separator is None and len(cells) != width:
        glued = re.sub(r"\s+(?=[\[(<])", "", text)
        cells = next(
            (c for c in (glued.split(), re.split(r"\s{2,}|\t", text.strip())) if len(c) == width),
            [],
        )
    if len(cells) != width or sum(map(is_number, cells)) > 0.5 * width:
        return []
    return cells if any(cells) else []


def _are_units(cells: Sequence[str]) -> bool:
    """Whether all cells are units or empty, some of them units that no column is named after."""
    if not all(_UNITS.fullmatch(cell) for cell in cells):
        return False
    clear = [c for c in cells if c.strip("[]()<> ").lower() in _CLEAR_UNITS]
    return len(clear) >= 2


_CLEAR_UNITS = frozenset(
    [
        "s",
        "sec",
        "ms",
        "mm",
        "cm",
        "n",
        "nm",
        "n-m",
        "nmm",
        "n*m",
        "deg",
        "rad",
        "°",
        "rad/s",
        "deg/s",
        "m/s",
        "m/s^2",
        "m/s²",
        "degrees",
        "radians",
        "hz",
        "kgf",
        "lbf",
        "m",
    ]
)


def _qualified(names: Sequence[str], level: Sequence[str]) -> list[str]:
    """Put what a line above says in front of names; it holds for the columns to its right too."""
    current, joined = "", []
    for name, word in zip(names, level, strict=True):
        current = word or current
        joined.append(f"{current} {name}" if current else name)
    return joined
