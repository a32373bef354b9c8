"""A superquadric as the surface of an object that is tracked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric, Triangles

Array = NDArray[np.float64]

_LEAST_SLOPE = 1e-9
"""Smallest norm of the gauge's gradient, 1/m, that is divided by: only the very centre has less.
Larger would shorten normals near it, zero divides by zero there."""


@dataclass(frozen=True)
class SuperquadricSurface:
    """A superquadric in the frame of its `pose`.

    The distance is that along the normal where the ray from the axis meets the surface: exact near
    the surface, and at a third of the cost of the closest point.
    """

    shape: Superquadric

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,), m, and their gradients (N, 3)."""
        local = self.shape.to_body(points)
        foot = self.shape.project(local)
        slope = self.shape.differentiate(foot).point
        length = np.linalg.norm(slope, axis=1, keepdims=True)
        normal = slope / np.maximum(length, _LEAST_SLOPE)
        distance = np.einsum("ij,ij->i", local - foot, normal)
        return distance, np.asarray(normal @ self.shape.pose[:3, :3].T)

    def mesh(self) -> Triangles:
        """Return triangles, object frame."""
        return self.shape.mesh()


def tracked_shape(shape: Superquadric) -> ObjectShape:
    """Return what a tracker needs to know of a superquadric, in its own frame."""
    own = replace(shape, pose=np.eye(4))
    return ObjectShape([SuperquadricSurface(own)], shape.pose[:3, :3])
