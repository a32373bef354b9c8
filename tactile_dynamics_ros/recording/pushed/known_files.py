"""Files of pushed objects that are known, as yaml."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.known import KNOWN_NAMES, KnownPushed
from tactile_dynamics_ros.recording.yaml_files import (
    read_count,
    read_covariance,
    read_document,
    read_names,
    read_numbers,
    write_document,
)

_FORMAT = "tactile_dynamics_pushed"
_EXPECTED = "a file that `estimate --model pushed --save` has written"
_LARGEST_VALUE = 30.0
"""Largest ln force, ln mass or coordinate of a centre, ln N, ln kg or m: e^30 kg is a mountain; the
exponentials of larger ones overflow in sums."""


def read_known(path: str | Path) -> KnownPushed:
    """Read a known object.

    Raises:
        BadInputError: it cannot be read, or is no file of `write_known`.
    """
    document = read_document(path, _EXPECTED, _FORMAT)
    values = read_numbers(document, "values", (4,), path)
    if np.any(np.abs(values) > _LARGEST_VALUE):
        raise BadInputError(f"{path}: values: no object is like that, expected {KNOWN_NAMES}")
    covariance = read_covariance(document, "covariance", 4, path)
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        raise BadInputError(f"{path}: covariance: singular, expected it to be positive definite")
    return KnownPushed(
        values,
        covariance,
        str(path),
        read_names(document, "undetermined", path),
        read_count(document, path),
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
