"""A cloud's own frame: a fit in it is the same wherever the cloud lies and however it is turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
