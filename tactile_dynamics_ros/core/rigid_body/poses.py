"""Poses as descriptions write them: fixed-axis angles and centres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rpy_to_matrix(rpy: Sequence[float] | Array) -> Array:
    """R = R_z(yaw) R_y(pitch) R_x(roll) of fixed-axis angles (3,) in rad."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_of(xyz: Sequence[float] | Array, rpy: Sequence[float] | Array) -> Array:
    """Pose (4, 4) of a position (3,) in m and fixed-axis angles (3,) in rad, as in a URDF."""
    pose = np.eye(4)
    pose[:3, :3] = rpy_to_matrix(rpy)
    pose[:3, 3] = xyz
    return pose


def described_pose(values: Mapping[str, Any]) -> Array:
    """Pose (4, 4) of a description: ``centre`` in m and ``rpy_deg``, each zero where absent."""
    centre = np.asarray(values.get("centre", (0.0, 0.0, 0.0)), dtype=float)
    angles = np.asarray(values.get("rpy_deg", (0.0, 0.0, 0.0)), dtype=float)
    return pose_of(centre, np.deg2rad(angles))
