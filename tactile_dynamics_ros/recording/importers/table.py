"""Tables of numbers in text files with one line of column names."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError

Array = NDArray[np.float64]

SEPARATORS = (",", ";", "\t")


@dataclass(frozen=True)
class Table:
    """Columns of numbers by name.

    Attributes:
        source: file, for messages to the user.
        names: K column names.
        values: (N, K); an empty cell is NaN.
    """

    source: str
    names: tuple[str, ...]
    values: Array

    def columns(self, *names: str) -> Array:
        """Return (N, len(names)) values.

        Raises:
            BadInputError: a column is not there.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise BadInputError(
                f"{self.source}: no column '{missing[0]}'; it has {', '.join(self.names)}"
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
    """Read a table whose first line names its columns; comma, semicolon, tab or blanks separate.

    A path below a tar archive, such as ``slides.tar.gz/mat1_1_cw.csv``, names a member of it.

    Raises:
        BadInputError: the file is missing or not such a table.
    """
    text = _read_text(path)
    header, _, body = text.partition("\n")
    separator = next((s for s in SEPARATORS if s in header), None)
    names = [name.strip().strip('"') for name in header.split(separator)]
    names = names[:-1] if names and not names[-1] else names
    if not names or not body.strip():
        raise BadInputError(f"{path}: expected a line of column names and rows of numbers")
    try:
        values = _parse(body, separator, range(len(names)))
    except ValueError as error:
        raise BadInputError(f"{path}: {_first_line(error)}; expected rows of numbers") from error
    return Table(str(path), tuple(names), values)


def _parse(body: str, separator: str | None, used: Sequence[int]) -> Array:
    """Return the numbers of the rows; the slower reader is for rows with empty cells."""
    try:
        return np.loadtxt(io.StringIO(body), delimiter=separator, usecols=used, ndmin=2)
    except ValueError:
        rows = np.genfromtxt(io.StringIO(body), delimiter=separator, usecols=used)
        values = np.asarray(rows, dtype=np.float64).reshape(-1, len(used))
        if np.isnan(values).all():
            raise
        return values


def _read_text(path: Path) -> str:
    """Return the text of a file or of a member of a tar archive."""
    try:
        if path.parent.is_file() and tarfile.is_tarfile(path.parent):
            return _read_member(path)
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise BadInputError(f"{path} cannot be read: {reason}") from error


def _read_member(path: Path) -> str:
    """Return the text of the archive member with the path's name."""
    with tarfile.open(path.parent) as archive:
        for member in archive:
            if Path(member.name).name == path.name:
                content = archive.extractfile(member)
                return content.read().decode("utf-8-sig") if content else ""
    raise BadInputError(f"{path.parent} holds no {path.name}")


def _first_line(error: Exception) -> str:
    """Return the first line of an error's text."""
    return str(error).splitlines()[0].rstrip(".;")
