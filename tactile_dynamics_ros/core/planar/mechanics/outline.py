"""Outlines on the support: areas, points that carry load, distance to the edges."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError


def area_and_centroid(outline: Array) -> tuple[float, Array]:
    """Signed area, m^2 (positive counter-clockwise), and centroid (2,), m, of a polygon (V, 2)."""
    after = np.roll(outline, -1, axis=0)
    turn = outline[:, 0] * after[:, 1] - outline[:, 1] * after[:, 0]
    area = 0.5 * float(turn.sum())
    if area == 0.0:
        return 0.0, np.asarray(outline.mean(axis=0))
    return area, np.asarray((turn[:, None] * (outline + after)).sum(axis=0) / (6.0 * area))


def load_points(outline: Array, count: int) -> tuple[Array, Array]:
    """Centroids (n, 2), m, and shares (n,) of the area of the square cells of an outline.

    Args:
        outline: (V, 2) m, a polygon without crossings.
        count: points wanted, roughly.

    Raises:
        BadInputError: fewer than three vertices, or they enclose no area.
    """
    area = abs(area_and_centroid(outline)[0]) if len(outline) >= 3 else 0.0
    if area <= 1e-10:
        raise BadInputError(
            f"footprint: {len(outline)} vertices enclose {area:.2g} m^2; expected an outline in "
            "metres with three vertices at least"
        )
    low, high = outline.min(axis=0), outline.max(axis=0)
    cells = np.maximum(np.round((high - low) / np.sqrt(area / count)), 1).astype(int)
    size = (high - low) / cells
    parts = []
    for column in range(cells[0]):
        left = low[0] + column * size[0]
        strip = _between(outline, 0, left, left + size[0])
        for row in range(cells[1]):
            bottom = low[1] + row * size[1]
            cell = _between(strip, 1, bottom, bottom + size[1])
            if len(cell) >= 3:
                parts.append(area_and_centroid(cell))
    areas = np.abs([part[0] for part in parts])
    kept = areas > 1e-6 * areas.max()
    points = np.array([part[1] for part in parts])[kept]
    return points, areas[kept] / areas[kept].sum()


def _between(polygon: Array, axis: int, low: float, high: float) -> Array:
    """Part of a polygon between two lines along the other axis (Sutherland and Hodgman 1974)."""
    return _below(-_below(-polygon, axis, -low), axis, high)


def _below(polygon: Array, axis: int, limit: float) -> Array:
    if len(polygon) == 0:
        return polygon
    kept = []
    for start, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if start[axis] <= limit:
            kept.append(start)
        if (start[axis] <= limit) != (end[axis] <= limit):
            share = (limit - start[axis]) / (end[axis] - start[axis])
            kept.append(start + share * (end - start))
    return np.array(kept).reshape(-1, 2)


def edge_normals(outline: Array) -> Array:
    """Outward unit normals (V, 2) of the edges that begin at each vertex."""
    along = np.roll(outline, -1, axis=0) - outline
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    if area_and_centroid(outline)[0] < 0.0:
        normal = -normal
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def nearest_edge(outline: Array, normals: Array, point: Array) -> tuple[Array, Array]:
    """Depth (B,) of points in a convex outline, m, and normals (B, 2) into the object there.

    Args:
        outline: (V, 2) m.
        normals: (V, 2) outward.
        point: (B, 2) m, frame of the outline. Depth is negative outside.
    """
    distance = point @ normals.T - np.einsum("vi,vi->v", outline, normals)
    edge = np.argmax(distance, axis=1)
    return -distance[np.arange(len(point)), edge], -normals[edge]


def convex_hull(outline: Array) -> Array:
    """Vertices (H, 2) of the convex hull of points (V, 2), anticlockwise (Andrew 1979)."""
    points = np.unique(outline, axis=0)
    halves = []
    for ordered in (points, points[::-1]):
        chain: list[Array] = []
        for point in ordered:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        halves.append(chain[:-1])
    return np.array(halves[0] + halves[1])


def _turn(a: Array, b: Array, c: Array) -> float:
    """Twice the signed area of a triangle, m^2; positive anticlockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
