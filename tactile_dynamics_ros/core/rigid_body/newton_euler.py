"""Newton-Euler equations of one rigid body, linear in its ten dynamic parameters."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import skew

_INERTIA_MAP = np.zeros((3, 18))
"""Where each component of v stands in K(v), I v = K(v) [I_xx, ..., I_zz]; (3, 18). Fixed by the
order of the six numbers; another one here alone gives torques of another body."""
_INERTIA_MAP[[0, 1, 2, 0, 1, 2, 0, 1, 2], [0, 1, 3, 7, 8, 10, 15, 16, 17]] = 1.0


def inertia_map(vector: Array) -> Array:
    """Matrix K(v) with ``I v = K(v) [I_xx, I_xy, I_yy, I_xz, I_yz, I_zz]``.

    Args:
        vector: (..., 3).

    Returns:
        (..., 3, 6).
    """
    v = np.asarray(vector, dtype=float)
    return np.asarray((v @ _INERTIA_MAP).reshape(*v.shape[:-1], 3, 6))


def regressor(
    specific_acceleration: Array, angular_velocity: Array, angular_acceleration: Array
) -> Array:
    """Regressor Y of the net contact wrench, ``[torque, force] = Y phi``, body frame and origin.

    torque = m c x s + I w' + w x I w;  force = m s + w' x m c + w x (w x m c),  s = R_OW (a_O - g).

    Args:
        specific_acceleration: (N, 3) s, m/s^2, body frame.
        angular_velocity: (N, 3) w, rad/s, body frame.
        angular_acceleration: (N, 3) w', rad/s^2, body frame.

    Returns:
        (N, 6, 10); phi = [m, m c, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz] about the origin.

    Source: Atkeson, An, Hollerbach 1986, Eq. 7-9; paper A, Eq. 2-3 (the sign of the w' term
        there is that of [r_c] x w' = -w' x r_c).
    """
    s, w, dw = (
        np.asarray(value, dtype=float)
        for value in (specific_acceleration, angular_velocity, angular_acceleration)
    )
    cross = skew(w)
    matrix = np.zeros((*s.shape[:-1], 6, 10))
    matrix[..., :3, 1:4] = -skew(s)
    matrix[..., :3, 4:] = inertia_map(dw) + cross @ inertia_map(w)
    matrix[..., 3:, 0] = s
    matrix[..., 3:, 1:4] = skew(dw) + cross @ cross
    return matrix
