"""Quasi-static motion by an ellipsoid in place of the friction of every point."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array


def ellipsoid_twist(wrench: Array, radius: Array) -> Array:
    """Direction (B, 3) of the twist under a wrench on the ellipsoid's limit surface.

    (v_x, v_y, omega) ~ (F_x, F_y, tau / radius^2)

    Args:
        wrench: (B, 3) on the object about its centre of friction, N, N m.
        radius: (B,) largest torque over largest force, m.

    Source: Howe and Cutkosky 1996; Lynch, Maekawa and Tanie 1992.
    """
    return np.concatenate([wrench[:, :2], wrench[:, 2:] / np.square(radius)[:, None]], axis=1)


def sticking_twist(contact: Array, velocity: Array, radius: Array) -> Array:
    """Twist (B, 3) of the centre of friction when the pusher's point sticks to the object.

    v_x = ((l^2 + c_x^2) p_x + c_x c_y p_y) / (l^2 + c_x^2 + c_y^2)
    v_y = (c_x c_y p_x + (l^2 + c_y^2) p_y) / (l^2 + c_x^2 + c_y^2)
    omega = (c_x v_y - c_y v_x) / l^2

    Args:
        contact: (B, 2) point c relative to the centre of friction, m.
        velocity: (B, 2) p of the pusher, m/s.
        radius: (B,) l, m.

    Source: Lynch, Maekawa and Tanie 1992; paper B, Eq. 47 and 48 print both components alike.
    """
    x, y = contact.T
    square = np.square(radius)
    along = np.einsum("bi,bi->b", contact, velocity)
    linear = (square[:, None] * velocity + contact * along[:, None]) / (square + x * x + y * y)[
        :, None
    ]
    turning = (x * linear[:, 1] - y * linear[:, 0]) / square
    return np.column_stack([linear, turning])


def pushed_twist(
    contact: Array, normal: Array, velocity: Array, radius: Array, friction: Array
) -> Array:
    """Twist (B, 3) of the centre of friction under a pusher that sticks or slips.

    Outside the motion cone the force lies on an edge of the friction cone; the object then moves as
    that force says, with the pusher's speed along the normal.

    Args:
        contact: (B, 2) m from the centre of friction.
        normal: (B, 2) into the object.
        velocity: (B, 2) of the pusher, m/s.
        radius: (B,) m.
        friction: (B,) coefficient between pusher and object.

    Source: Mason 1986; Lynch, Maekawa and Tanie 1992.
    """
    stick = sticking_twist(contact, velocity, radius)
    force = stick[:, :2]
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    along_normal = np.einsum("bi,bi->b", force, normal)
    along_tangent = np.einsum("bi,bi->b", force, tangent)
    slips = np.abs(along_tangent) > friction * along_normal
    edge = normal + (friction * np.sign(along_tangent))[:, None] * tangent
    torque = contact[:, 0] * edge[:, 1] - contact[:, 1] * edge[:, 0]
    slide = ellipsoid_twist(np.column_stack([edge, torque]), radius)
    at_contact = slide[:, :2] + slide[:, 2:] * np.stack([-contact[:, 1], contact[:, 0]], axis=1)
    speed = np.einsum("bi,bi->b", velocity, normal) / np.einsum("bi,bi->b", at_contact, normal)
    return np.where(slips[:, None], np.maximum(speed, 0.0)[:, None] * slide, stick)
