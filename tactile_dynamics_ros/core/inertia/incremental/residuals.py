"""Newton-Euler residuals of a stretch of samples, with their noise as functionals of raw poses.

The motion x of a sample is read from a long window of poses (denoised), the residual from a short
one: r = e(x) + sum_o de/dq^(o) (q_short^(o) - x^(o)), linear in the raw poses z, so that its noise
is G (z - truth) exactly to first order and the regressor Y(x) hardly shares it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.inertia.sensitivity import motion_sensitivity
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3, skew

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoseWindows:
    """B windows of W poses around B samples.

    Attributes:
        time: (B, W) s; position: (B, W, 3) m; rotation: (B, W, 3, 3).
        noise: (B, W, 2, 3, 3) square roots of the covariance of rotation and position.
        short: half width in samples of the residual's windows.
    """

    time: Array
    position: Array
    rotation: Array
    noise: Array
    short: int


@dataclass(frozen=True)
class ContactRows:
    """B samples of C contacts, world axes (see `ContactReading`); absent contacts are zero.

    `torque_std` (C,) N m is zero for contacts that carry no torque; `point_std` is in m.
    """

    names: tuple[str, ...]
    point: Array
    rotation: Array
    force: Array
    torque: Array
    std: Array
    in_contact: NDArray[np.bool_]
    torque_std: Array
    point_std: float


@dataclass(frozen=True)
class ResidualBatch:
    """Linearised residuals r(x0 + dx) = residual + jacobian dx of B samples.

    Attributes:
        jacobian: (B, 6, n) with respect to [phi, theta].
        residual: (B, 6) at x0, [torque, force], body frame.
        pose_noise: (B, 6, 6 (2 short + 1)) response to one deviation of each pose in the window.
        contact_covariance: (B, 6, 6).
    """

    jacobian: Array
    residual: Array
    pose_noise: Array
    contact_covariance: Array


def derivative_weights(offset: Array, degree: int) -> Array:
    """Weights (B, 3, W) of value, first and second derivative of a least-squares polynomial at 0.

    Args:
        offset: (B, W) s, sample times relative to the instant.
        degree: of the polynomial.
    """
    scale = np.abs(offset).max(axis=1)
    basis = (offset / scale[:, None])[..., None] ** np.arange(degree + 1)
    transposed = np.swapaxes(basis, 1, 2)
    solution = np.linalg.solve(transposed @ basis, transposed)[:, :3]
    factors = np.stack([np.ones_like(scale), 1.0 / scale, 2.0 / scale**2], axis=1)
    return np.asarray(solution * factors[..., None])


def _centred_rotation(windows: PoseWindows, weights: Array) -> tuple[Array, Array]:
    """Denoised rotation (B, 3, 3) and the window's world rotation vectors (B, W, 3) from it."""
    middle = windows.time.shape[1] // 2
    centre = windows.rotation[:, middle]
    local = log_so3(windows.rotation @ np.swapaxes(centre, 1, 2)[:, None])
    centre = exp_so3(np.einsum("bk,bki->bi", weights[:, 0], local)) @ centre
    local = log_so3(windows.rotation @ np.swapaxes(centre, 1, 2)[:, None])
    return centre, local


def _samples(
    windows: PoseWindows, contacts: ContactRows, rotation: Array, rates: Array, linear: Array
) -> WrenchSamples:
    """Samples at the denoised motion; rates (B, 3, 3) of rotation vectors, linear of position."""
    to_body = np.swapaxes(rotation, 1, 2)

    def body(vectors: Array) -> Array:
        return np.asarray((to_body[:, None] @ vectors[..., None])[..., 0])

    omega, alpha = np.moveaxis(body(rates[:, 1:]), 1, 0)
    middle = windows.time.shape[1] // 2
    loaded = contacts.in_contact[..., None]
    return WrenchSamples(
        time=windows.time[:, middle],
        position=linear[:, 0],
        rotation=rotation,
        velocity=linear[:, 1],
        acceleration=linear[:, 2],
        angular_velocity=omega,
        angular_acceleration=alpha,
        contact_names=contacts.names,
        contact_point=body((contacts.point - linear[:, None, 0]) * loaded),
        contact_rotation=to_body[:, None] @ contacts.rotation,
        contact_force=body(contacts.force),
        contact_torque=body(contacts.torque),
        in_contact=contacts.in_contact,
        gravity=GRAVITY_W,
    )


def contact_covariance(samples: WrenchSamples, contacts: ContactRows) -> Array:
    """Covariance (B, 6, 6) of the residual from noise of forces, torques and contact points."""
    to_body = np.swapaxes(samples.rotation, 1, 2)[:, None]
    loaded = samples.in_contact
    by_force = to_body * (contacts.std * loaded[..., None])[:, :, None]
    factors = np.concatenate([skew(samples.contact_point) @ by_force, by_force], axis=2)
    covariance = np.einsum("bcij,bckj->bik", factors, factors, optimize=True)
    arm = contacts.point_std * skew(samples.contact_force)
    covariance[:, :3, :3] += np.einsum("bcij,bckj->bik", arm, arm)
    covariance[:, :3, :3] += (loaded @ contacts.torque_std**2)[:, None, None] * np.eye(3)
    return np.asarray(covariance)


def _inner(windows: PoseWindows) -> slice:
    middle = windows.time.shape[1] // 2
    return slice(middle - windows.short, middle + windows.short + 1)


def _denoise(
    windows: PoseWindows, contacts: ContactRows, degree: int
) -> tuple[WrenchSamples, Array, Array]:
    """Samples at the denoised motion, the short weights (B, 3, w) and short minus long readings.

    The last, (B, 2, 3, 3), are values and derivatives of [rotation, position].
    """
    middle, inner = windows.time.shape[1] // 2, _inner(windows)
    offset = windows.time - windows.time[:, middle, None]
    long_weights = derivative_weights(offset, degree)
    weights = derivative_weights(offset[:, inner], degree)
    rotation, local = _centred_rotation(windows, long_weights)
    centre = windows.position[:, middle, None]
    shift = windows.position - centre
    rates, linear = long_weights @ local, long_weights @ shift
    steps = np.stack([weights @ local[:, inner], weights @ shift[:, inner]], axis=1)
    steps -= np.stack([rates, linear], axis=1)
    linear[:, 0] += centre[:, 0]
    return _samples(windows, contacts, rotation, rates, linear), weights, steps


def linearise_residuals(
    windows: PoseWindows,
    contacts: ContactRows,
    degree: int,
    phi: Array,
    effects: Sequence[Effect] = (),
    theta: Sequence[Array] = (),
    origin: float = 0.0,
) -> tuple[WrenchSamples, ResidualBatch]:
    """Residuals e = Y phi - w - sum Delta of B samples and how they move with x0 and noise.

    Args:
        windows: poses around the samples.
        contacts: the samples' contacts.
        degree: of the local polynomials.
        phi: (10,) dynamic parameters to linearise at.
        effects: of the model.
        theta: their parameters, likewise.
        origin: s, subtracted from the times that effects see.
    """
    samples, weights, steps = _denoise(windows, contacts, degree)
    sensitivity = motion_sensitivity(samples, phi, False, False)
    response = np.stack([sensitivity["orientation"], sensitivity["position"]], axis=1)
    matrix = regressor(
        samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
    )
    residual = matrix @ phi - samples.measured_wrench
    residual = residual + np.einsum("bsoij,bsoj->bi", response, steps)
    columns = [matrix]
    seen = replace(samples, time=samples.time - origin)
    for effect, value in zip(effects, theta, strict=True):
        residual = residual - effect.wrench(seen, phi, value)
        columns[0] = columns[0] - effect.inertia_jacobian(seen, phi, value)
        columns.append(-effect.jacobian(seen, phi, value))
    per_pose = np.einsum("bok,bsoij->bkisj", weights, response, optimize=True)
    noise = np.einsum(
        "bkisj,bksjl->biksl", per_pose, windows.noise[:, _inner(windows)], optimize=True
    )
    return seen, ResidualBatch(
        np.concatenate(columns, axis=2),
        residual,
        noise.reshape(len(residual), 6, -1),
        contact_covariance(samples, contacts),
    )
