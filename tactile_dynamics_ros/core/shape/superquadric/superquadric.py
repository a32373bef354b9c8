"""A superquadric with tapering along y: implicit function, closest points, samples, outline."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import cross

Array = NDArray[np.float64]
Triangles: TypeAlias = Any
"""A trimesh.Trimesh; the library is not typed."""

EXPONENT_RANGE = (0.05, 2.0)
"""Exponents that are admitted: at 0.05 edges are rounded by 1.7 % of the half width, at 2 a section
is a diamond. Less is no sharper to a camera and makes powers of 40 and more; beyond 2 surfaces
become star shaped."""
NARROWEST = 0.02
"""Least value of the taper f on the body, so that it stays positive: the tip of a triangle keeps 2
% of the width. At zero the surface folds there and its normal is undefined."""
_PROJECTIONS = 6
"""Steps from the nearest corner of the mesh to the closest point. Each costs one evaluation of the
surface; without any, distances of points on the surface would be as coarse as the mesh."""
_FACE = 24
"""Cells along an edge of the cube whose surface is mapped to a mesh: 6912 triangles, 4 mm long on
an object of 10 cm; a cylinder is drawn 0.1 mm inside. Half as many draw it 0.4 mm inside."""
_COARSE = 8
"""As `_FACE`, of the mesh whose area a fit looks at 8 times a step: 768 triangles. What matters is
how the area changes with the shape, which is right to 1 % of itself."""
_OUTLINE = 96
"""Corners of a footprint: every 4 deg, 0.06 mm inside of a circle of 10 cm."""
_TINY = 1e-12
"""Smallest norm that is divided by: far below rounding of any length in metres."""


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

    def differentiate(self, points: Array) -> Gradient:
        """Return G and its derivatives at points (N, 3) of the body frame."""
        (ax, ay, az), (e1, e2) = self.semi_axes, self.exponents
        eta = points[:, 1] / ay
        f, slope, inside = self._width(eta)
        u, v, w = np.abs(points[:, 0]) / (ax * f), np.abs(eta), np.abs(points[:, 2]) / az
        section, by_u, by_v, by_p = _norm(u, v, 2.0 / e2)
        gauge, by_section, by_w, by_q = _norm(section, w, 2.0 / e1)
        by_u, by_v = by_section * by_u, by_section * by_v
        by_eta = by_v * np.sign(eta) - by_u * u * slope / f
        point = np.stack(
            [
                by_u * np.sign(points[:, 0]) / (ax * f),
                by_eta / ay,
                by_w * np.sign(points[:, 2]) / az,
            ],
            axis=1,
        )
        axes = -np.stack([by_u * u / ax, by_eta * eta / ay, by_w * w / az], axis=1)
        exponents = np.stack([by_q * -2.0 / e1**2, by_section * by_p * -2.0 / e2**2], axis=1)
        taper = -(by_u * u / f * (f > NARROWEST))[:, None] * np.stack([inside, inside**2], axis=1)
        return Gradient(gauge, point, axes, exponents, taper)

    def gauge(self, points: Array) -> Array:
        """Return G (N,) of points (N, 3) of the body frame."""
        (ax, ay, az), (e1, e2) = self.semi_axes, self.exponents
        eta = points[:, 1] / ay
        f, _, _ = self._width(eta)
        section = _power_norm(np.abs(points[:, 0]) / (ax * f), np.abs(eta), 2.0 / e2)
        return _power_norm(section, np.abs(points[:, 2]) / az, 2.0 / e1)

    def project(self, points: Array) -> Array:
        """Return where the rays from the axis through points (N, 3) meet the surface, body frame.

        Rays are straight in the body without its taper.
        """
        scale = 1.0 / np.maximum(self.gauge(points), _TINY)
        f, _, _ = self._width(points[:, 1] / self.semi_axes[1])
        moved = points * scale[:, None]
        g, _, _ = self._width(moved[:, 1] / self.semi_axes[1])
        moved[:, 0] *= g / f
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

    def mesh(self) -> Triangles:
        """Return triangles in the world, outward."""
        corners, faces = _unit_cube(_FACE)
        local = self._on_surface(corners)
        return trimesh.Trimesh(self.to_world(local), faces, process=False)

    @cached_property
    def _corners(self) -> cKDTree:
        return cKDTree(self._on_surface(_unit_cube(_FACE)[0]))

    @cached_property
    def area(self) -> float:
        """Area of the surface, m^2, of a coarse mesh: 1 to 3 % low."""
        return float(areas(self.semi_axes[None], self.exponents[None], self.taper[None])[0])

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

    def _on_surface(self, directions: Array) -> Array:
        """Return the surface points (N, 3), body frame, in directions of the unit body."""
        plain = Superquadric(np.ones(3), self.exponents)
        local = plain.project(directions) * self.semi_axes
        f, _, _ = self._width(local[:, 1] / self.semi_axes[1])
        local[:, 0] *= f
        return local

    def _width(self, eta: Array) -> tuple[Array, Array, Array]:
        """Return f, df/deta and eta inside of [-1, 1]; beyond the ends f is constant."""
        inside = np.clip(eta, -1.0, 1.0)
        k1, k2 = self.taper
        f = 1.0 + k1 * inside + k2 * inside**2
        slope = np.where((np.abs(eta) <= 1.0) & (f > NARROWEST), k1 + 2.0 * k2 * inside, 0.0)
        return np.maximum(f, NARROWEST), slope, inside


def areas(semi_axes: Array, exponents: Array, taper: Array) -> Array:
    """Return the areas (V,), m^2, of V superquadrics, from the coarse mesh of a quarter each.

    Args:
        semi_axes: (V, 3) m.
        exponents: (V, 2).
        taper: (V, 2).
    """
    corners, faces = _quarter(_COARSE)
    p, q = 2.0 / exponents[:, 1:], 2.0 / exponents[:, :1]
    section = _power_norm(corners[:, 0], np.abs(corners[:, 1]), p)
    local = corners / _power_norm(section, corners[:, 2], q)[..., None]
    eta = local[..., 1]
    f = np.maximum(1.0 + taper[:, :1] * eta + taper[:, 1:] * eta**2, NARROWEST)
    local *= semi_axes[:, None]
    local[..., 0] *= f
    a = local[:, faces[:, 0]]
    b, c = local[:, faces[:, 1]] - a, local[:, faces[:, 2]] - a
    return np.asarray(2.0 * np.linalg.norm(cross(b, c), axis=2).sum(axis=1))


@lru_cache(maxsize=4)
def _quarter(cells: int) -> tuple[Array, NDArray[np.intp]]:
    """Return corners (V, 3) and triangles (T, 3) of the cube's part with x, z >= 0."""
    corners, faces = _unit_cube(cells)
    middle = corners[faces].mean(axis=1)
    kept, places = np.unique(
        faces[(middle[:, 0] > 0.0) & (middle[:, 2] > 0.0)], return_inverse=True
    )
    return np.maximum(corners[kept], [0.0, -2.0, 0.0]), places.reshape(-1, 3)


def _norm(a: Array, b: Array, p: float) -> tuple[Array, Array, Array, Array]:
    """Return N = (a^p + b^p)^(1/p) of a, b >= 0 and its derivatives by a, b and p."""
    norm = np.maximum(_power_norm(a, b, p), _TINY)
    s, t = a / norm, b / norm
    by_a, by_b = s ** (p - 1.0), t ** (p - 1.0)
    entropy = by_a * s * np.log(np.maximum(s, _TINY)) + by_b * t * np.log(np.maximum(t, _TINY))
    return norm, by_a, by_b, norm * entropy / p


def _power_norm(a: Array, b: Array, p: float | Array) -> Array:
    """Return (a^p + b^p)^(1/p) of a, b >= 0 without overflow."""
    large = np.maximum(np.maximum(a, b), _TINY)
    return np.asarray(large * (1.0 + (np.minimum(a, b) / large) ** p) ** (1.0 / p))


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, _TINY))


@lru_cache(maxsize=4)
def _unit_cube(cells: int) -> tuple[Array, NDArray[np.intp]]:
    """Return corners (V, 3) and triangles (T, 3) of a gridded cube of half edge 1.

    The grid is denser towards the edges, where small exponents bend the surface.
    """
    line = np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, cells + 1))
    a, b = (part.ravel() for part in np.meshgrid(line, line, indexing="ij"))
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    quads = quads.reshape(-1, 4)
    corners: list[Array] = []
    faces: list[NDArray[np.intp]] = []
    for axis in range(3):
        for side in (1.0, -1.0):
            points = np.empty((len(a), 3))
            points[:, axis], points[:, axis - 2], points[:, axis - 1] = side, a, b
            turned = quads if side > 0 else quads[:, ::-1]
            faces.append(turned + len(a) * len(corners))
            corners.append(points)
    both = np.concatenate(faces)
    return np.concatenate(corners), np.concatenate([both[:, [0, 1, 2]], both[:, [0, 2, 3]]])
