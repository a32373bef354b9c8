"""Tables from arrays that numpy (.npy, .npz) and MATLAB (.mat) save."""

from __future__ import annotations

import math
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import LARGEST_ARRAYS, open_arrays, require_file
from tactile_dynamics_ros.recording.importers.tables.table import Table

ARRAY_SUFFIXES = (".npy", ".npz", ".mat")
"""Ends of the names of files that hold arrays."""
_FEWEST_ROWS = 3
"""Rows from which arrays are a table: fewer are parameters beside it. Static poses need three."""
_MOST_COLUMNS = 64
"""Numbers in a row of one array that become columns; a matrix has 16, images have thousands."""
_HDF5 = b"MATLAB 7.3"
"""Begin of files that MATLAB saves with -v7.3, which are HDF5."""
_DAMAGE = (OSError, EOFError, ValueError, TypeError, KeyError, NotImplementedError, MemoryError)
"""What numpy and scipy raise on files that they cannot read."""


def read_arrays(path: Path) -> list[Table]:
    """Return a table of all arrays of each length, those of most rows first.

    The columns of `force` (N, 3) are `force_x` to `force_z`, those of wider arrays and of matrices,
    row by row, `pose_0`, `pose_1`, ...; a file of one table without names has columns 1, 2, ...

    Raises:
        BadInputError: it cannot be read, or no array has rows.
    """
    try:
        named = {name: np.asarray(value) for name, value in _arrays(path)}
    except (*_DAMAGE, zlib.error, struct.error) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise BadInputError(f"{path} cannot be read: {reason}") from error
    numeric = {name: _rows_first(v, named) for name, v in named.items() if v.dtype.kind in "fiub"}
    by_length: dict[int, list[tuple[str, Array]]] = defaultdict(list)
    for name, value in numeric.items():
        if value.ndim and len(value) >= _FEWEST_ROWS:
            columns = value.reshape(len(value), -1).astype(np.float64)
            if 0 < columns.shape[1] <= _MOST_COLUMNS:
                by_length[len(value)].append((name, columns))
    if not by_length:
        raise BadInputError(f"{path}: no array has rows of numbers; there are {', '.join(named)}")
    return [_table(path, by_length[length]) for length in sorted(by_length, reverse=True)]


def _table(path: Path, arrays: list[tuple[str, Array]]) -> Table:
    """Return the table of arrays of one length."""
    values = np.concatenate([columns for _, columns in arrays], axis=1)
    has_names = len(arrays) > 1
    names = [str(k + 1) for k in range(values.shape[1])]
    if has_names:
        names = [name for name, columns in arrays for name in _names(name, columns.shape[1])]
    words = f"arrays {', '.join(name for name, _ in arrays if name)}"
    return Table(
        str(path),
        tuple(names),
        np.where(np.abs(values) < np.inf, values, np.nan),
        layout=words if has_names else "one array",
        has_header=has_names,
    )


def _names(name: str, width: int) -> list[str]:
    if width == 1:
        return [name]
    ends = "xyz" if width == len("xyz") else [str(k) for k in range(width)]
    return [f"{name}_{end}" for end in ends]


def _rows_first(value: Array, named: Mapping[str, Array]) -> Array:
    """Return an array (N, ...) with samples along the first axis: MATLAB has them along the last.

    Args:
        value: (N, ...), or (..., N).
        named: all arrays of the file.
    """
    lengths = [max(v.shape) for v in named.values() if v.dtype.kind in "fiub" and v.ndim]
    usual = max(set(lengths), key=lambda n: (lengths.count(n), n), default=0)
    if value.ndim > 1 and value.shape[0] != usual and value.shape[-1] == usual:
        return np.moveaxis(value, -1, 0)
    if value.ndim == len("xy") and value.shape[0] == 1:
        return value.T
    return value


def _arrays(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield names and arrays of a file; structures are taken apart."""
    require_file(path, "arrays")
    if path.suffix == ".npz":
        with open_arrays(path) as arrays:
            for name in arrays:
                yield from _parts(name, arrays[name])
    elif path.suffix == ".npy":
        _refuse_large(path, path.stat().st_size)
        yield from _parts("", np.load(path, allow_pickle=False))
    else:
        yield from _matlab(path)


def _matlab(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield names and arrays of a file of MATLAB up to version 7.

    Raises:
        BadInputError: it is of version 7.3.
    """
    from scipy.io import loadmat, whosmat

    with path.open("rb") as stream:
        if stream.read(len(_HDF5)) == _HDF5:
            raise BadInputError(
                f"{path} was saved with -v7.3: save it with -v7, or read it with h5py and hand the "
                "arrays to Recording.from_arrays"
            )
    _refuse_large(path, 8 * sum(math.prod(shape) for _, shape, _ in whosmat(path)))
    for name, value in loadmat(path, simplify_cells=True).items():
        if not name.startswith("__"):
            yield from _parts(name, value)


def _refuse_large(path: Path, size: int) -> None:
    if size > LARGEST_ARRAYS:
        raise BadInputError(f"{path}: {size} bytes of arrays, at most {LARGEST_ARRAYS}")


def _parts(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield an array, or the fields of a structure under names with a dot."""
    if isinstance(value, Mapping):
        fields = value.items()
    elif isinstance(value, np.ndarray) and value.dtype.names:
        fields = ((key, value[key]) for key in value.dtype.names)
    else:
        yield name, value
        return
    for key, part in fields:
        yield from _parts(f"{name}.{key}" if name else str(key), part)
