"""Files of known bodies: yaml with covariance, or the inertial block of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    is_feasible,
)
from tactile_dynamics_ros.core.rigid_body.known_body import KnownBody
from tactile_dynamics_ros.recording.yaml_files import (
    LARGEST,
    read_count,
    read_covariance,
    read_document,
    read_findings,
    read_names,
    read_numbers,
    read_text,
    write_document,
)

Array = NDArray[np.float64]

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
            f"{name}: the inertial block of {link or 'the file'} lacks mass or inertia"
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
