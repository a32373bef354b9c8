"""Dataclasses of arrays in npz files, which hold data only: reading one runs nothing of its own."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import write_arrays
from tactile_dynamics_ros.core.reading import open_arrays

_TREE = "tree"
"""Name of the array that holds the structure, as JSON; the others are numbered."""


def write_records(records: Sequence[Any], path: Path) -> None:
    """Write dataclasses of arrays, numbers, texts, lists, and other such dataclasses.

    Raises:
        BadInputError: the file cannot be written.
    """
    arrays: dict[str, Any] = {}
    tree = _packed(list(records), arrays)
    write_arrays(path, {_TREE: np.array(json.dumps(tree)), **arrays})


def read_records(path: Path, kinds: Iterable[type]) -> list[Any]:
    """Return what `write_records` wrote.

    Args:
        path: of the file.
        kinds: dataclasses that may be in it; no other is made.

    Raises:
        BadInputError: it is no such file.
    """
    known = {kind.__name__: kind for kind in kinds}
    with open_arrays(path, "records of a simulation") as arrays:
        found = _unpacked(json.loads(str(arrays[_TREE])), arrays, known)
    if not isinstance(found, list):
        raise BadInputError(f"{path}: holds no list of records")
    return found


def _packed(value: Any, arrays: dict[str, Any]) -> Any:
    """Return a value as JSON has it; arrays are put aside and numbered."""
    if isinstance(value, np.ndarray):
        name = str(len(arrays))
        arrays[name] = value
        return {"array": name}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, list):
        return [_packed(item, arrays) for item in value]
    if isinstance(value, tuple):
        return {"tuple": [_packed(item, arrays) for item in value]}
    if is_dataclass(value):
        parts = {f.name: _packed(getattr(value, f.name), arrays) for f in fields(value) if f.init}
        return {"kind": type(value).__name__, "parts": parts}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"{type(value).__name__} is neither a record nor an array nor a number")


def _unpacked(tree: Any, arrays: Any, kinds: dict[str, type]) -> Any:
    """Return the value of a tree."""
    if isinstance(tree, list):
        return [_unpacked(item, arrays, kinds) for item in tree]
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return arrays[tree["array"]]
    if "tuple" in tree:
        return tuple(_unpacked(item, arrays, kinds) for item in tree["tuple"])
    parts = {name: _unpacked(part, arrays, kinds) for name, part in tree["parts"].items()}
    return kinds[tree["kind"]](**parts)
