"""Boxes around the links of a robot, by the shapes with which they collide."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from urdf_parser_py import urdf as parser

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.reading import read_mesh
from tactile_dynamics_ros.core.rigid_body.rotation import pose_of
from tactile_dynamics_ros.core.robot.kinematic_tree import parse_urdf
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.share import find_package_file


@dataclass(frozen=True, eq=False)
class Box:
    """A box that encloses (part of) a link: pose (4, 4) in the link frame, edges size (3,), m."""

    link: str
    pose: Array
    size: Array


def enclosing_boxes(robot: Robot) -> list[Box]:
    """Return a box for each collision shape that is a box or a mesh, in the order of links.

    A mesh whose file is not found has none.
    """
    return [box for link in parse_urdf(robot.urdf).links for box in _boxes(link, robot.folder)]


def boxes_around(urdf: str, folder: str) -> list[Box]:
    """Return a box for each collision shape of a URDF, cylinders and spheres too.

    Args:
        urdf: its text.
        folder: where its relative files lie, or "".
    """
    links = parse_urdf(urdf).links
    return [box for link in links for box in _boxes(link, folder, round_too=True)]


def _boxes(link: Any, folder: str, round_too: bool = False) -> Iterator[Box]:
    for shape in link.collisions:
        pose = shape.origin
        place = np.eye(4) if pose is None else pose_of(pose.xyz or (0, 0, 0), pose.rpy or (0, 0, 0))
        found = _extent(shape.geometry, folder)
        if found is None and round_too:
            found = _round_extent(shape.geometry)
        if found is not None:
            place[:3, 3] += place[:3, :3] @ found[0]
            yield Box(link.name, place, found[1])


def _extent(geometry: Any, folder: str) -> tuple[Array, Array] | None:
    """Return centre (3,) and size (3,) of the box around a shape, m, or None."""
    if isinstance(geometry, parser.Box):
        return np.zeros(3), np.array(geometry.size, dtype=float)
    if not isinstance(geometry, parser.Mesh):
        return None
    path = find_package_file(geometry.filename, Path(folder))
    if path is None:
        return None
    scale = np.array(geometry.scale or (1.0, 1.0, 1.0), dtype=float)
    low, high = scale * read_mesh(path, "a mesh of a URDF").bounds
    return 0.5 * (low + high), np.abs(high - low)


def _round_extent(geometry: Any) -> tuple[Array, Array] | None:
    """Return centre (3,) and size (3,) of the box around a cylinder or sphere, m, or None."""
    if isinstance(geometry, parser.Sphere):
        return np.zeros(3), np.full(3, 2.0 * geometry.radius)
    if isinstance(geometry, parser.Cylinder):
        width = 2.0 * geometry.radius
        return np.zeros(3), np.array([width, width, geometry.length])
    return None
