"""Objects to grasp: inertia, shape, friction and where to take them, read from yaml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite
from tactile_dynamics_ros.core.reading import read_yaml
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import described_pose, rpy_to_matrix
from tactile_dynamics_ros.share import share_file

Array = NDArray[np.float64]

REQUIRED = {"name", "description", "source", "inertial", "shapes", "friction", "rest", "grasp"}


@dataclass(frozen=True)
class Shape:
    """A box or an upright cylinder that is part of an object, in the object frame.

    Attributes:
        kind: "box" or "cylinder".
        size: (3,) full edge lengths, or (radius, radius, height along z), m.
        pose: (4, 4) of the shape's centre in the object frame.
    """

    kind: str
    size: Array
    pose: Array


@dataclass(frozen=True)
class ObjectModel:
    """A rigid object as the simulator needs it.

    Attributes:
        name: of the object and of its yaml file.
        description: what it is. source: where its numbers come from.
        inertia: mass, centre of mass and inertia in the object frame.
        shapes: its collision and visual shapes.
        friction: coefficient between fingertip skin and the object.
        rest_rotation: (3, 3) R_WO when it stands on the table (yaw zero).
        grasp: where the hand takes it.
    """

    name: str
    description: str
    source: str
    inertia: InertialParameters
    shapes: tuple[Shape, ...]
    friction: float
    rest_rotation: Array
    grasp: GraspSite

    @cached_property
    def corners(self) -> Array:
        """Points (K, 3) of the object frame whose lowest touches the table at rest."""
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        points = []
        for shape in self.shapes:
            half = shape.size / 2 if shape.kind == "box" else shape.size * [1.0, 1.0, 0.5]
            points.append(signs * half @ shape.pose[:3, :3].T + shape.pose[:3, 3])
        return np.concatenate(points)

    def resting_pose(self, x: float, y: float, yaw: float, table_height: float = 0.0) -> Array:
        """Pose X_WO (4, 4) of the object standing on the table with its grasp centre at x, y."""
        pose = np.eye(4)
        pose[:3, :3] = rpy_to_matrix((0.0, 0.0, yaw)) @ self.rest_rotation
        centre = pose[:3, :3] @ self.grasp.centre
        lowest = float((self.corners @ pose[:3, :3].T)[:, 2].min())
        pose[:3, 3] = [x - centre[0], y - centre[1], table_height - lowest]
        return pose


def object_directory() -> Path:
    """Folder of the object files: of the source tree if there is one, else of the installation."""
    return share_file("config/objects/box_0.yaml").parent


def list_objects() -> tuple[str, ...]:
    """Names of all objects that have a yaml file."""
    return tuple(sorted(path.stem for path in object_directory().glob("*.yaml")))


def load_object(name: str) -> ObjectModel:
    """Load an object by the name of its file in config/objects, or by the path of a yaml file.

    Raises:
        BadInputError: there is no such file, or its content is not an object.
    """
    path = Path(name) if name.endswith((".yaml", ".yml")) else object_directory() / f"{name}.yaml"
    if not path.is_file():
        raise BadInputError(f"object '{name}': no file {path}; known: {', '.join(list_objects())}")
    values = read_yaml(path, "a yaml file of an object")
    if not isinstance(values, dict) or set(values) - {"regions"} != REQUIRED:
        found = sorted(values) if isinstance(values, dict) else type(values).__name__
        raise BadInputError(f"{path}: found keys {found}, expected {sorted(REQUIRED)}")
    try:
        return _build(values)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInputError(
            f"{path}: {error!r}; compare with another file of that folder"
        ) from error


def _build(values: Mapping[str, Any]) -> ObjectModel:
    return ObjectModel(
        name=str(values["name"]),
        description=str(values["description"]),
        source=str(values["source"]),
        inertia=_inertia(values["inertial"]),
        shapes=tuple(_shape(shape) for shape in values["shapes"]),
        friction=float(values["friction"]),
        rest_rotation=rpy_to_matrix(np.deg2rad(np.asarray(values["rest"]["rpy_deg"], float))),
        grasp=GraspSite.from_mapping(values["grasp"]),
    )


def _inertia(values: Mapping[str, Any]) -> InertialParameters:
    mass = float(values["mass"])
    com = np.asarray(values["com"], dtype=float)
    if "inertia_com" in values:
        return InertialParameters(mass, com, _tensor(values["inertia_com"]))
    shift = mass * (com @ com * np.eye(3) - np.outer(com, com))
    return InertialParameters(mass, com, _tensor(values["inertia_origin"]) - shift)


def _tensor(values: Mapping[str, Any]) -> Array:
    """Matrix of a mapping xx, yy, zz, xy, xz, yz (tensor signs: xy = -integral of x y dm)."""
    xx, yy, zz, xy, xz, yz = (float(values[key]) for key in ("xx", "yy", "zz", "xy", "xz", "yz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _shape(values: Mapping[str, Any]) -> Shape:
    pose = described_pose(values)
    if "box" in values:
        return Shape("box", np.asarray(values["box"], dtype=float), pose)
    radius, height = (float(values["cylinder"][key]) for key in ("radius", "height"))
    return Shape("cylinder", np.array([radius, radius, height]), pose)
