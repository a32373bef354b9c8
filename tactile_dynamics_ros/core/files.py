"""Files and folders that are written whole or not at all; dataclasses of arrays in npz."""

from __future__ import annotations

import errno
import json
import os
import stat
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError, refuse_existing
from tactile_dynamics_ros.core.reading import open_arrays

_ADVICE = {
    errno.ENOSPC: "free space there or choose another path",
    errno.EDQUOT: "free space there or choose another path",
    errno.EROFS: "choose a path on a disk that can be written",
    errno.EACCES: "choose a path that you may use",
    errno.EPERM: "choose a path that you may use",
    errno.ENOENT: "check the path",
}
"""What a person can do where the system refuses a file, by the number of its error."""


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A path to write a file or folder to, which takes the place of `path` at the end.

    If writing fails or is interrupted, an older `path` stays as it is and nothing new is left.

    Args:
        path: what is to be written; folders above it are made.

    Raises:
        BadInputError: it cannot be written, as on a full disk.
    """
    made = [folder for folder in path.absolute().parents if not folder.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=path.parent) as scratch:
            part = Path(scratch) / path.name
            yield part
            os.replace(part, path)
    except BaseException as error:
        for folder in made:
            with suppress(OSError):  # something else may lie in it by now
                folder.rmdir()
        if isinstance(error, OSError):
            raise BadInputError(f"{path} cannot be written: {reason_of(error)}") from error
        raise


def new_file(path: str | Path) -> Path:
    """Return the path of a file that is not there yet.

    Raises:
        BadInputError: it is there, so that something would be lost.
    """
    path = Path(path)
    refuse_existing(path)
    return path


def own_folder() -> Path:
    """Folder of this user for what outlives a process, but not the machine: nobody else can write.

    It lies in $XDG_RUNTIME_DIR, or else in the folder for temporary files, where others could have
    made one of its name.

    Raises:
        BadInputError: it is a link, belongs to somebody else, or is open to others.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and os.access(runtime, os.W_OK | os.X_OK):
        folder = Path(runtime) / "tactile_dynamics"
    else:
        folder = Path(tempfile.gettempdir()) / f"tactile_dynamics_{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise BadInputError(f"{folder} cannot be made: {reason_of(error)}") from error
    mine = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    if not mine or found.st_mode & 0o077:
        raise BadInputError(
            f"{folder} is not a folder of yours that others cannot enter; remove it, or set "
            "XDG_RUNTIME_DIR to such a folder"
        )
    return folder


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write arrays as a compressed npz file of exactly this name.

    Raises:
        BadInputError: it cannot be written.
    """
    with written_whole(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def reason_of(error: OSError) -> str:
    """Return what the system refused and what to do, with the file that it names."""
    reason = error.strerror or str(error) or type(error).__name__
    where = "" if error.filename is None else f" ({error.filename})"
    advice = _ADVICE.get(error.errno or 0)
    return f"{reason}{where}" + (f"; {advice}" if advice else "")


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
