"""The shape of a held object from a file, as estimates take it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_json, read_mesh
from tactile_dynamics_ros.core.shape.object_shape import MESH_SUFFIXES, ObjectShape, load_shape
from tactile_dynamics_ros.core.shape.solid import Solid
from tactile_dynamics_ros.core.shape.superquadric.superquadric import (
    Superquadric,
    SuperquadricSurface,
)
from tactile_dynamics_ros.recording.clouds import read_clouds

_SURFACE_POINTS = 4000
"""Points of a mesh that is not closed or turned inside out, which is then read as a cloud: on a
tool of 20 cm one per 3 mm. Fewer lose thin parts, more take longer to connect."""


def read_solid(path: str | Path, pose: Array | None = None) -> Solid:
    """Read the volume that a shape encloses.

    Args:
        path: mesh (m) or yaml file of an object, cloud of points of its surface, or what
            `tactile-dynamics shape --json` prints, whose first part's axes are the object's.
        pose: (4, 4) of its axes in the frame of the object's pose; the same axes if None.

    Raises:
        BadInputError: it cannot be read, or encloses nothing.
    """
    solid = _read(Path(path))
    return solid if pose is None else solid.moved(pose)


def _read(path: Path) -> Solid:
    name, suffix = path.name, path.suffix.lower()
    if suffix == ".json":
        return Solid.of_shape(_read_parts(path), name)
    if suffix in (".yaml", ".yml"):
        return Solid.of_shape(load_shape(path), name)
    mesh = _triangles(path) if suffix in MESH_SUFFIXES else None
    if mesh is None:
        return Solid.of_cloud(read_clouds([path]).points, name)
    if mesh.is_volume:
        return Solid.of_shape(load_shape(path), name)
    from trimesh.sample import sample_surface

    return Solid.of_cloud(np.asarray(sample_surface(mesh, _SURFACE_POINTS, seed=0)[0]), name)


def _triangles(path: Path) -> Any:
    """Triangles of a file; None if it has points alone."""
    try:
        return read_mesh(path, "the shape of an object")
    except BadInputError as error:
        if "no triangles" in str(error):
            return None
        raise


def _read_parts(path: Path) -> ObjectShape:
    """Superquadrics of `shape --json`, in the axes of the first."""
    document = read_json(path, "what `tactile-dynamics shape --json` prints")
    try:
        found = [
            Superquadric(*(np.array(part[key], dtype=float) for key in _KEYS))
            for part in document["parts"]
        ]
        parts = in_first(found)
    except (KeyError, TypeError, ValueError, IndexError, np.linalg.LinAlgError) as error:
        raise BadInputError(
            f"{path}: {error!r}; expected `parts` as `tactile-dynamics shape --json` prints them"
        ) from error
    return ObjectShape([SuperquadricSurface(part) for part in parts])


def in_first(parts: Sequence[Superquadric]) -> list[Superquadric]:
    """The same parts, their poses in the axes of the first.

    Args:
        parts: in any common frame.

    Raises:
        LinAlgError: the first has no axes.
    """
    first = np.linalg.inv(parts[0].pose)
    return [Superquadric(p.semi_axes, p.exponents, p.taper, first @ p.pose) for p in parts]


_KEYS = ("semi_axes_m", "exponents", "taper", "pose")
"""What a part of that document says of its surface; fixed by what `shape --json` prints."""
