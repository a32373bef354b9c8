"""Where gravity points in a recorded world that lies in no direction people choose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.inertia.conventions.balance import net_force
from tactile_dynamics_ros.core.inertia.conventions.motions import Motions
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.core.streams.streams import Streams

Array = NDArray[np.float64]

_TILT = 0.3
"""Angle, rad, from -z up to which a world that leans is the effect `gravity_tilt`, whose prior has
this standard deviation. Below, cables and springs are held against it; at 0.1 they are called a
convention, at 1 worlds between are found by nothing."""
_AXIS = 0.05
"""Angle, rad, from an axis up to which gravity acts along it: 3 deg, as worlds are levelled to."""


def felt_gravity(streams: Streams) -> Array | None:
    """Direction (3,) of gravity that the forces show, recorded world.

    f = m (a - g) + R b + m R ([w'] + [w]^2) c is linear in m, m g, b and m c; the mass by the
    acceleration decides the sign.

    Args:
        streams: measurements whose contacts share their stamps.

    Returns:
        A unit vector; None near -z or an axis, and where no pose says the accelerations.
    """
    if streams.pose is None or streams.imu is not None:
        return None
    stamps = next(iter(streams.contacts.values())).time
    course = Motions().read(streams, stamps)
    motion, valid = course.motion, course.valid
    rate = skew(motion.angular_velocity_B)
    turning = motion.rotation @ (skew(motion.angular_acceleration_B) + rate @ rate)
    still = np.broadcast_to(np.eye(3), motion.rotation.shape)
    parts = [motion.acceleration[..., None], still, motion.rotation, turning]
    columns = np.concatenate(parts, axis=2)[valid]
    force = net_force(streams)[valid]
    if len(force) < columns.shape[2]:
        return None
    flat = columns.reshape(-1, columns.shape[2])
    found = np.linalg.lstsq(flat, force.ravel(), rcond=None)[0]
    down = -found[1:4] * np.sign(found[0])
    length = float(np.linalg.norm(down))
    if length == 0.0:
        return None
    down = down / length
    near = np.abs(down).max() > np.cos(_AXIS) or -down[2] > np.cos(_TILT)
    return None if near else np.asarray(down)
