"""A solid by its surface: volume, inertia; a centre of mass stays inside its convex hull."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import spatial
from scipy.optimize import nnls
from scipy.spatial import Delaunay, QhullError, cKDTree

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape

_POINTS = 1000
"""Points of a volume. Moments of an even box are then off by about 1 %. Twice as many take four
times as long (covariances of all pairs)."""
_TRIES = 64
"""Places per point that is kept, at most, in the box around a surface: a body that fills a
sixtieth of its box still has all its points. Thinner ones have fewer, down to `_FEWEST`."""
_FEWEST = 50
"""Points of a volume at least; a surface with fewer inside is open or turned inside out. Lower lets
a few stray points stand for a body, higher refuses wires."""
_NEIGHBOUR = 8
"""Neighbour whose distance (median over the points) is the spacing of a cloud. Nearer ones may be
the same point twice, farther ones lie across thin parts."""
_REACHES = (2.0, 4.0, 8.0)
"""Radii, in spacings, up to which the tetrahedra between points of a cloud count as inside. Small
ones leave thick parts empty, large ones fill what lies between jaws; the convex hull is the last.
On 20 workshop tools each of the four is the nearest to the true volume of some."""
_TREMBLE = 1e-4
"""Random shift of a cloud's points, in spacings, so that points in one plane make no degenerate
tetrahedra. It moves no volume; at zero flat faces are lost at random."""
_SMALLEST_TETRAHEDRON = 1e-12
"""Volume of a tetrahedron, in cubes of the spacing, below which it counts as flat and as none.
Far above rounding; larger ones would leave holes."""
_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)
"""Steps of evenly spread places along three axes: powers of the root of x^4 = x + 1, whose
multiples never come together. Random ones would leave moments off by 3 %; so would the first
thousand of these, which are left out."""
_SEED = 66
"""Seed of all samples, so that the same file gives the same estimate."""


@dataclass(frozen=True)
class Volume:
    """One reading of what a surface encloses.

    Attributes:
        points: (N, 3) m, body frame, each for the same share of the volume.
        part: (N,) number of the part that each is in.
    """

    points: Array
    part: NDArray[np.int64]


@dataclass(frozen=True)
class Solid:
    """A body's volume, where it is not certain in several readings.

    Attributes:
        volumes: readings, each as likely before anything is weighed.
        surface: (M, 3) m, points of the surface.
        name: where the shape comes from.
    """

    volumes: tuple[Volume, ...]
    surface: Array
    name: str = "shape"

    @property
    def size(self) -> float:
        """Longest edge of the box around the surface, m."""
        return float(np.ptp(self.surface, axis=0).max())

    @classmethod
    def of_shape(cls, shape: ObjectShape, name: str = "shape") -> Solid:
        """Fill closed surfaces; each is a part.

        Raises:
            BadInputError: they enclose nothing.
        """
        surface = shape.points[: 2 * _POINTS]
        return cls((_inside(shape, name),), surface, name)

    @classmethod
    def of_cloud(cls, points: Array, name: str = "shape") -> Solid:
        """Fill what points of a surface enclose: tetrahedra between near points, or the hull.

        Args:
            points: (N, 3) m, from all sides.
            name: for messages.

        Raises:
            BadInputError: they do not span a volume.

        Source: Edelsbrunner, Muecke 1994 (alpha shapes).
        """
        spacing = _spacing(points)
        rng = np.random.default_rng(_SEED)
        shaken = points + _TREMBLE * spacing * rng.normal(size=points.shape)
        try:
            corners = shaken[Delaunay(shaken).simplices]
        except (QhullError, ValueError) as error:
            raise BadInputError(
                f"shape {name}: the points do not span a volume; expected (N, 3) metres, taken "
                "from all sides"
            ) from error
        radius, volume = _circumscribed(corners, _SMALLEST_TETRAHEDRON * spacing**3)
        limits = [*(reach * spacing for reach in _REACHES), np.inf]
        kept = [radius < limit for limit in limits]
        volumes = [_fill(corners[keep], volume[keep], rng) for keep in kept if keep.any()]
        return cls(tuple(volumes), points[rng.permutation(len(points))[: 2 * _POINTS]], name)

    def moved(self, pose: Array) -> Solid:
        """The same body with its shape at a pose (4, 4) in the body frame."""
        turn, shift = pose[:3, :3], pose[:3, 3]
        volumes = [Volume(v.points @ turn.T + shift, v.part) for v in self.volumes]
        return Solid(tuple(volumes), self.surface @ turn.T + shift, self.name)


def _inside(shape: ObjectShape, name: str) -> Volume:
    """Evenly spread places in the box around a shape that lie inside of it.

    Source: Roberts 2018 (R3, an additive recurrence of low discrepancy).
    """
    points, parts, count = [], [], 0
    for round_ in range(1, _TRIES + 1):
        steps = np.arange(round_ * _POINTS, (round_ + 1) * _POINTS)[:, None]
        places = shape.centre + shape.half * (2.0 * ((0.5 + steps * _STEPS) % 1.0) - 1.0)
        depth = np.array([surface.distance(places)[0] for surface in shape.surfaces])
        inside = depth.min(axis=0) < 0.0
        points.append(places[inside])
        parts.append(depth.argmin(axis=0)[inside])
        count += int(inside.sum())
        if count >= _POINTS:
            break
    if count < _FEWEST:
        raise BadInputError(
            f"shape {name}: encloses no volume; expected a closed surface with outward normals, or "
            "a cloud of its points"
        )
    return Volume(np.concatenate(points)[:_POINTS], np.concatenate(parts)[:_POINTS])


def _spacing(points: Array) -> float:
    if len(points) <= _NEIGHBOUR:
        return 0.0
    return float(np.median(cKDTree(points).query(points, _NEIGHBOUR)[0][:, -1]))


def _circumscribed(corners: Array, least: float) -> tuple[Array, Array]:
    """Radii of the spheres through the corners (T, 4, 3), inf if flat, and volumes (T,)."""
    edges = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.linalg.det(edges)) / 6.0
    radius = np.full(len(corners), np.inf)
    full = volume > least
    half = 0.5 * np.sum(edges[full] ** 2, axis=2)
    radius[full] = np.linalg.norm(np.linalg.solve(edges[full], half[..., None])[..., 0], axis=1)
    return radius, np.where(full, volume, 0.0)


def _fill(corners: Array, volume: Array, rng: np.random.Generator) -> Volume:
    """Random places in tetrahedra, as many as their volume asks for."""
    steps = (np.arange(_POINTS) + rng.random()) / _POINTS
    chosen = np.searchsorted(np.cumsum(volume), steps * volume.sum())
    shares = rng.dirichlet(np.ones(4), _POINTS)
    points = np.einsum("nk,nki->ni", shares, corners[chosen])
    return Volume(points, np.zeros(_POINTS, dtype=np.int64))


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
