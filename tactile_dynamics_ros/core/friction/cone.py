"""Coulomb's cone: the coefficient of a force, the share it uses, directions along a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError

Array = NDArray[np.float64]


def split_force(force: Array, normal: Array) -> tuple[float, float]:
    """Return the normal force f . n and the tangential force |f - (f . n) n|, N.

    Args:
        force: (3,) on the object, N.
        normal: (3,) unit vector into the object, same axes.
    """
    press = float(force @ normal)
    return press, float(np.linalg.norm(force - press * normal))


def cone_share(force: Array, normal: Array, friction: float) -> float:
    """Return the share |f_t| / (mu f_n) of the friction cone that is used; above 1 it would slip.

    Infinite without normal force, but zero without any force.
    """
    press, drag = split_force(force, normal)
    if press <= 0.0:
        return np.inf if drag > 0.0 or press < 0.0 else 0.0
    return drag / (friction * press)


def distance_beyond(force: Array, normal: Array, friction: float) -> float:
    """Return how far (N) a force lies outside the cone |f_t| <= mu f_n, zero inside.

    Coulomb friction cannot hold such a force, so that a measurement of it is off by that much at
    least: |f_t - mu f_n| / sqrt(1 + mu^2), or |f| where the nearest point is the tip of the cone.
    """
    press, drag = split_force(force, normal)
    if drag <= friction * press:
        return 0.0
    if press + friction * drag <= 0.0:
        return float(np.hypot(press, drag))
    return (drag - friction * press) / float(np.hypot(1.0, friction))


def friction_coefficient(force: Array, normal: Array) -> float:
    """Return mu = tan(acos(f.n / |f|)), the slope of a force that is about to slip.

    Args:
        force: (3,) N on the object just before it slips.
        normal: (3,) into the object, same frame; need not be a unit vector.

    Raises:
        BadInputError: the force does not press, or there is no normal.

    Source: paper A, Eq. 1.
    """
    strength = float(np.linalg.norm(force) * np.linalg.norm(normal))
    pressing = float(np.dot(force, normal))
    if pressing <= 0.0:
        raise BadInputError(
            f"friction: the force {np.round(force, 3).tolist()} N does not press along the normal "
            f"{np.round(normal, 3).tolist()}; expected a normal into the object"
        )
    return float(np.tan(np.arccos(min(pressing / strength, 1.0))))


def tangent_basis(normal: Array, along: Array) -> Array:
    """Return two unit vectors (2, 3) that span the plane of contact, e1 x e2 = normal.

    Args:
        normal: (3,) unit vector.
        along: (3,) direction whose projection becomes e1; another is taken if it is too steep.
    """
    for candidate in (along, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])):
        first = candidate - (candidate @ normal) * normal
        length = float(np.linalg.norm(first))
        if length > 0.3 * float(np.linalg.norm(candidate)):
            break
    first = first / length
    return np.stack([first, np.cross(normal, first)])


def probing_angles(count: int) -> Array:
    """Return angles (K,), rad, that cover the circle in opposite pairs, coarse to fine.

    A slip moves the fingertip; the opposite slip that follows moves it back, and errors of the
    force's direction cancel between the two.
    """
    pairs = np.array([0.0, 0.25, 0.125, 0.375])
    turns = np.stack([pairs, pairs + 0.5], axis=1).reshape(-1)
    return 2.0 * np.pi * np.resize(turns, count)
