"""Tables of numbers as loggers, robots, spreadsheets, numpy and MATLAB write them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tactile_dynamics_ros.recording.importers.tables.arrays import ARRAY_SUFFIXES, read_arrays
from tactile_dynamics_ros.recording.importers.tables.table import Table, read_table

__all__ = ["ARRAY_SUFFIXES", "Table", "read_any_table", "read_table", "read_tables"]


def read_tables(path: Path) -> list[Table]:
    """Return the tables of a file: one of a text, one for each length of arrays.

    Raises:
        BadInputError: it cannot be read, or holds none.
    """
    return read_arrays(path) if path.suffix in ARRAY_SUFFIXES else [read_table(path)]


def read_any_table(path: Path, columns: Iterable[str]) -> Table:
    """Return the table of a file that has given columns, the longest if several or none have.

    Raises:
        BadInputError: it cannot be read, or holds no table.
    """
    wanted, tables = set(columns), read_tables(path)
    return next((table for table in tables if wanted <= set(table.names)), tables[0])
