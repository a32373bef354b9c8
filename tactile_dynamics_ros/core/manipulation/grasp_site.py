"""Where and along which axis an object can be taken between thumb and fingers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_yaml

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GraspSite:
    """Two opposing faces of an object and the direction to come from, all in the object frame.

    Attributes:
        centre: (3,) m, midway between the two faces, where the middle finger and the thumb press.
        pinch: (3,) unit vector from the thumb's face to the fingers' face.
        approach: (3,) unit vector along which the open hand comes, normal to ``pinch``.
        width: distance of the faces, m.
        spread: distance of neighbouring fingers on one face, m.
        radius: radius of a round object whose axis is ``approach``, m; zero for flat faces.
        stagger: how much deeper the middle finger presses than index and ring, m.
        depth: depth of the grasp centre beyond the palm of a hand along the approach, m; None
            leaves it to the robot. Less depth lets the thumb press harder (heavier objects) but
            more with its very tip.
        thumb: place of the thumb's tip behind the knuckles along the pinch, m; None leaves it to
            the robot.
    """

    centre: Array
    pinch: Array
    approach: Array
    width: float
    spread: float = 0.04
    radius: float = 0.0
    stagger: float = 0.015
    depth: float | None = None
    thumb: float | None = None

    def __post_init__(self) -> None:
        for name in ("centre", "pinch", "approach"):
            vector = np.asarray(getattr(self, name), dtype=float)
            if vector.shape != (3,):
                raise BadInputError(f"grasp site: {name} has shape {vector.shape}, expected (3,)")
            object.__setattr__(self, name, vector)
        for name in ("pinch", "approach"):
            object.__setattr__(self, name, _unit(getattr(self, name), name))
        if abs(self.pinch @ self.approach) > 1e-6:
            raise BadInputError("grasp site: pinch and approach must be perpendicular")
        if not 0.005 < self.width < 0.12:
            raise BadInputError(f"grasp site: width = {self.width} m, expected 0.005 to 0.12")

    @classmethod
    def from_file(cls, path: Path) -> GraspSite:
        """Read the ``grasp`` section of an object's yaml file.

        Raises:
            BadInputError: it cannot be read, or see `from_mapping`.
        """
        values = read_yaml(path, "a yaml file of an object")
        section = values.get("grasp") if isinstance(values, Mapping) else None
        if not isinstance(section, Mapping):
            raise BadInputError(f"{path}: no section 'grasp', expected an object with one")
        try:
            return cls.from_mapping(section)
        except (BadInputError, TypeError, ValueError) as error:
            raise BadInputError(f"{path}: {error}") from error

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> GraspSite:
        """Build a site from the ``grasp`` section of an object's yaml file.

        Raises:
            BadInputError: a key is unknown, missing or has the wrong shape.
        """
        known = {field.name for field in fields(cls)}
        unknown = sorted(set(values) - known)
        missing = sorted({"centre", "pinch", "approach", "width"} - set(values))
        if unknown or missing:
            raise BadInputError(
                f"grasp site: unknown keys {unknown}, missing keys {missing}; "
                f"the keys are {sorted(known)}"
            )
        return cls(**values)

    def frame(self) -> Array:
        """Pose X_OG (4, 4) of the grasp frame: x = -pinch, z = approach, origin at the centre."""
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 2] = -self.pinch, self.approach
        pose[:3, 1] = np.cross(self.approach, -self.pinch)
        pose[:3, 3] = self.centre
        return pose

    def face_offset(self, lateral: float) -> tuple[float, Array]:
        """Distance of a face from the mid-plane and its outward normal, (x, y) of the grasp frame.

        Args:
            lateral: position along the row of fingers (y of the grasp frame), m.
        """
        if self.radius == 0.0:
            return 0.5 * self.width, np.array([1.0, 0.0])
        sine = float(np.clip(lateral / self.radius, -0.9, 0.9))
        cosine = float(np.sqrt(1.0 - sine**2))
        return self.radius * cosine, np.array([cosine, sine])


def _unit(vector: Array, name: str) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise BadInputError(f"grasp site: {name} is a zero vector")
    return np.asarray(vector / length)
