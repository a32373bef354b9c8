"""The object's surface as a mesh: nearest triangle, its normal, and named regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_mesh
from tactile_dynamics_ros.core.rigid_body.rotation import described_pose

WHOLE = "body"
"""Name of everything that lies in no named region. It is written in files and messages: another
name is another region."""


@dataclass(frozen=True)
class Region:
    """A part of the surface that is expected to have a friction of its own.

    Attributes:
        name: name of the region.
        lower, upper: (3,) corners of the box in the object frame that holds it, m.
    """

    name: str
    lower: Array
    upper: Array

    def contains(self, point: Array) -> bool:
        """Whether a point (3,) of the object frame belongs to it."""
        return bool(np.all(point >= self.lower) and np.all(point <= self.upper))


@dataclass(frozen=True)
class SurfacePlace:
    """Where a contact lies on the surface, object frame.

    Attributes:
        point: (3,) nearest point of the mesh, m.
        normal: (3,) into the object.
        distance: distance of the contact from the mesh, m.
        region: name.
    """

    point: Array
    normal: Array
    distance: float
    region: str


class ObjectSurface:
    """Mesh and regions of one object.

    Args:
        mesh: closed, in the object frame, m.
        regions: named parts; what is in none of them is ``body``.
    """

    def __init__(self, mesh: trimesh.Trimesh, regions: Sequence[Region] = ()) -> None:
        if len(mesh.faces) == 0:
            raise BadInputError("object surface: the mesh has no triangles")
        self.mesh = mesh
        self.regions = tuple(regions)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> ObjectSurface:
        """Build the surface from an object's yaml content: its shapes and optional regions.

        Raises:
            BadInputError: shapes are missing or no numbers.
        """
        try:
            mesh = _join([_mesh(shape) for shape in values["shapes"]])
            regions = [
                Region(
                    str(part["name"]),
                    np.asarray(part["lower"], dtype=float),
                    np.asarray(part["upper"], dtype=float),
                )
                for part in values.get("regions", ())
            ]
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"object surface: {error!r}; expected shapes, regions") from error
        return cls(mesh, regions)

    @classmethod
    def from_file(cls, path: str, regions: Sequence[Region] = ()) -> ObjectSurface:
        """Read a mesh file (STL, OBJ, PLY ...) in m.

        Raises:
            BadInputError: the file holds no mesh.
        """
        return cls(_join([read_mesh(path)]), regions)

    def locate(self, point: Array) -> SurfacePlace:
        """Return the nearest triangle's point and normal for a contact point (3,), object frame.

        Source: paper A, section IV-A (nearest triangle's normal).
        """
        found = trimesh.proximity.closest_point_naive(self.mesh, point[None])  # type: ignore[no-untyped-call]
        nearest, distance, face = found
        normal = -np.asarray(self.mesh.face_normals[int(face[0])], dtype=float)
        place = np.asarray(nearest[0], dtype=float)
        region = next((r.name for r in self.regions if r.contains(place)), WHOLE)
        return SurfacePlace(place, normal, float(distance[0]), region)


def _join(meshes: Sequence[Any]) -> trimesh.Trimesh:
    """One mesh of several; anything else than triangles counts as none."""
    parts = [mesh for mesh in meshes if isinstance(mesh, trimesh.Trimesh)]
    corners = np.cumsum([0, *(len(mesh.vertices) for mesh in parts)])
    vertices = np.concatenate([np.asarray(mesh.vertices) for mesh in parts] + [np.zeros((0, 3))])
    faces = [mesh.faces + first for mesh, first in zip(parts, corners[:-1], strict=True)]
    joined = np.concatenate([*faces, np.zeros((0, 3), dtype=int)])
    return trimesh.Trimesh(vertices, joined, process=False)


def _mesh(shape: Mapping[str, Any]) -> Any:
    pose = described_pose(shape)
    if "box" in shape:
        return trimesh.creation.box(np.asarray(shape["box"], dtype=float), transform=pose)
    if "sphere" in shape:
        ball = trimesh.creation.icosphere(subdivisions=4, radius=float(shape["sphere"]["radius"]))
        return ball.apply_transform(pose)
    size = shape["cylinder"]
    return trimesh.creation.cylinder(
        float(size["radius"]), float(size["height"]), sections=128, transform=pose
    )
