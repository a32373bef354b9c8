"""The gauge of superquadrics in logarithms: values and slopes of many shapes and points at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import cross

NARROWEST = 0.02
"""Least value of the taper f on the body, so that it stays positive: the tip of a triangle keeps 2
% of the width. At zero the surface folds there and its normal is undefined. More blunts the tips of
triangles."""
TINY = 1e-12
"""Smallest length over a semi-axis whose logarithm is taken: far below rounding of any length.
Anything between rounding and a millionth has the same effect; zero has no logarithm."""
_LEAST_SLOPE = 1e-9
"""Smallest norm of the gradient of ln G, 1/m, that is divided by: only the very centre has less.
Larger would shorten normals near it, zero divides by zero there."""
_COARSE = 8
"""Cells along an edge of the cube whose surface is mapped to a mesh for the area: 768 triangles.
What matters is how the area changes with the shape, which is right to 1 % of itself. Half as many
are visibly off for round shapes, twice as many take four times as long in each step."""


@dataclass(frozen=True)
class Parameters:
    """Shapes of superquadrics with any leading shape (...).

    Attributes:
        semi_axes: (..., 3) m.
        exponents: (..., 2).
        taper: (..., 2).
    """

    semi_axes: Array
    exponents: Array
    taper: Array

    def width(self, eta: Array) -> tuple[Array, Array, Array]:
        """Return f, df/deta and eta inside of [-1, 1]; beyond the ends f is constant.

        Args:
            eta: (..., N) y over its semi-axis.
        """
        inside = np.clip(eta, -1.0, 1.0)
        k1, k2 = self.taper[..., :1], self.taper[..., 1:]
        f = 1.0 + (k1 + k2 * inside) * inside
        moves = (inside == eta) & (f > NARROWEST)
        return np.maximum(f, NARROWEST), np.where(moves, k1 + 2.0 * k2 * inside, 0.0), inside


@dataclass(frozen=True)
class LogGauge:
    """ln G of points and its slopes along the logarithms of u = x/(a_x f), v = y/a_y, w = z/a_z.

    With p = 2/e2 and q = 2/e1, G = ((u^p + v^p)^(q/p) + w^q)^(1/q) is a softened maximum of the
    three logarithms; its slopes are shares that sum to 1 and do not change along rays.

    Attributes:
        log: (..., N) ln G.
        by_u, by_v, by_w: (..., N) shares.
        by_e1, by_e2: (..., N) slopes along the exponents.
    """

    log: Array
    by_u: Array
    by_v: Array
    by_w: Array
    by_e1: Array
    by_e2: Array

    @classmethod
    def of(cls, u: Array, v: Array, w: Array, exponents: Array) -> LogGauge:
        """Gauge of coordinates (..., N), over the semi-axes, with exponents (..., 2)."""
        e1, e2 = exponents[..., :1], exponents[..., 1:]
        ln_u, ln_v, ln_w = (np.log(np.maximum(np.abs(a), TINY)) for a in (u, v, w))
        section, in_u, spread = _softened(ln_u, ln_v, 2.0 / e2)
        log, in_section, outer = _softened(section, ln_w, 2.0 / e1)
        by_e2 = -in_section * spread / e2
        return cls(
            log,
            in_section * in_u,
            in_section * (1.0 - in_u),
            1.0 - in_section,
            -outer / e1,
            by_e2,
        )


def _softened(a: Array, b: Array, power: Array) -> tuple[Array, Array, Array]:
    """Return s = ln (e^(pa) + e^(pb))^(1/p), the share of a in it, and p ds/dp."""
    apart = power * (a - b)
    less = np.exp(-np.abs(apart))
    log = np.maximum(a, b) + np.log1p(less) / power
    share = np.where(apart > 0.0, 1.0, less) / (1.0 + less)
    return log, share, share * (a - log) + (1.0 - share) * (b - log)


@dataclass(frozen=True)
class Foot:
    """Where rays from the axis through points meet a surface, and the distance along its normal.

    Rays are straight in the body without its taper; the shares of the gauge are the same all along
    them, so that one evaluation serves both ends.

    Attributes:
        gauge: of the points.
        point: (..., 3, N) of the surface, m. normal: (..., 3, N) outward, unit.
        distance: (..., N) from there to the points along the normal, m, positive outside.
        steepness: (..., N) length of the gradient of ln G, 1/m.
        by_width, by_y: (..., N) slopes of ln G along ln f, and along ln y with the taper it brings.
        inside: (..., N) y over its semi-axis, within [-1, 1].
    """

    gauge: LogGauge
    point: Array
    normal: Array
    distance: Array
    steepness: Array
    by_width: Array
    by_y: Array
    inside: Array

    @classmethod
    def of(cls, shape: Parameters, local: Array) -> Foot:
        """Meet a surface from points (..., 3, N) of the body frame, m."""
        axes = shape.semi_axes[..., None]
        eta = local[..., 1, :] / axes[..., 1, :]
        f, _, _ = shape.width(eta)
        u, w = local[..., 0, :] / (axes[..., 0, :] * f), local[..., 2, :] / axes[..., 2, :]
        at = LogGauge.of(u, eta, w, shape.exponents)
        point = local * np.exp(-at.log)[..., None, :]
        eta = point[..., 1, :] / axes[..., 1, :]
        g, slope, inside = shape.width(eta)
        point[..., 0, :] *= g / f
        by_width = at.by_u / g
        by_eta = by_width * slope
        steep = np.empty_like(local)
        x, y, z = (_apart_from_zero(point[..., k, :]) for k in range(3))
        steep[..., 0, :] = at.by_u / x
        steep[..., 1, :] = at.by_v / y - by_eta / axes[..., 1, :]
        steep[..., 2, :] = at.by_w / z
        steepness = np.maximum(np.sqrt(np.sum(steep**2, axis=-2)), _LEAST_SLOPE)
        normal = steep / steepness[..., None, :]
        distance = np.sum((local - point) * normal, axis=-2)
        by_width = by_width * (g > NARROWEST)
        by_y = at.by_v - by_eta * eta
        return cls(at, point, normal, distance, steepness, by_width, by_y, inside)


def _apart_from_zero(values: Array) -> Array:
    return np.where(np.abs(values) < TINY, TINY, values)


def surface_points(shapes: Parameters, directions: Array) -> tuple[Array, LogGauge, Array]:
    """Return surface points in directions of the unit body, the gauge there, and df/deta.

    Args:
        shapes: (...,).
        directions: (V, 3).

    Returns:
        (..., V, 3) m in the body frame; the gauge of the directions; (..., V).
    """
    gauge = LogGauge.of(directions[:, 0], directions[:, 1], directions[:, 2], shapes.exponents)
    unit = directions * np.exp(-gauge.log)[..., None]
    f, slope, _ = shapes.width(unit[..., 1])
    points = unit * shapes.semi_axes[..., None, :]
    points[..., 0] *= f
    return points, gauge, slope


def areas(shapes: Parameters) -> tuple[Array, Array]:
    """Return areas (...,), m^2, of the coarse mesh, and the slopes (..., 7) of their logarithms.

    The slopes are along ln a_x, ln a_y, ln a_z, e1, e2, k1 and k2. The mesh lies 1 to 3 % inside.
    """
    corners, faces, gather = _quarter(_COARSE)
    points, gauge, slope = surface_points(shapes, corners)
    a = points[..., faces[:, 0], :]
    b, c = points[..., faces[:, 1], :] - a, points[..., faces[:, 2], :] - a
    normal = cross(b, c)
    size = np.linalg.norm(normal, axis=-1)
    normal /= np.maximum(size, TINY**2)[..., None]
    by_b, by_c = cross(c, normal), cross(normal, b)
    pull = np.concatenate([-by_b - by_c, by_b, by_c], axis=-2)
    flat = np.moveaxis(pull.reshape(-1, *pull.shape[-2:]), 1, 0).reshape(pull.shape[-2], -1)
    force = np.moveaxis((gather @ flat).reshape(len(corners), -1, 3), 0, 1)
    by_log = force.reshape(points.shape) * points
    area = size.sum(axis=-1)
    eta = points[..., 1] / shapes.semi_axes[..., 1:2]
    f, _, _ = shapes.width(eta)
    by_f = by_log[..., 0] / f
    ray = -(by_log.sum(axis=-1) + by_f * slope * eta)
    by_k1 = by_f * eta * (f > NARROWEST)
    slopes = np.stack(
        [*np.moveaxis(by_log, -1, 0), ray * gauge.by_e1, ray * gauge.by_e2, by_k1, by_k1 * eta],
        axis=-1,
    ).sum(axis=-2)
    return 2.0 * area, np.asarray(slopes / area[..., None])


@lru_cache(maxsize=4)
def _quarter(cells: int) -> tuple[Array, NDArray[np.intp], Any]:
    """Return corners, triangles and sums at corners of a quarter of the cube, x and z >= 0.

    Corners are (V, 3), triangles (T, 3); the matrix (V, 3 T) adds up at corners what acts on the
    triangles.
    """
    corners, faces = unit_cube(cells)
    middle = corners[faces].mean(axis=1)
    kept, places = np.unique(
        faces[(middle[:, 0] > 0.0) & (middle[:, 2] > 0.0)], return_inverse=True
    )
    faces = places.reshape(-1, 3)
    rows = faces.T.ravel()
    gather = csr_matrix((np.ones(len(rows)), (rows, np.arange(len(rows)))))
    return np.maximum(corners[kept], [0.0, -2.0, 0.0]), faces, gather


@lru_cache(maxsize=4)
def unit_cube(cells: int) -> tuple[Array, NDArray[np.intp]]:
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
