"""Clouds: which points belong together, how noisy they are, and in which frame they are read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.shape.superquadric.recovery import LEAST_POINTS, spread_choice

_NEIGHBOURS = 8
"""Neighbours that tell the spacing of a cloud: enough to jump over strays. Fewer give the spacing
within a scan line, more that across the object."""
_REACH = 3.0
"""Distance, in spacings to the eighth neighbour, within which points belong together. At 2 a sparse
side falls off, at 5 objects that stand 1 cm apart run together."""
_LEAST_SHARE = 0.02
"""Share of all points that a cluster needs to be an object and no strays: with a tenth of strays in
the box around an object few clusters of strays have so many. Lower makes objects of strays, higher
overlooks small objects beside large ones."""
_PATCH = 12
"""Neighbours of a patch whose distances from its plane tell the noise of the camera. Fewer fit the
plane to the noise itself (three are used up), more reach around curved sides."""
_PATCHES = 300
"""Patches that are looked at: their median is then known to some percent. Fewer make the noise
chance, more cost time."""


def reach_of(points: Array) -> float:
    """Return the distance within which points belong together, m."""
    count = min(_NEIGHBOURS + 1, len(points))
    return _REACH * float(np.median(cKDTree(points).query(points, count)[0][:, -1]))


def clusters(points: Array, reach: float | None = None) -> list[NDArray[np.intp]]:
    """Return indices of the points of each object, the largest first.

    Args:
        points: (N, 3) m.
        reach: distance within which points belong together, m; by their spacing if None.
    """
    reach = reach_of(points) if reach is None else reach
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    _, label = connected_components(graph, directed=False)
    sizes = np.bincount(label)
    least = max(LEAST_POINTS, _LEAST_SHARE * len(points))
    order = np.argsort(-sizes, kind="stable")
    return [np.flatnonzero(label == k) for k in order if sizes[k] >= least]


def camera_noise(points: Array) -> float:
    """Return the noise across the surface, m: distances from the planes of small patches."""
    chosen = points[spread_choice(points, _PATCHES)]
    count = min(_PATCH, len(points))
    patch = points[cKDTree(points).query(chosen, count)[1]]
    values = np.linalg.svd(patch - patch.mean(axis=1, keepdims=True), compute_uv=False)
    return float(np.median(values[:, 2]) / np.sqrt(max(count - 3, 1)))


def own_frame(points: Array, upright: bool) -> Array:
    """Return the pose X (4, 4) of a frame that moves and turns with a cloud.

    Its axes are the principal ones, the longest first; each points to the side of the longer tail
    (a positive third moment).

    Args:
        points: (N, 3) m.
        upright: whether z, and the height z = 0, stay those of the world.
    """
    count = 2 if upright else 3
    middle = points[:, :count].mean(axis=0)
    apart = points[:, :count] - middle
    axes = np.linalg.eigh(apart.T @ apart)[1][:, ::-1]
    axes = axes * np.where(np.sum((apart @ axes) ** 3, axis=0) < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, -1] *= -1.0
    frame = np.eye(4)
    frame[:count, :count], frame[:count, 3] = axes, middle
    return frame


def into(frame: Array, points: Array) -> Array:
    """Return points (N, 3) of the world in a frame (4, 4)."""
    return np.asarray((points - frame[:3, 3]) @ frame[:3, :3])
