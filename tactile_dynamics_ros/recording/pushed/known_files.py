"""Files of pushed objects that are known, as yaml."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file
from tactile_dynamics_ros.core.planar.known import KNOWN_NAMES, KnownPushed

_FORMAT = "tactile_dynamics_pushed"


def read_known(path: str | Path) -> KnownPushed:
    """Read a known object.

    Raises:
        BadInputError: it cannot be read, or is no file of `write_known`.
    """
    try:
        document = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(
            f"{path} cannot be read: {error.strerror}" + nearest_file(path)
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path}: no yaml: {error}") from error
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise BadInputError(
            f"{path}: expected a file that `estimate --model pushed --save` has written "
            f"(format: {_FORMAT})"
        )
    values, covariance = (_array(document, key, path) for key in ("values", "covariance"))
    if values.shape != (4,) or covariance.shape != (4, 4):
        raise BadInputError(f"{path}: expected 4 values and their covariance (4, 4)")
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        raise BadInputError(f"{path}: covariance is none: expected it to be positive definite")
    return KnownPushed(
        values,
        covariance,
        str(path),
        tuple(document.get("undetermined", ())),
        int(document.get("recordings", 1)),
    )


def write_known(known: KnownPushed, path: str | Path) -> Path:
    """Write a known object, over an older file of one only.

    Raises:
        BadInputError: another file is there, or it cannot be written.
    """
    path = Path(path)
    if path.exists() and _FORMAT not in path.read_text(errors="replace")[:200]:
        raise BadInputError(f"{path} exists and is no file of an object; choose another path")
    document = {
        "format": _FORMAT,
        "source": known.name,
        "recordings": known.recordings,
        "names": list(KNOWN_NAMES),
        "values": known.values.tolist(),
        "std": np.sqrt(np.diag(known.covariance)).tolist(),
        "undetermined": list(known.undetermined),
        "covariance": known.covariance.tolist(),
    }
    draft = path.with_name(path.name + ".part")
    try:
        draft.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise BadInputError(f"{path} cannot be written: {error.strerror}") from error
    return path


def _array(document: dict[str, Any], key: str, path: str | Path) -> Any:
    try:
        found = np.array(document[key], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInputError(f"{path}: {key}: expected numbers") from error
    if not np.all(np.isfinite(found)):
        raise BadInputError(f"{path}: {key}: expected finite numbers")
    return found
