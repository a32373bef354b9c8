"""Files of what is known of an object: yaml with its format in the first line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file
from tactile_dynamics_ros.core.files import written_whole

Array = NDArray[np.float64]

_RECORDINGS = (".mcap", ".db3", ".bag")
"""Endings of recordings, which are given by mistake where what was saved of one is meant."""


def write_document(document: Mapping[str, Any], path: str | Path, what: str) -> Path:
    """Write a document, whole or not at all, over an older file of its format only.

    Args:
        document: its first entry is "format".
        path: to write to.
        what: it is a file of, with its article.

    Raises:
        BadInputError: another file is there, or it cannot be written.
    """
    path = Path(path)
    if path.exists() and document["format"] not in path.read_text(errors="replace")[:200]:
        raise BadInputError(f"{path} exists and is no file of {what}; choose another path")
    with written_whole(path) as part:
        part.write_text(yaml.safe_dump(dict(document), sort_keys=False), encoding="utf-8")
    return path


def read_text(path: str | Path, expected: str) -> str:
    """Return the text of a file.

    Args:
        path: of the file.
        expected: what it should be, with its article, for messages.

    Raises:
        BadInputError: it is a recording or another folder, is no text, or cannot be read.
    """
    path = Path(path)
    if path.suffix in _RECORDINGS or (path / "metadata.yaml").is_file():
        raise BadInputError(
            f"{path} is a recording, expected {expected}; `tactile-dynamics estimate {path} --save "
            "FILE` makes one"
        )
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise BadInputError(f"{path} is no text, expected {expected}") from error
    except OSError as error:
        raise BadInputError(
            f"{path} cannot be read: {error.strerror}, expected {expected}{nearest_file(path)}"
        ) from error


def read_numbers(
    document: Mapping[str, Any], key: str, shape: tuple[int, ...], file: str | Path
) -> Array:
    """Return the finite numbers of an entry.

    Args:
        document: of a file.
        key: of the entry.
        shape: that it must have.
        file: that errors name.

    Raises:
        BadInputError: the entry is missing, is of another shape, or is no such numbers.
    """
    try:
        values = np.array(document[key], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInputError(f"{file}: {key}: expected numbers of shape {shape}") from error
    if values.shape != shape or not np.all(np.isfinite(values)):
        raise BadInputError(f"{file}: {key}: expected finite numbers of shape {shape}")
    return values
