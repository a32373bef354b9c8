"""Newton-Euler residual of a pose triple by finite differences. Source: paper A, Eq. 4-15."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.rigid_body.newton_euler import inertia_map
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, skew


@dataclass(frozen=True)
class TripleKinematics:
    """Kinematics in the body frame at the first pose of each triple.

    Attributes:
        specific: (..., 3) a - g, m/s^2.
        acceleration: (..., 3) angular acceleration, rad/s^2.
        early: (..., 3) angular velocity between the first two poses, rad/s.
        late: (..., 3) angular velocity between the last two poses, rad/s.
    """

    specific: Array
    acceleration: Array
    early: Array
    late: Array


def _log_pose(rotation: Array, translation: Array) -> tuple[Array, Array]:
    """Logarithm (omega, v) of rigid motions."""
    omega = log_so3(rotation)
    angle = np.linalg.norm(omega, axis=-1)[..., None, None]
    safe = np.where(angle < 1e-4, 1.0, angle)
    half = 0.5 * safe
    factor = np.where(angle < 1e-4, 1.0 / 12.0, (1.0 - half / np.tan(half)) / safe**2)
    cross = skew(omega)
    inverse = np.eye(3) - 0.5 * cross + factor * cross @ cross
    return omega, np.asarray((inverse @ translation[..., None])[..., 0])


def differentiate(rotation: Array, position: Array, time: Array) -> TripleKinematics:
    """Velocities of Eq. 6-9, moved to the first frame by Eq. 10-11, and their rate, Eq. 12-13.

    Args:
        rotation: (..., 3, 3, 3) R_WO of the three poses.
        position: (..., 3, 3) m.
        time: (..., 3) s.
    """
    step = np.diff(time, axis=-1)[..., None]
    to_body = np.swapaxes(rotation[..., :2, :, :], -1, -2)
    relative = to_body @ rotation[..., 1:, :, :]
    moved = (to_body @ np.diff(position, axis=-2)[..., None])[..., 0]
    omega, velocity = (part / step for part in _log_pose(relative, moved))
    early, late = omega[..., 0, :], omega[..., 1, :]
    span = step[..., 1, :]
    turned_rate = late + np.cross(early, late) * span
    turned_velocity = velocity[..., 1, :] + np.cross(early, velocity[..., 1, :]) * span
    gravity = np.einsum("...ji,j->...i", rotation[..., 0, :, :], GRAVITY_W)
    return TripleKinematics(
        specific=(turned_velocity - velocity[..., 0, :]) / span - gravity,
        acceleration=(turned_rate - early) / span,
        early=early,
        late=late,
    )


def regressor(motion: TripleKinematics) -> Array:
    """Rows [A; B] of Eq. 14-15 as a linear map of [m, m r_c, H], (..., 6, 10)."""
    turning = skew(motion.acceleration) + skew(motion.late) @ skew(motion.early)
    matrix = np.zeros((*motion.specific.shape[:-1], 6, 10))
    matrix[..., :3, 0] = motion.specific
    matrix[..., :3, 1:4] = turning
    matrix[..., 3:, 1:4] = -skew(motion.specific)
    matrix[..., 3:, 4:] = inertia_map(motion.acceleration) + skew(motion.late) @ inertia_map(
        motion.early
    )
    return matrix


def net_wrench(point: Array, force: Array) -> Array:
    """[sum f; sum p x f] of (..., C, 3) contacts."""
    total, torque = force.sum(axis=-2), np.cross(point, force).sum(axis=-2)
    return np.concatenate([total, torque], axis=-1)
