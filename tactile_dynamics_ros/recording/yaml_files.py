"""Files of what is known of an object: yaml with its format in the first line."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core import reading
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
    com_inertia_jacobian,
    is_feasible,
)

LARGEST = 1e15
"""Largest number in such a file, SI: variances of what is undetermined reach 1e11 (kg^2); squares
of larger ones overflow in the sums of an estimate."""
_ROUNDING = 1e-6
"""How negative the least eigenvalue of a correlation matrix may be: one that was written with seven
digits. A covariance below that has a direction of negative variance."""
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
    if path.exists() and not _is_of_format(path, document["format"]):
        raise BadInputError(f"{path} exists and is no file of {what}; choose another path")
    with written_whole(path) as part:
        part.write_text(yaml.safe_dump(dict(document), sort_keys=False), encoding="utf-8")
    return path


def _is_of_format(path: Path, name: str) -> bool:
    """Whether a file says in its first line that it is of a format."""
    try:
        return name in reading.read_text(path)[:200]
    except BadInputError:
        return False


def read_document(path: str | Path, expected: str, name: str) -> dict[str, Any]:
    """Return the document of a file.

    Args:
        path: of the file.
        expected: what it should be, with its article, for messages.
        name: of its format.

    Raises:
        BadInputError: it cannot be read, or is of another format.
    """
    document = reading.parse_yaml(read_text(path, expected), str(path))
    if not isinstance(document, dict) or document.get("format") != name:
        raise BadInputError(f"{path}: expected {expected} (format: {name})")
    return document


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
    return reading.read_text(path, expected)


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
    if values.shape != shape or not np.all(np.abs(values) <= LARGEST):
        raise BadInputError(
            f"{file}: {key}: expected finite numbers of shape {shape}, at most {LARGEST:g}"
        )
    return values


def read_covariance(document: Mapping[str, Any], key: str, size: int, file: str | Path) -> Array:
    """Return the covariance (size, size) of an entry.

    Args:
        document: of a file.
        key: of the entry.
        size: of the covariance.
        file: that errors name.

    Raises:
        BadInputError: the entry is no such matrix, is not symmetric, or has a negative variance.
    """
    values = read_numbers(document, key, (size, size), file)
    variances = np.diag(values)
    if np.any(variances < 0.0):
        raise BadInputError(
            f"{file}: {key}: a variance is {variances.min():.4g}, expected none below zero"
        )
    scale = np.where(variances > 0.0, np.sqrt(variances), 1.0)
    correlation = values / np.outer(scale, scale)
    if not np.allclose(correlation, correlation.T, atol=_ROUNDING):
        raise BadInputError(f"{file}: {key}: is not symmetric, expected a covariance")
    if np.linalg.eigvalsh(correlation)[0] < -_ROUNDING:
        raise BadInputError(f"{file}: {key}: a combination of values has a negative variance")
    return values


def read_names(document: Mapping[str, Any], key: str, file: str | Path) -> tuple[str, ...]:
    """Return the names of an entry, none where it is missing.

    Raises:
        BadInputError: it is no list of names.
    """
    names = document.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BadInputError(f"{file}: {key}: {str(names)[:40]!r}, expected a list of names")
    return tuple(names)


def read_count(document: Mapping[str, Any], file: str | Path) -> int:
    """Return of how many recordings a file is, one where it does not say.

    Raises:
        BadInputError: that is no whole number, or a negative one.
    """
    count = document.get("recordings", 1)
    if type(count) is not int or not 0 <= count <= LARGEST:
        raise BadInputError(
            f"{file}: recordings: {str(count)[:40]!r}, expected a whole number from 0"
        )
    return count


def read_findings(document: Mapping[str, Any], file: str | Path) -> dict[str, Any]:
    """Return the effects of a file: each name with the values of its parameters.

    Raises:
        BadInputError: it is no such table.
    """
    found = document.get("effects") or {}
    if not isinstance(found, dict) or not all(
        isinstance(name, str) and isinstance(values, dict) for name, values in found.items()
    ):
        raise BadInputError(
            f"{file}: effects: {str(found)[:40]!r}, expected names with their parameters"
        )
    return found


_FORMAT = "tactile_dynamics_body"
_EXPECTED = "a URDF, or a file that `estimate --save` has written"
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def read_body(path: str | Path) -> KnownBody:
    """Read a known body.

    Args:
        path: a yaml file of `write_body`, or a URDF; with several links that have an inertia,
            "robot.urdf#link" says which.

    Raises:
        BadInputError: it cannot be read, or is no body that can exist.
    """
    file, _, link = str(path).partition("#")
    text = read_text(file, _EXPECTED)
    known = _from_urdf(text, link, str(path)) if "<" in text[:200] else _from_yaml(file)
    if not np.all(np.abs(known.phi) <= LARGEST) or not is_feasible(known.phi):
        raise BadInputError(f"{path}: no body has such mass and inertia; check units and axes")
    return known


def write_body(known: KnownBody, path: str | Path) -> Path:
    """Write a known body as yaml, over an older file of one only.

    Raises:
        BadInputError: another file is there, or it cannot be written.
    """
    body = InertialParameters.from_dynamic_parameters(known.phi)
    to_com = com_inertia_jacobian(known.phi)
    std = np.sqrt(np.diag(to_com @ known.covariance @ to_com.T))
    document = {
        "format": _FORMAT,
        "source": known.name,
        "recordings": known.recordings,
        "mass_kg": {"value": body.mass, "std": float(std[0])},
        "com_m": {"value": body.com.tolist(), "std": std[1:4].tolist()},
        "undetermined": list(known.undetermined),
        "effects": known.effects,
        "dynamic_parameters": known.phi.tolist(),
        "covariance": known.covariance.tolist(),
    }
    if known.lasting is not None:
        document["lasting_covariance"] = known.lasting.tolist()
    return write_document(document, path, "a body")


def _from_yaml(file: str) -> KnownBody:
    document = read_document(file, _EXPECTED, _FORMAT)
    lasting = "lasting_covariance"
    return KnownBody(
        read_numbers(document, "dynamic_parameters", (10,), file),
        read_covariance(document, "covariance", 10, file),
        file,
        read_names(document, "undetermined", file),
        read_findings(document, file),
        read_count(document, file),
        read_covariance(document, lasting, 10, file) if lasting in document else None,
    )


def _from_urdf(text: str, link: str, name: str) -> KnownBody:
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise BadInputError(f"{name}: no XML: {error}") from error
    blocks = {
        str(one.get("name")): one.find("inertial")
        for one in root.iter("link")
        if one.find("inertial") is not None
    }
    if root.tag == "inertial":
        blocks = {link: root}
    if not link and len(blocks) == 1:
        [link] = blocks
    block = blocks.get(link)
    if block is None:
        raise BadInputError(
            f"{name}: expected one link with an inertial block, or FILE#LINK; found "
            f"{', '.join(blocks) or 'none'}"
        )
    try:
        return KnownBody.exact(_body_of(block), name)
    except (AttributeError, KeyError, ValueError) as error:
        raise BadInputError(
            f"{name}: the inertial block of {link or 'the file'} has no mass or no inertia"
        ) from error


def _body_of(block: ElementTree.Element) -> InertialParameters:
    """Return the body of an inertial block, in the axes of its link."""
    origin = block.find("origin")
    place = {} if origin is None else origin.attrib
    com = np.array(place.get("xyz", "0 0 0").split(), dtype=float)
    angles = np.array(place.get("rpy", "0 0 0").split(), dtype=float)
    mass, moments = block.find("mass"), block.find("inertia")
    if mass is None or moments is None:
        raise KeyError("mass or inertia")
    inertia = np.zeros((3, 3))
    for name in _MOMENTS:
        i, j = ("xyz".index(axis) for axis in name[1:])
        inertia[i, j] = inertia[j, i] = float(moments.attrib[name])
    turn = Rotation.from_euler("xyz", angles).as_matrix()
    return InertialParameters(float(mass.attrib["value"]), com, turn @ inertia @ turn.T)
