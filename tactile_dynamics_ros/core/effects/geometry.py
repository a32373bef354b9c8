"""Wrenches of forces at points, vectorised over samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples, once_per_motion
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, skew

AXES = "xyz"
"""Components of vectors, as they end the names of parameters. Other endings would break names that
people use."""

_REACH = 2
"""Samples to either side between which the rates of contacts are taken: 40 ms at 100 Hz. Noise of
frames falls as its inverse; motion faster than 10 Hz is cut. With one sample noise of frames
doubles, with four motion of 5 Hz is cut."""


def to_body(samples: WrenchSamples, vectors: Array) -> Array:
    """World vectors (N, 3) or one (3,) in the body frame, R_OW v, (N, 3)."""
    vectors = np.broadcast_to(vectors, samples.position.shape)
    return np.asarray(np.einsum("nji,nj->ni", samples.rotation, vectors))


def body_from_world(samples: WrenchSamples) -> Array:
    """R_OW, (N, 3, 3): columns are the world axes in the body frame."""
    return np.swapaxes(samples.rotation, 1, 2)


def force_at(point: Array, force: Array) -> Array:
    """Wrench [p x f, f] of a force at a body point.

    Args:
        point: (3,) or (..., 3) body frame.
        force: (..., 3) body frame.
    """
    force = np.asarray(force, dtype=float)
    return np.concatenate([np.cross(np.broadcast_to(point, force.shape), force), force], axis=-1)


def force_columns(point: Array, forces: Array) -> Array:
    """Wrench columns (N, 6, m) of force columns (N, 3, m) at a body point (3,) or (N, 3)."""
    return np.concatenate([skew(point) @ forces, forces], axis=1)


def torque_columns(torques: Array) -> Array:
    """Wrench columns (N, 6, m) of pure torque columns (N, 3, m)."""
    return np.concatenate([torques, np.zeros_like(torques)], axis=1)


def point_columns(force: Array) -> Array:
    """Derivative by p of [p x f, f]: [-skew(f), 0], (N, 6, 3), for forces (N, 3)."""
    return torque_columns(-skew(force))


def arm_basis(force: Array) -> Array:
    """Nine torques e_j x f_k for three force columns (N, 3, 3) -> (N, 6, 9), j slowest."""
    cross = skew(np.eye(3))
    torques = np.einsum("jab,nbk->najk", cross, force).reshape(len(force), 3, 9)
    return torque_columns(torques)


def vector_parameters(
    symbol: str, unit: str, prior_std: float, description: str, typical: float = 0.0
) -> tuple[EffectParameter, ...]:
    """Three parameters symbol_x, symbol_y, symbol_z with unlike typical values."""
    size = typical or 0.2 * prior_std
    values = (size, -0.6 * size, 0.4 * size)
    return tuple(
        EffectParameter(f"{symbol}_{axis}", unit, prior_std, f"{description}, {axis}", value)
        for axis, value in zip(AXES, values, strict=True)
    )


def right_jacobian(phi: Array) -> Array:
    """Right Jacobian of SO(3): exp(phi + d) = exp(phi) exp(J_r(phi) d), (3,) -> (3, 3)."""
    angle = float(np.linalg.norm(phi))
    cross = skew(phi)
    if angle < 1e-6:
        return np.asarray(np.eye(3) - 0.5 * cross)
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - first * cross + second * (cross @ cross))


@once_per_motion
def contact_rate(samples: WrenchSamples) -> Array:
    """Angular velocity of the contact frames in the world, body axes, (N, C, 3) rad/s."""
    if len(samples.time) < 2 * _REACH + 1:
        return np.zeros_like(samples.contact_force)
    frames = samples.rotation[:, None] @ samples.contact_rotation
    ahead, behind, step = _neighbours(samples.time)
    turns = log_so3(frames[ahead] @ np.swapaxes(frames[behind], 2, 3))
    rates = turns / step[:, None, None]
    return np.asarray(body_from_world(samples)[:, None] @ rates[..., None])[..., 0]


@once_per_motion
def contact_point_rate(samples: WrenchSamples) -> Array:
    """Velocity of the contact points relative to the body, body axes, (N, C, 3) m/s."""
    if len(samples.time) < 2 * _REACH + 1:
        return np.zeros_like(samples.contact_point)
    ahead, behind, step = _neighbours(samples.time)
    moved = samples.contact_point[ahead] - samples.contact_point[behind]
    return np.asarray(moved / step[:, None, None])


def _neighbours(time: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Indices ahead and behind of each sample and the time between them."""
    index = np.arange(len(time))
    ahead = np.minimum(index + _REACH, len(time) - 1)
    behind = np.maximum(index - _REACH, 0)
    return ahead, behind, time[ahead] - time[behind]
