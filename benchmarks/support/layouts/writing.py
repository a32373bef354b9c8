"""Text tables with the habits of different programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np


def write_table(
    path: Path,
    names: Sequence[str] | None,
    columns: Sequence[np.ndarray | Sequence[str]],
    *,
    separator: str = ",",
    decimal: str = ".",
    digits: int = 9,
    before: str = "",
    after_names: str = "",
    encoding: str = "utf-8",
    end: str = "",
) -> Path:
    """Write columns of numbers or words.

    Args:
        path: of the file.
        names: first line; none if None.
        columns: each (N,) or (N, K).
        separator: between cells.
        decimal: sign of decimals.
        digits: significant ones.
        before: text before the names.
        after_names: text between names and rows.
        encoding: of the file.
        end: of each row, such as a last separator.
    """
    cells: list[list[str]] = []
    for column in columns:
        array = np.asarray(column)
        array = array[:, None] if array.ndim == 1 else array
        cells += [[_cell(v, digits, decimal) for v in part] for part in array.T]
    rows = [separator.join(row) + end for row in zip(*cells, strict=True)]
    title = [] if names is None else [separator.join(names) + end]
    text = before + "\n".join([*title, *([after_names] if after_names else []), *rows]) + "\n"
    path.write_bytes(text.encode(encoding))
    return path


def _cell(value: object, digits: int, decimal: str) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)):
        return str(value)
    return f"{value:.{digits}g}".replace(".", decimal)


def axes(stem: str, letters: str = "xyz") -> list[str]:
    """Return a name per axis."""
    return [f"{stem}{letter}" for letter in letters]


def numbered(stem: str, count: int) -> list[str]:
    """Return names with numbers from zero."""
    return [f"{stem}{k}" for k in range(count)]
