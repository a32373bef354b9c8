"""A superquadric as the surface of an object that is tracked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.shape.superquadric.gauge import Foot
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric, Triangles

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SuperquadricSurface:
    """A superquadric in the frame of its `pose`.

    The distance is that along the normal where the ray from the axis meets the surface: exact near
    the surface, and at a third of the cost of the closest point.
    """

    shape: Superquadric

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,), m, and their gradients (N, 3)."""
        foot = Foot.of(self.shape.parameters, np.ascontiguousarray(self.shape.to_body(points).T))
        return foot.distance, np.asarray(foot.normal.T @ self.shape.pose[:3, :3].T)

    def mesh(self) -> Triangles:
        """Return triangles, object frame."""
        return self.shape.mesh()


def tracked_shape(shape: Superquadric) -> ObjectShape:
    """Return what a tracker needs to know of a superquadric, in its own frame."""
    own = replace(shape, pose=np.eye(4))
    return ObjectShape([SuperquadricSurface(own)], shape.pose[:3, :3])
