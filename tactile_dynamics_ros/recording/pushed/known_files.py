"""Files of pushed objects that are known, as yaml."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.known import KNOWN_NAMES, KnownPushed
from tactile_dynamics_ros.recording.yaml_files import read_numbers, read_text, write_document

_FORMAT = "tactile_dynamics_pushed"
_EXPECTED = "a file that `estimate --model pushed --save` has written"


def read_known(path: str | Path) -> KnownPushed:
    """Read a known object.

    Raises:
        BadInputError: it cannot be read, or is no file of `write_known`.
    """
    text = read_text(path, _EXPECTED)
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise BadInputError(f"{path}: no yaml: {error}") from error
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise BadInputError(f"{path}: expected {_EXPECTED} (format: {_FORMAT})")
    values = read_numbers(document, "values", (4,), path)
    covariance = read_numbers(document, "covariance", (4, 4), path)
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
    return write_document(document, path, "an object")
