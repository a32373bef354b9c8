"""Tables of numbers in text files, in whatever encoding; bad rows are named."""

from __future__ import annotations

import codecs
import tarfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from lzma import LZMAError
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import require_file
from tactile_dynamics_ros.recording.importers.tables.layout import (
    MISSING,
    Layout,
    find_layout,
    is_number,
)

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Marks at the beginning of a file and the encoding they stand for; 32 bits before 16, since one
mark begins with the other."""
_FREE, _MOST_EXPANSION = 8 << 20, 200
"""Bytes to which a table in an archive may expand in any case, and for each byte of the archive
beyond: numbers as text shrink to a third, columns of one number to a hundredth."""
_LOOKED_AT = 4096
"""Bytes at the beginning in which zero bytes are counted."""
_ZEROS = 0.3
"""Share of zero bytes from which a text without a mark is UTF-16: half of all bytes of ASCII text
in it, none in others."""


def read_text(path: Path) -> str:
    """Return the text of a file, or of a member of a tar archive below which the path leads.

    Raises:
        BadInputError: it cannot be read, or is no text.
    """
    try:
        inside = path.parent.is_file() and tarfile.is_tarfile(path.parent)
        content = _read_member(path) if inside else require_file(path, "a table").read_bytes()
    except (OSError, EOFError, tarfile.TarError, zlib.error, LZMAError) as error:
        reason = getattr(error, "strerror", None) or error or "no archive"
        raise BadInputError(f"{path} cannot be read: {reason}") from error
    return decode_text(content, str(path))


def decode_text(content: bytes, source: str) -> str:
    """Return the text behind bytes; UTF-8 and UTF-16 are told apart, else it is Latin-1.

    Raises:
        BadInputError: there are bytes that no text has.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return content.decode(encoding, errors="replace")
    head = content[:_LOOKED_AT]
    if head and head.count(0) > _ZEROS * len(head):
        odd = sum(byte == 0 for byte in head[1::2])
        little = 2 * odd > head.count(0)
        return content.decode("utf-16-le" if little else "utf-16-be", errors="replace")
    if 0 in head:
        raise BadInputError(f"{source} cannot be read: not a text file")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _read_member(path: Path) -> bytes:
    """Return the archive member with the path's name."""
    with tarfile.open(path.parent) as archive:
        for member in archive:
            if Path(member.name).name == path.name:
                content = archive.extractfile(member)
                if content is None:
                    return b""
                allowed = _FREE + _MOST_EXPANSION * path.parent.stat().st_size
                found = content.read(allowed + 1)
                if len(found) > allowed:
                    raise BadInputError(
                        f"{path} expands to more than {allowed >> 20} MB, {_MOST_EXPANSION} times "
                        "the size of its archive and more"
                    )
                return found
    raise BadInputError(f"{path.parent} holds no {path.name}")


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
