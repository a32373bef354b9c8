"""Average of noisy poses of a body at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3

Array = NDArray[np.float64]

_ITERATIONS = 10
"""Steps to the mean rotation, at most. They end earlier when a step is below 1e-12 rad: after four
where poses scatter by 0.6 deg, five by 3 deg, eight by 17 deg. Fewer leave the mean off where poses
scatter widely."""


def average_poses(poses: Array) -> tuple[Array, Array]:
    """Return the mean pose and the covariance of that mean.

    The rotation is the Karcher mean, sum log(R_mean^T R_i) = 0.

    Args:
        poses: (N, 4, 4) X_WO, N >= 2.

    Returns:
        (4, 4) mean, (6, 6) covariance [rotation, position] about world axes, rad and m.

    Raises:
        BadInputError: fewer than two poses.
    """
    poses = np.asarray(poses, dtype=float)
    if len(poses) < 2:
        raise BadInputError(f"average of poses: {len(poses)} given, expected at least 2")
    rotation = poses[0, :3, :3]
    for _ in range(_ITERATIONS):
        step = log_so3(poses[:, :3, :3] @ rotation.T).mean(axis=0)
        rotation = exp_so3(step) @ rotation
        if np.linalg.norm(step) < 1e-12:
            break
    mean = np.eye(4)
    mean[:3, :3] = rotation
    mean[:3, 3] = poses[:, :3, 3].mean(axis=0)
    spread = np.hstack([log_so3(poses[:, :3, :3] @ rotation.T), poses[:, :3, 3] - mean[:3, 3]])
    return mean, spread.T @ spread / (len(poses) - 1) / len(poses)
