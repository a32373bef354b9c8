"""What others make of the same points: boxes, a cylinder, and fits without the decisive terms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from unittest import mock

import numpy as np
import trimesh
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from benchmarks.shape.trial import COMPARED
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.shape.superquadric import ascent
from tactile_dynamics_ros.core.shape.superquadric.gauge import Parameters, areas
from tactile_dynamics_ros.core.shape.superquadric.recovery import recover
from tactile_dynamics_ros.core.shape.superquadric.superquadric import EXPONENT_RANGE, Superquadric


def compare_peers(points: Array, truth: Array) -> dict[str, float]:
    """Chamfer distances, m, of one surface by each peer.

    Args:
        points: (N, 3) of one or several looks, table at z = 0.
        truth: (M, 3) spread evenly over the true surface.
    """
    return {name: mesh_chamfer(peer(points), truth) for name, peer in PEERS.items()}


def mesh_chamfer(mesh: Any, truth: Array) -> float:
    """Mean of both mean distances, m, between samples of two surfaces."""
    found = np.asarray(trimesh.sample.sample_surface(mesh, 20 * COMPARED, seed=1)[0])
    there = cKDTree(found).query(truth[:: len(truth) // COMPARED])[0].mean()
    return float(0.5 * (there + cKDTree(truth).query(found[::20])[0].mean()))


def plain_least_squares(points: Array) -> Any:
    """Distances along rays to an untapered superquadric on the table, squared, strays included."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)

    def shape(x: Array) -> Superquadric:
        pose = np.eye(4)
        c, s = np.cos(x[7]), np.sin(x[7])
        pose[:2, :2], pose[:3, 3] = [[c, -s], [s, c]], [x[5], x[6], np.exp(x[2])]
        return Superquadric(np.exp(x[:3]), np.clip(x[3:5], *EXPONENT_RANGE), pose=pose)

    def apart(x: Array) -> Array:
        found = shape(x)
        local = found.to_body(points)
        return np.asarray(np.linalg.norm(local, axis=1) * (1.0 - 1.0 / found.gauge(local)))

    start = np.array([*np.log(half[:2]), np.log(0.5 * high[2]), 0.5, 0.5, *middle[:2], 0.0])
    ends = [least_squares(apart, np.append(start[:7], turn)) for turn in (0.0, np.pi / 4)]
    return shape(min(ends, key=lambda end: end.cost).x).mesh()


def without_table_or_area(points: Array) -> Any:
    """Expectation maximisation with strays, but with neither the table nor the area term."""

    def even(shapes: Parameters) -> tuple[Array, Array]:
        area, slopes = areas(shapes)
        return np.full_like(area, 0.02), np.zeros_like(slopes)

    with mock.patch.object(ascent, "areas", even):
        return recover(points, None).shape.mesh()


PEERS: dict[str, Callable[[Array], Any]] = {
    "least squares": plain_least_squares,
    "no table, no area": without_table_or_area,
    "bounding box": lambda points: trimesh.PointCloud(points).bounding_box,
    "oriented box": lambda points: trimesh.PointCloud(points).bounding_box_oriented,
    "cylinder": lambda points: trimesh.PointCloud(points).bounding_cylinder,
}
"""Ways from points (N, 3) to a mesh."""
