"""The rigid motion between two sets of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import nearest_rotation

Array = NDArray[np.float64]


def align_points(points: Array, reference: Array) -> tuple[Array, Array]:
    """Return R (3, 3) and t (3,) that bring points onto a reference, min sum |R p_k + t - q_k|^2.

    Args:
        points: (K, 3), at least three.
        reference: (K, 3).

    Source: Kabsch 1976.
    """
    centre, goal = points.mean(axis=0), reference.mean(axis=0)
    turn = nearest_rotation((reference - goal).T @ (points - centre))
    return np.asarray(turn), np.asarray(goal - turn @ centre)
