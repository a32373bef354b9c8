"""How the world of a table lies: turned, with gravity along another direction, or left-handed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import upright
from tactile_dynamics_ros.recording.importers.fields import constant_rotation

WORLD_KEYS = frozenset(["world_rotation", "gravity", "mirrored_world"])
"""Keys of a mapping that say how its world lies."""
MIRRORS: Mapping[str, Array] = {
    "x": np.diag([-1.0, 1.0, 1.0]),
    "y": np.diag([1.0, -1.0, 1.0]),
    "z": np.diag([1.0, 1.0, -1.0]),
    "xy": np.eye(3)[[1, 0, 2]],
    "xz": np.eye(3)[[2, 1, 0]],
    "yz": np.eye(3)[[0, 2, 1]],
}
"""Left-handed worlds by name: x points the other way, or x and y are exchanged, and so on."""


@dataclass(frozen=True)
class World:
    """How the world of a table lies in a right-handed one whose z points up.

    Attributes:
        turn: (3, 3) rotation, applied after the mirror.
        mirror: (3, 3), one of `MIRRORS`, or the identity.
    """

    turn: Array = field(default_factory=lambda: np.eye(3))
    mirror: Array = field(default_factory=lambda: np.eye(3))

    def turned(self, arrays: dict[str, Any]) -> dict[str, Any]:
        """Arrays of a stream in the upright world.

        A mirror M takes an orientation R to M R M, so that the body's axes stay right-handed, and
        a torque t to -M t; a matrix that is left-handed itself becomes M R.

        Args:
            arrays: vectors in world axes, and orientations to the world.
        """
        whole = self.turn @ self.mirror
        if np.array_equal(whole, np.eye(3)):
            return arrays
        found = dict(arrays)
        for key in ("position", "force", "normal"):
            if key in found:
                found[key] = found[key] @ whole.T
        if "torque" in found:
            found["torque"] = np.linalg.det(whole) * found["torque"] @ whole.T
        if "rotation" in found:
            handed = np.linalg.det(found["rotation"]) > 0.0
            right = np.where(handed[..., None, None], self.mirror, np.eye(3))
            found["rotation"] = whole @ found["rotation"] @ right
        return found


def read_world(source: str, mapping: Mapping[str, Any]) -> World:
    """World of a mapping.

    Args:
        source: of the mapping, for messages to the user.
        mapping: `mirrored_world` as one of `MIRRORS`; then `world_rotation` as a rotation, or
            `gravity` as the direction in which things fall.

    Raises:
        BadInputError: an entry is malformed, or both a rotation and gravity are given.
    """
    turn, name = np.eye(3), mapping.get("mirrored_world")
    if "world_rotation" in mapping and "gravity" in mapping:
        raise BadInputError(f"{source}: world_rotation and gravity; expected one of them")
    if "world_rotation" in mapping:
        turn = constant_rotation(f"{source}: world_rotation", mapping["world_rotation"])
    if "gravity" in mapping:
        turn = upright(_direction(f"{source}: gravity", mapping["gravity"]))
    if name is None:
        return World(turn)
    if name not in MIRRORS:
        raise BadInputError(
            f"{source}: mirrored_world: {name!r}; expected one of {', '.join(MIRRORS)}"
        )
    return World(turn, MIRRORS[name])


def _direction(where: str, value: Any) -> Array:
    try:
        found = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"{where} = {value!r}; expected three numbers") from error
    if found.shape != (3,) or not np.isfinite(found).all() or not found.any():
        raise BadInputError(f"{where} = {value!r}; expected three numbers, the way things fall")
    return found
