"""Files of what is known of an object: yaml with its format in the first line."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError

Array = NDArray[np.float64]


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
    draft = path.with_name(path.name + ".part")
    try:
        draft.write_text(yaml.safe_dump(dict(document), sort_keys=False), encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise BadInputError(f"{path} cannot be written: {error.strerror}") from error
    return path


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
