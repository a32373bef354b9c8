"""A centre of mass that stays inside the convex hull of the object's mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import spatial
from scipy.optimize import nnls

from tactile_dynamics_ros.core.errors import BadInputError

Array = NDArray[np.float64]

_COM = slice(7, 10)
"""Place of the centre of mass among the log-Cholesky coordinates. Fixed by the order of these
coordinates; elsewhere radii or shears would be held in the hull."""
_MARGIN = 1e-6
"""Distance, m, by which a centre of mass that was moved lies inside of the hull, so that rounding
does not put it outside again. At zero the next check may call the moved centre outside; more keeps
centres away from the surface of thin plates."""
_LARGEST_SHIFT = 1.0
"""Change of the other coordinates, logarithms and shears, that may follow a centre which is moved:
they are logarithms, so that 1 is a factor of e. Beyond it the linear relation does not hold; they
then move by less. Smaller leaves mass and radii beside what the moved centre asks for, larger lets
one step change a body beyond recognition."""


@dataclass(frozen=True)
class CentreHull:
    """Half spaces normal . c <= offset that hold every centre of mass the shape allows.

    Attributes:
        normal: (F, 3) outward unit normals, body frame.
        offset: (F,) m.
    """

    normal: Array
    offset: Array

    @classmethod
    def of_points(cls, points: Array) -> CentreHull:
        """Hull of mesh vertices (N, 3), body frame, m.

        Raises:
            BadInputError: the points do not span a volume.
        """
        try:
            faces = spatial.ConvexHull(np.asarray(points, dtype=float)).equations
        except (spatial.QhullError, ValueError) as error:
            raise BadInputError(
                "convex hull of the object: the vertices do not span a volume; expected (N, 3) "
                "metres in the body frame"
            ) from error
        return cls(faces[:, :3], -faces[:, 3])

    def contains(self, point: Array) -> bool:
        """Whether a point (3,) lies inside."""
        return bool(np.all(self.normal @ point <= self.offset))

    def nearest(self, point: Array, metric: Array) -> Array:
        """Point (3,) inside that minimises (c - point)^T metric (c - point).

        Source: Lawson, Hanson 1974, ch. 23 (least distance programming).
        """
        factor = np.linalg.cholesky(metric).T
        rows = -np.linalg.solve(factor.T, self.normal.T).T
        bounds = self.normal @ point - (self.offset - _MARGIN)
        scale = np.linalg.norm(rows, axis=1)
        stacked = np.vstack([(rows / scale[:, None]).T, bounds / scale])
        size = float(np.abs(bounds / scale).max())
        stacked[3] /= size
        multipliers, _ = nnls(stacked, np.array([0.0, 0.0, 0.0, 1.0]))
        residual = stacked @ multipliers - np.array([0.0, 0.0, 0.0, 1.0])
        step = -size * residual[:3] / residual[3]
        return np.asarray(point + np.linalg.solve(factor, step))


def keep_in_hull(xi: Array, information: Array, hull: CentreHull) -> Array:
    """Move log-Cholesky coordinates to the most likely ones whose centre of mass is inside.

    The last three coordinates are the centre of mass itself, so that the constraint is linear and
    the answer a body that can exist. The other coordinates follow as the information has it,
    as far as that is a small change.

    Args:
        xi: (10,) most likely without the constraint.
        information: (10, 10) on xi.
        hull: half spaces that hold the centre of mass.
    """
    if hull.contains(xi[_COM]):
        return xi
    others = information[:7, :7]
    coupling = np.linalg.solve(others, information[:7, _COM])
    metric = information[_COM, _COM] - information[_COM, :7] @ coupling
    moved = xi.copy()
    moved[_COM] = hull.nearest(xi[_COM], 0.5 * (metric + metric.T))
    shift = coupling @ (moved[_COM] - xi[_COM])
    moved[:7] -= shift * min(1.0, _LARGEST_SHIFT / max(float(np.abs(shift).max()), 1e-300))
    return moved
