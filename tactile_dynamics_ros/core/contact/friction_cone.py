"""How a contact force lies in the friction cone of its contact: what the grip has in hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
