"""The one door through which files of people are read: regular files, of bounded size and depth."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file

LARGEST_TEXT = 16_000_000
"""Bytes of a file that is read as one text (yaml, JSON, URDF). The largest that comes with robots
and with this package has 0.3 MB; 16 MB of JSON become 0.3 GB of memory, and take seconds."""
LARGEST_YAML = 1_000_000
"""Bytes of a yaml text: it is parsed at about 1 MB/s, and the largest that this package writes, an
object with its covariances, has 10 kB."""
MOST_NODES = 200_000
"""Values of a yaml text once its aliases are written out: nine lines with nine aliases each stand
for a billion. A text of `LARGEST_YAML` without aliases has about so many."""
DEEPEST = 50
"""Levels of brackets or indents in yaml and JSON: the files of this package have five, and Python
ends at about three hundred."""

LARGEST_ARRAYS = 400_000_000
"""Bytes of the arrays of an npz file once they are expanded: a recording of 100 Hz for 40 hours, or
clouds of 16 million points. Zeros shrink to a thousandth in such files."""
LONGEST_NUMBER = 300
"""Characters of a number in yaml: the longest that is meant, a float written out, has 25. Numbers
in base 60 (1:30:00) take a time that grows with the square of their length."""
_NUMBER = re.compile(r"[\d+\-_:.]+")
"""Of what characters such numbers are made; words beside them are left alone."""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Reads plain values only, in C where PyYAML was built with it, which is ten times as fast."""


def require_file(path: str | Path, expected: str = "a file") -> Path:
    """Return the path of a regular file; nothing is opened, so that a pipe does not block.

    Args:
        path: of the file.
        expected: what it should be, with its article, for messages.

    Raises:
        BadInputError: nothing is there, or a folder, a pipe or a device is.
    """
    path = Path(path)
    try:
        if path.is_file():
            return path
        there = path.exists()
    except (OSError, ValueError) as error:  # a name that is too long, or has a zero byte
        raise BadInputError(f"{_shown(path)} cannot be read: {_reason(error)}") from error
    if not there:
        raise BadInputError(f"{path}: no such file, expected {expected}{nearest_file(path)}")
    kind = "a folder" if path.is_dir() else "a pipe or device, not a regular file"
    raise BadInputError(f"{path} is {kind}, expected {expected}")


def read_text(path: str | Path, expected: str = "a text file") -> str:
    """Return the text of a regular file in UTF-8.

    Args:
        path: of the file.
        expected: what it should be, with its article, for messages.

    Raises:
        BadInputError: it is no regular file, cannot be read, is too large, or is no text.
    """
    path = require_file(path, expected)
    try:
        with path.open("rb") as stream:
            content = stream.read(LARGEST_TEXT + 1)
        if len(content) > LARGEST_TEXT:
            raise BadInputError(f"{path} has more than {LARGEST_TEXT} bytes, expected {expected}")
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise BadInputError(f"{path} is no text, expected {expected}") from error
    except OSError as error:
        raise BadInputError(
            f"{path} cannot be read: {error.strerror or error}, expected {expected}"
        ) from error


def read_yaml(path: str | Path, expected: str = "a yaml file") -> Any:
    """Return the content of a yaml file.

    Args:
        path: of the file.
        expected: what it should be, with its article, for messages.

    Raises:
        BadInputError: see `read_text` and `parse_yaml`.
    """
    return parse_yaml(read_text(path, expected), str(path))


def parse_yaml(text: str, where: str) -> Any:
    """Return the content of a yaml text.

    Args:
        text: in yaml, of at most `LARGEST_YAML` bytes, `MOST_NODES` values and `DEEPEST` levels.
        where: it stands, for messages.

    Raises:
        BadInputError: it is no yaml, or beyond one of these limits.
    """
    if len(text) > LARGEST_YAML:
        raise BadInputError(f"{where}: {len(text)} characters of yaml, at most {LARGEST_YAML}")
    try:
        _check_extent(yaml.parse(text, Loader=_LOADER), where)
        return yaml.load(text, Loader=_LOADER)  # noqa: S506 - a safe loader, in C where there is one
    except BadInputError:
        raise
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" line {mark.line + 1}:" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise BadInputError(f"{where}:{line} not valid yaml: {problem}") from error
    except Exception as error:  # the loader raises whatever dates, numbers and keys raise
        raise BadInputError(f"{where}: not valid yaml: {_reason(error)}") from error


def read_json(path: str | Path, expected: str = "a JSON file") -> Any:
    """Return the content of a JSON file.

    Args:
        path: of the file.
        expected: what it should be, with its article, for messages.

    Raises:
        BadInputError: see `read_text`; or it is no JSON, or too deep.
    """
    text = read_text(path, expected)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path}: no JSON: {error}, expected {expected}") from error


@contextmanager
def open_arrays(path: str | Path, expected: str = "arrays in .npz") -> Iterator[Any]:
    """The arrays of an npz file by name; what goes wrong with them inside is said in one line.

    Args:
        path: of the file.
        expected: what it should be, with its article, for messages.

    Raises:
        BadInputError: it is no such file, expands beyond `LARGEST_ARRAYS`, or misses an array.
    """
    path = require_file(path, expected)
    try:
        with zipfile.ZipFile(path) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > LARGEST_ARRAYS:
            raise BadInputError(f"{path}: {size} bytes of arrays, at most {LARGEST_ARRAYS}")
        with np.load(path, allow_pickle=False) as arrays:
            yield arrays
    except BadInputError:
        raise
    except Exception as error:  # readers of archives and headers raise whatever they meet
        raise BadInputError(f"{path}: {_reason(error)}, expected {expected}") from error


def read_mesh(path: str | Path, expected: str = "a mesh") -> Any:
    """Return the triangles of a mesh file as a `trimesh.Trimesh`, in the unit of the file.

    Args:
        path: of an STL, OBJ, PLY, OFF ... file.
        expected: what it should be, with its article, for messages.

    Raises:
        BadInputError: it is no regular file, or holds no triangles.
    """
    import trimesh

    path = require_file(path, expected)
    try:
        mesh = trimesh.load(path, force="mesh")
    except Exception as error:  # so do its readers
        raise BadInputError(f"{path}: {_reason(error)}, expected {expected}") from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise BadInputError(f"{path}: holds no triangles, expected {expected}")
    if not np.isfinite(mesh.vertices).all():
        raise BadInputError(f"{path}: a corner is not finite, expected {expected}")
    return mesh


def _check_extent(events: Iterator[Any], where: str) -> None:
    """Count the values of a yaml text as if its aliases were written out.

    Raises:
        BadInputError: they are too many or too deep, or an alias stands inside what it names.
    """
    named: dict[str, int] = {}
    open_nodes: list[tuple[str | None, int]] = []
    total = 0
    for event in events:
        size = 1
        if isinstance(event, yaml.CollectionStartEvent):
            open_nodes.append((event.anchor, total))
            if len(open_nodes) > DEEPEST:
                line = event.start_mark.line + 1
                raise BadInputError(f"{where}: line {line}: more than {DEEPEST} levels deep")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_nodes.pop()
            if anchor is not None:
                named[anchor] = total + 1 - before
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in named:
                line = event.start_mark.line + 1
                raise BadInputError(f"{where}: line {line}: alias '{event.anchor}' is not known")
            size = named[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            if event.anchor is not None:
                named[event.anchor] = 1
            if len(event.value) > LONGEST_NUMBER and _NUMBER.fullmatch(event.value):
                line = event.start_mark.line + 1
                raise BadInputError(f"{where}: line {line}: a number of {len(event.value)} digits")
        else:
            continue
        total += size
        if total > MOST_NODES:
            raise BadInputError(f"{where}: more than {MOST_NODES} values with aliases written out")


def _reason(error: Exception) -> str:
    text = str(getattr(error, "strerror", None) or error).strip()
    return text.splitlines()[0] if text else type(error).__name__


def _shown(path: Path, length: int = 80) -> str:
    """Return a path, cut where it is so long that a line could not be read."""
    text = str(path)
    return repr(text if len(text) <= length else text[:length] + "...")[1:-1]
