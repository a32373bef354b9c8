"""The idealised surface of a round fingertip: a cylinder about x that ends in a sphere.

Source: facts of the sensor's geometry (half cylinder for x < 0, sphere for x > 0).
"""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import cross

SKIN_RADIUS = 0.007
"""Radius of the idealised skin of a BioTac, m. Source: skin-projected electrodes of TAMS. It is
added to every contact point: a millimetre more moves all of them out by one."""
SKIN_REAR = -0.018
"""Where the sensing skin ends on the mount side, m. The skin of a BioTac reaches 18 mm behind the
tip's centre; less cuts off contacts on the side, more places them on the mount."""

_PAD = np.array([0.0, 0.0, -1.0])
"""Direction of the pad in the sensor frame, which is taken where a normal is not defined. Fixed by
the sensor frame; it matters at the very centre alone, where any direction is as good."""
_SPHERE, _CYLINDER = np.array([1.0, 1.0, 1.0]), np.array([0.0, 1.0, 1.0])
"""Which coordinates count in the distance from the sphere's centre and from the cylinder's axis.
Fixed by the cylinder's axis x in the sensor frame."""


def skin_normal(point: Array) -> Array:
    """Return the outward unit normal of the skin nearest to points.

    Args:
        point: (..., 3) in the sensor frame, m; need not lie on the skin.

    Returns:
        (..., 3) sensor frame.
    """
    radial = np.array(point, dtype=float)
    radial[..., 0] = np.maximum(radial[..., 0], 0.0)
    length = np.sqrt((radial**2).sum(axis=-1, keepdims=True))
    return np.where(length > 1e-9, radial / np.maximum(length, 1e-9), _PAD)


def project_to_skin(point: Array, radius: float = SKIN_RADIUS) -> Array:
    """Return the points of the skin that are nearest to ``point`` (..., 3), sensor frame, m."""
    point = np.asarray(point, dtype=float)
    axis = np.zeros_like(point)
    axis[..., 0] = np.minimum(np.maximum(point[..., 0], SKIN_REAR), 0.0)
    return np.asarray(axis + radius * skin_normal(point))


def point_under_force(force: Array, radius: float = SKIN_RADIUS) -> Array:
    """Return the skin point (..., 3) whose normal is along a force, pad middle for a cylinder.

    Args:
        force: (..., 3) on the object, sensor frame, N.
        radius: radius of the skin, m.
    """
    direction = skin_normal(force)
    backward = np.asarray(force, dtype=float)[..., 0] < 0.0
    point = radius * direction
    point[..., 0] = np.where(backward, -0.5 * radius, point[..., 0])
    return np.asarray(point)


def point_from_wrench(force: Array, torque: Array, radius: float = SKIN_RADIUS) -> Array:
    """Return the contact point of a wrench that has no moment about the contact normal.

    The line of action p = f x t / f.f + s f meets the skin where it leaves it.

    Args:
        force: (..., 3) on the object, sensor frame, N.
        torque: (..., 3) about the sensor origin, N m.
        radius: radius of the skin, m.

    Returns:
        (..., 3) m on the skin; where the line misses the skin, its nearest point.

    Source: Bicchi, Salisbury and Brock, 1993 (intrinsic contact sensing).
    """
    force, torque = np.asarray(force, dtype=float), np.asarray(torque, dtype=float)
    strength = np.linalg.norm(force, axis=-1, keepdims=True)
    strong = strength > 1e-9
    safe = np.where(strong, strength, 1.0)
    direction = np.where(strong, force / safe, _PAD)
    foot = cross(force, torque) / safe**2
    sphere = _far_root(foot, direction, _SPHERE, radius)
    cylinder = _far_root(foot, direction, _CYLINDER, radius)
    with np.errstate(invalid="ignore"):
        ahead, behind = sphere[..., :1] >= 0.0, cylinder[..., :1] < 0.0
    return project_to_skin(np.where(ahead, sphere, np.where(behind, cylinder, foot)), radius)


def _far_root(foot: Array, direction: Array, weight: Array, radius: float) -> Array:
    """Return the farther solution (..., 3) of |W (foot + s direction)| = radius, NaN if none."""
    a = (direction * direction) @ weight
    b = (foot * direction) @ weight
    c = (foot * foot) @ weight - radius**2
    discriminant = b * b - a * c
    found = (a > 1e-9) & (discriminant >= 0.0)
    root = np.sqrt(np.where(found, discriminant, np.nan))
    reach = (root - b) / np.where(found, a, 1.0)
    return np.asarray(foot + reach[..., None] * direction)
