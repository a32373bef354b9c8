"""Objects to grasp and objects on a table, read from yaml: inertia, shape, friction, grasps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite
from tactile_dynamics_ros.core.reading import read_yaml
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import described_pose, rpy_to_matrix
from tactile_dynamics_ros.share import share_file

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


_CORNERS = 64
"""Corners by which round outlines are drawn: at a radius of 5 cm 0.06 mm inside."""


@dataclass(frozen=True)
class PlanarPart:
    """One part: a prism on the table.

    Attributes:
        outline: name of its outline.
        corners: (K, 2) m, anticlockwise, in the object's frame.
        height: m.
        mass: kg. friction: coefficient on the table. com: (2,) m, in the object's frame.
    """

    outline: str
    corners: Array
    height: float
    mass: float
    friction: float
    com: Array

    def solid(self) -> Any:
        """Return the prism as a trimesh.Trimesh, base at z = 0."""
        return prism(self.corners, self.height)


@dataclass(frozen=True)
class PlanarObject:
    """An object by its number.

    Attributes:
        number: in `config/planar_objects.yaml`.
        kind: homogeneous, two_parts or jointed; the name of a daily one.
        parts: one or two.
        joint: (2,) m, place of the revolute joint; None without.
        joint_friction: N m, of the joint.
    """

    number: int
    kind: str
    parts: tuple[PlanarPart, ...]
    joint: Array | None
    joint_friction: float

    @property
    def parts_differ(self) -> bool:
        """Whether a camera can see two parts: outline, width or height differ."""
        if len(self.parts) < 2 or self.joint is not None:
            return True
        first, second = self.parts
        widths = [float(np.ptp(part.corners[:, 1])) for part in self.parts]
        heights = [part.height for part in self.parts]
        alike = abs(widths[0] - widths[1]) < 0.01 and abs(heights[0] - heights[1]) < 0.01
        return not (first.outline == second.outline == "box" and alike)


def planar_object(number: int) -> PlanarObject:
    """Draw an object.

    Raises:
        BadInputError: there is no such number.
    """
    ranges = _ranges()
    daily = dict(enumerate(ranges["daily"], start=ranges["first_daily"]))
    if number in daily:
        return _bought(number, **daily[number])
    for kind, spans in ranges["kinds"].items():
        if any(low <= number <= high for low, high in spans):
            return _draw(number, kind, ranges)
    raise BadInputError(f"planar object {number}: expected a number from 1 to {max(daily)}")


def last_number() -> int:
    """Return the highest number of the objects that are drawn; daily ones come after it."""
    return max(high for spans in _ranges()["kinds"].values() for _, high in spans)


def _ranges() -> dict[str, Any]:
    found: dict[str, Any] = read_yaml(share_file("config/planar_objects.yaml"))
    return found


def _bought(
    number: int,
    name: str,
    outline: str,
    size_m: Sequence[float],
    mass_kg: float,
    friction: float,
    com_x_m: float,
) -> PlanarObject:
    """An object of a household: its name, and its size along x, y and z."""
    corners = _shaped(outline, size_m[0], size_m[1], waist=1.0)
    com = np.array([com_x_m, 0.0])
    part = PlanarPart(outline, corners, size_m[2], mass_kg, friction, com)
    return PlanarObject(number, name, (part,), None, 0.0)


def _draw(number: int, kind: str, ranges: Mapping[str, Any]) -> PlanarObject:
    rng = np.random.default_rng([ranges["seed"], number])
    names = list(ranges["outlines"])
    if kind == "homogeneous":
        outlines = [names[number % len(names)]]
    else:
        solid = [name for name in names if name != "butterfly"]
        outlines = [solid[number % len(solid)], str(rng.choice(solid))]
    corners = [_outline(name, rng, ranges) for name in outlines]
    joint = None
    if len(corners) == 2:
        gap = -ranges["overlap_m"] if kind == "two_parts" else rng.uniform(*ranges["gap_m"])
        reach = corners[0][:, 0].max()
        corners[1] = corners[1] + [reach - corners[1][:, 0].min() + gap, 0.0]
        if kind == "jointed":
            joint = np.array([reach + 0.5 * gap, 0.0])
    masses = rng.uniform(*ranges["mass_kg"]) * rng.dirichlet(np.full(len(corners), 5.0))
    parts = tuple(
        PlanarPart(
            name,
            points,
            float(rng.uniform(*ranges["height_m"])),
            float(mass),
            float(rng.uniform(*ranges["friction"])),
            _centre(points) + ranges["com_share"] * rng.uniform(-0.5, 0.5, 2) * np.ptp(points, 0),
        )
        for name, points, mass in zip(outlines, corners, masses, strict=True)
    )
    friction = float(rng.uniform(*ranges["joint_friction_nm"])) if joint is not None else 0.0
    return PlanarObject(number, kind, parts, joint, friction)


def _outline(name: str, rng: np.random.Generator, ranges: Mapping[str, Any]) -> Array:
    """Corners (K, 2) of an outline about its middle, anticlockwise."""
    length = rng.uniform(*ranges["length_m"])
    width = length * (1.0 if name == "cylinder" else rng.uniform(*ranges["slenderness"]))
    return _shaped(name, length, width, rng.uniform(*ranges["waist"]))


def _shaped(name: str, length: float, width: float, waist: float) -> Array:
    """Corners (K, 2) of an outline of a length along x and a width, m."""
    x, y = 0.5 * length, 0.5 * width
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    if name == "box":
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    if name in ("ellipse", "cylinder"):
        return np.stack([x * np.cos(angle), y * np.sin(angle)], axis=1)
    if name == "hexagon":
        corner = np.deg2rad(60.0 * np.arange(6))
        return x * np.stack([np.cos(corner), np.sin(corner)], axis=1)
    if name == "triangle":
        return np.array([[-x, -y], [x, 0.0], [-x, y]])
    narrow = waist * y
    return np.array([[-x, -y], [0.0, -narrow], [x, -y], [x, y], [0.0, narrow], [-x, y]])


def _centre(corners: Array) -> Array:
    """Centroid (2,) of a polygon (K, 2)."""
    after = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]
    return np.asarray(((corners + after) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))


def prism(corners: Array, height: float) -> Any:
    """Return a prism over an outline that is star shaped about its centroid, base at z = 0."""
    count = len(corners)
    ring = np.arange(count)
    after = (ring + 1) % count
    middle = _centre(corners)
    low = np.column_stack([corners, np.zeros(count)])
    high = np.column_stack([corners, np.full(count, height)])
    vertices = np.vstack([low, high, [*middle, 0.0], [*middle, height]])
    bottom, top = 2 * count, 2 * count + 1
    faces = np.vstack(
        [
            np.column_stack([after, ring, np.full(count, bottom)]),
            np.column_stack([ring + count, after + count, np.full(count, top)]),
            np.column_stack([ring, after, after + count]),
            np.column_stack([ring, after + count, ring + count]),
        ]
    )
    return trimesh.Trimesh(vertices, faces, process=False)
