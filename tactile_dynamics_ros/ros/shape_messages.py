"""Shapes of what stands on a table as messages and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import (
    matrix_to_quaternion,
    quaternion_to_matrix,
)
from tactile_dynamics_ros.core.shape.superquadric.recovery import Recovery
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.core.shape.superquadric.words import describe
from tactile_dynamics_ros.ros.conversions import MessageError, header
from tactile_dynamics_ros.ros.diagnostics import status_message, status_values
from tactile_dynamics_ros.ros.names import OBJECT_SHAPE
from tactile_dynamics_ros.ros.wire import AnyStamp

Array = NDArray[np.float64]

WORLD = "world"
STDS = {
    "semi_axes_m_std": ("ax", "ay", "az"),
    "exponents_std": ("e1", "e2"),
    "taper_std": ("k1", "k2"),
    "position_m_std": ("x", "y", "z"),
    "yaw_rad_std": ("yaw",),
}
"""Key of a message, and the names that `Recovery.std` has for its numbers. Where the part stands on
a table of known height, its z is the table's plus a_z: the spread of a_z stands for it."""
LENGTHS = {
    "semi_axes_m": 3,
    "exponents": 2,
    "taper": 2,
    "position_m": 3,
    "quaternion": 4,
    **{key: len(names) for key, names in STDS.items()},
}
"""How many numbers each key has."""


@dataclass(frozen=True)
class Link:
    """A part as `/object/shape` tells it.

    Attributes:
        name: link_1, link_2 ..; the largest first.
        shape: its surface; the pose is that of its frame in `world`.
        std: standard deviations by coordinate, as `Recovery.std` names them.
        words: the part in plain words.
    """

    name: str
    shape: Superquadric
    std: Mapping[str, float]
    words: str

    @property
    def footprint(self) -> Array:
        """(K, 2) outline on the support, m, anticlockwise, in the link's frame."""
        return local_footprint(self.shape)


def local_footprint(shape: Superquadric) -> Array:
    """Return the outline (K, 2), m, of a part in its own frame."""
    flat = shape.footprint()
    return shape.to_body(np.column_stack([flat, np.full(len(flat), shape.pose[2, 3])]))[:, :2]


def shape_message(parts: Sequence[Recovery], stamp: AnyStamp | float) -> DiagnosticArray:
    """Return `/object/shape` of the parts of an object, the largest first.

    Args:
        parts: as they were recovered.
        stamp: of the newest measurement that they come from.
    """
    message = DiagnosticArray(header=header(stamp, WORLD))
    message.status = [_status(f"link_{k}", part) for k, part in enumerate(parts, 1)]
    return message


def _status(name: str, part: Recovery) -> DiagnosticStatus:
    shape, std = part.shape, part.std
    known = {"z": std["az"], "yaw": std.get("turn_z", 0.0), **std}
    numbers: dict[str, Sequence[float]] = {
        "semi_axes_m": shape.semi_axes,
        "exponents": shape.exponents,
        "taper": shape.taper,
        "position_m": shape.pose[:3, 3],
        "quaternion": matrix_to_quaternion(shape.pose[:3, :3]),
        **{key: [known[one] for one in names] for key, names in STDS.items()},
        "footprint_m": local_footprint(shape).ravel(),
    }
    texts = {key: " ".join(f"{value:.9g}" for value in row) for key, row in numbers.items()}
    status = status_message(name, texts, message=describe(part))
    status.hardware_id = "object"
    return status


def shape_from_message(message: DiagnosticArray) -> tuple[Link, ...]:
    """Return the parts of `/object/shape`.

    Raises:
        MessageError: another frame, or a value is missing or cannot be one.
    """
    if message.header.frame_id != WORLD:
        raise MessageError(
            "wrong_frame", f"{OBJECT_SHAPE}: frame_id '{message.header.frame_id}', expected {WORLD}"
        )
    return tuple(_link(status) for status in message.status)


def _link(status: DiagnosticStatus) -> Link:
    values = status_values(status)
    row = {key: _numbers(status.name, key, count, values) for key, count in LENGTHS.items()}
    pose = np.eye(4)
    length = float(np.linalg.norm(row["quaternion"]))
    if abs(length - 1.0) > 1e-2:
        raise MessageError(
            "bad_quaternion", f"{OBJECT_SHAPE}: {status.name}: quaternion has length {length:.3g}"
        )
    pose[:3, :3] = quaternion_to_matrix(row["quaternion"] / length)
    pose[:3, 3] = row["position_m"]
    try:
        shape = Superquadric(row["semi_axes_m"], row["exponents"], row["taper"], pose)
    except BadInputError as error:
        raise MessageError("bad_shape", f"{OBJECT_SHAPE}: {status.name}: {error}") from error
    std = {
        name: float(value)
        for key, names in STDS.items()
        for name, value in zip(names, row[key], strict=True)
    }
    return Link(status.name, shape, std, status.message)


def _numbers(link: str, key: str, count: int, values: Mapping[str, str]) -> Array:
    """Return the numbers of a key of a link."""
    try:
        found = np.array([float(word) for word in values[key].split()])
    except (KeyError, ValueError) as error:
        raise MessageError("bad_shape", f"{OBJECT_SHAPE}: {link}: no numbers {key}") from error
    if found.shape != (count,) or not np.all(np.isfinite(found)):
        raise MessageError(
            "bad_shape", f"{OBJECT_SHAPE}: {link}: {key} '{values[key]}', expected {count} numbers"
        )
    return found
