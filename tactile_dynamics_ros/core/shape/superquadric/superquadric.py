"""A superquadric with tapering along y: implicit function, closest points, surface."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.shape.superquadric.gauge import (
    NARROWEST,
    TINY,
    Foot,
    LogGauge,
    Parameters,
    areas,
    surface_points,
    unit_cube,
)

Triangles: TypeAlias = Any
"""A trimesh.Trimesh; the library is not typed."""

EXPONENT_RANGE = (0.05, 2.0)
"""Exponents that are admitted: at 0.05 edges are rounded by 1.7 % of the half width, at 2 a section
is a diamond. Less is no sharper to a camera and makes powers of 40 and more; beyond 2 surfaces
become star shaped."""
_PROJECTIONS = 6
"""Steps from the nearest corner of the mesh to the closest point. Each costs one evaluation of the
surface; without any, distances of points on the surface would be as coarse as the mesh. With half
as many, points near sharp edges end beside their foot."""
_FACE = 24
"""Cells along an edge of the cube whose surface is mapped to a mesh: 6912 triangles, 4 mm long on
an object of 10 cm; a cylinder is drawn 0.1 mm inside. Half as many draw it 0.4 mm inside."""
_OUTLINE = 96
"""Corners of a footprint: every 4 deg, 0.06 mm inside of a circle of 10 cm. Fewer cut round
footprints, more make messages longer."""


@dataclass(frozen=True)
class Gradient:
    """The gauge G of points and its derivatives.

    Attributes:
        gauge: (N,) G; 1 on the surface, homogeneous of degree 1 where there is no taper.
        point: (N, 3) dG/dX in the body frame, 1/m.
        axes: (N, 3) dG/d(semi-axes), 1/m.
        exponents: (N, 2) dG/d(e1, e2).
        taper: (N, 2) dG/d(k1, k2).
    """

    gauge: Array
    point: Array
    axes: Array
    exponents: Array
    taper: Array


@dataclass(frozen=True)
class Superquadric:
    """A superquadric whose x is scaled by f(y) = 1 + k1 y/a_y + k2 (y/a_y)^2.

    Its surface is G = 1 of the gauge

        G = (A^q + |z/a_z|^q)^(1/q),  A = (|x/(a_x f)|^p + |y/a_y|^p)^(1/p),  p = 2/e2, q = 2/e1,

    that is F^(e1/2) of the usual implicit function F. Source: paper B, Eq. 1 and 2; as printed, f
    lacks the 1 and the scale of y, so that f(0) = 0 would collapse the shape.

    Attributes:
        semi_axes: (3,) a_x, a_y, a_z, m.
        exponents: (2,) e1 (profile along z), e2 (section): towards 0 a box, 1 round, 2 a diamond.
        taper: (2,) k1, k2.
        pose: (4, 4) of the body frame in the world.
    """

    semi_axes: Array
    exponents: Array
    taper: Array = field(default_factory=lambda: np.zeros(2))
    pose: Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            BadInputError: a semi-axis is not positive or an exponent is out of its range.
        """
        if not (np.all(np.isfinite(self.semi_axes)) and np.all(self.semi_axes > 0.0)):
            raise BadInputError(f"superquadric: semi-axes {self.semi_axes}, expected metres > 0")
        low, high = EXPONENT_RANGE
        if not np.all((self.exponents >= low) & (self.exponents <= high)):
            raise BadInputError(
                f"superquadric: exponents {self.exponents}, expected {low:g} to {high:g}"
            )

    def to_body(self, points: Array) -> Array:
        """Return points (N, 3) of the world in the body frame, m."""
        return np.asarray((points - self.pose[:3, 3]) @ self.pose[:3, :3])

    def to_world(self, points: Array) -> Array:
        """Return points (N, 3) of the body frame in the world, m."""
        return np.asarray(points @ self.pose[:3, :3].T + self.pose[:3, 3])

    @property
    def parameters(self) -> Parameters:
        """Axes, exponents and taper."""
        return Parameters(self.semi_axes, self.exponents, self.taper)

    def differentiate(self, points: Array) -> Gradient:
        """Return G and its derivatives at points (N, 3) of the body frame."""
        found, f, slope, inside = self._gauge(points)
        gauge, (ax, ay, az) = np.exp(found.log), self.semi_axes
        x, y, z = np.where(np.abs(points) < TINY, TINY, points).T
        by_eta = found.by_u * slope / f
        point = np.stack([found.by_u / x, found.by_v / y - by_eta / ay, found.by_w / z], axis=1)
        by_y = found.by_v - by_eta * points[:, 1] / ay
        axes = -np.stack([found.by_u / ax, by_y / ay, found.by_w / az], axis=1)
        exponents = np.stack([found.by_e1, found.by_e2], axis=1)
        by_f = -found.by_u / f * (f > NARROWEST)
        taper = by_f[:, None] * np.stack([inside, inside**2], axis=1)
        scale = gauge[:, None]
        return Gradient(gauge, scale * point, scale * axes, scale * exponents, scale * taper)

    def gauge(self, points: Array) -> Array:
        """Return G (N,) of points (N, 3) of the body frame."""
        return np.asarray(np.exp(self._gauge(points)[0].log))

    def _gauge(self, points: Array) -> tuple[LogGauge, Array, Array, Array]:
        eta = points[:, 1] / self.semi_axes[1]
        f, slope, inside = self.parameters.width(eta)
        u, w = points[:, 0] / (self.semi_axes[0] * f), points[:, 2] / self.semi_axes[2]
        return LogGauge.of(u, eta, w, self.exponents), f, slope, inside

    def project(self, points: Array) -> Array:
        """Return where the rays from the axis through points (N, 3) meet the surface, body frame.

        Rays are straight in the body without its taper.
        """
        found, f, _, _ = self._gauge(points)
        moved = points * np.exp(-found.log)[:, None]
        moved[:, 0] *= self.parameters.width(moved[:, 1] / self.semi_axes[1])[0] / f
        return moved

    def closest(self, points: Array) -> tuple[Array, Array]:
        """Return the closest points of the surface and its outward normals there.

        Args:
            points: (N, 3) world, m.

        Returns:
            (N, 3) points, m, and (N, 3) unit vectors, world.
        """
        local = self.to_body(np.asarray(points, dtype=float))
        corners = self._corners
        best = corners.data[corners.query(local)[1]]
        distance = np.linalg.norm(local - best, axis=1)
        share = np.ones(len(local))
        for _ in range(_PROJECTIONS):
            normal = _unit(self.differentiate(best).point)
            error = local - best
            along = error - np.einsum("ij,ij->i", error, normal)[:, None] * normal
            foot = self.project(best + share[:, None] * along)
            reached = np.linalg.norm(local - foot, axis=1)
            nearer = reached < distance
            best = np.where(nearer[:, None], foot, best)
            distance = np.where(nearer, reached, distance)
            share = np.where(nearer, share, 0.3 * share)
        normal = _unit(self.differentiate(best).point)
        return self.to_world(best), np.asarray(normal @ self.pose[:3, :3].T)

    def distance(self, points: Array) -> Array:
        """Return signed distances (N,) of points (N, 3) of the world, m; negative inside."""
        foot, _ = self.closest(points)
        length = np.linalg.norm(points - foot, axis=1)
        return np.asarray(np.where(self.gauge(self.to_body(points)) < 1.0, -length, length))

    def mesh(self, cells: int = _FACE) -> Triangles:
        """Return triangles in the world, outward; 12 times the square of `cells`."""
        corners, faces = unit_cube(cells)
        local = self._on_surface(corners)
        return trimesh.Trimesh(self.to_world(local), faces, process=False)

    @cached_property
    def _corners(self) -> cKDTree:
        return cKDTree(self._on_surface(unit_cube(_FACE)[0]))

    @cached_property
    def area(self) -> float:
        """Area of the surface, m^2, of a coarse mesh: 1 to 3 % low."""
        return float(areas(self.parameters)[0])

    def sample(self, count: int, seed: int = 0) -> tuple[Array, Array]:
        """Return points spread evenly over the surface, and outward normals.

        Args:
            count: number of points.
            seed: of the draw.

        Returns:
            (count, 3) m and (count, 3) unit vectors, world.
        """
        mesh = self.mesh()
        points, _ = trimesh.sample.sample_surface(mesh, count, seed=seed)
        local = self.project(self.to_body(np.asarray(points)))
        normal = _unit(self.differentiate(local).point)
        return self.to_world(local), np.asarray(normal @ self.pose[:3, :3].T)

    def footprint(self) -> Array:
        """Return the outline of the widest section, (96, 2) m, anticlockwise, world x and y.

        It is the footprint of a body that stands upright.
        """
        angle = np.linspace(-np.pi, np.pi, _OUTLINE, endpoint=False)
        ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(_OUTLINE)], axis=1)
        ring /= np.max(np.abs(ring), axis=1, keepdims=True)
        return self.to_world(self._on_surface(ring))[:, :2]

    def extents(self) -> Array:
        """Return lengths (3,) along the axes of the body, m: twice a_x and more where it tapers."""
        return np.asarray(np.ptp(self._on_surface(unit_cube(_FACE)[0]), axis=0))

    def _on_surface(self, directions: Array) -> Array:
        """Return the surface points (N, 3), body frame, in directions of the unit body."""
        return surface_points(self.parameters, directions)[0]


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, TINY))


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
