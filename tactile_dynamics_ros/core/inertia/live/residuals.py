"""Newton-Euler residuals of a stretch of samples, with their noise as functionals of raw poses.

The motion x of a sample is read from a long window of poses (denoised), the residual from a short
one: r = e(x) + sum_o de/dq^(o) (q_short^(o) - x^(o)), linear in the raw poses z, so that its noise
is G (z - truth) exactly to first order and the regressor Y(x) hardly shares it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.inertia.residuals.sensitivity import motion_sensitivity
from tactile_dynamics_ros.core.numerics.local_polynomial import polynomial_weights
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3, skew


@dataclass(frozen=True)
class PoseWindows:
    """B windows of W poses around B samples.

    Attributes:
        time: (B, W) s; position: (B, W, 3) m; rotation: (B, W, 3, 3).
        noise: (B, W, 2, 3, 3) square roots of the covariance of rotation and position.
        draw: (B, W, 6) a draw of standard normal noise, fixed for each pose.
        short: half width in samples of the residual's windows.
    """

    time: Array
    position: Array
    rotation: Array
    noise: Array
    draw: Array
    short: int


_BY_SAMPLE = ("point", "rotation", "force", "torque", "std", "in_contact")
"""Fields of `ContactRows` with a row for each sample, no number."""


@dataclass(frozen=True)
class ContactRows:
    """B samples of C contacts, world axes (see `ContactReading`); absent contacts are zero.

    `torque_std` (C,) N m is zero for contacts that carry no torque; `point_std` (C,) is in m.
    """

    names: tuple[str, ...]
    point: Array
    rotation: Array
    force: Array
    torque: Array
    std: Array
    in_contact: NDArray[np.bool_]
    torque_std: Array
    point_std: Array

    def row(self, k: int) -> ContactRows:
        """Sample k alone."""
        parts: dict[str, Any] = {name: getattr(self, name)[k : k + 1] for name in _BY_SAMPLE}
        return replace(self, **parts)

    @staticmethod
    def stack(rows: Sequence[ContactRows]) -> ContactRows:
        """Join samples; later ones may have contacts that earlier ones had not, then absent."""
        last = rows[-1]
        count = len(last.names)

        def joined(name: str) -> Any:
            parts = [getattr(row, name) for row in rows]
            missing = [count - part.shape[1] for part in parts]
            if any(missing):
                pads = [((0, 0), (0, m)) + ((0, 0),) * (parts[0].ndim - 2) for m in missing]
                parts = [np.pad(part, pad) for part, pad in zip(parts, pads, strict=True)]
            return np.concatenate(parts)

        return replace(last, **{name: joined(name) for name in _BY_SAMPLE})


@dataclass(frozen=True)
class DenoisedMotion:
    """Motion of B samples, world axes, read from long windows.

    Attributes:
        time: (B,) s.
        rotation: (B, 3, 3) R_WO.
        rates: (B, 3, 3) zero, angular velocity and acceleration.
        linear: (B, 3, 3) position, velocity and acceleration of the origin.
        response: (B, W, 6, 18) response of [rotation, angular velocity, angular acceleration,
            position, velocity, acceleration] to one deviation of each pose in the window.
        draw: (B, 18) how a draw of pose noise moves them.
    """

    time: Array
    rotation: Array
    rates: Array
    linear: Array
    response: Array
    draw: Array

    def corrected(self, correction: Array) -> DenoisedMotion:
        """Return the motion moved by corrections (B, 18) in the order of `response`."""
        steps = correction.reshape(-1, 2, 3, 3)
        rotation = exp_so3(steps[:, 0, 0]) @ self.rotation
        rates = self.rates + steps[:, 0]
        rates[:, 0] = 0.0
        linear = self.linear + steps[:, 1]
        return replace(self, rotation=rotation, rates=rates, linear=linear)

    def row(self, k: int) -> DenoisedMotion:
        """Sample k alone."""
        return DenoisedMotion(*(value[k : k + 1] for value in vars(self).values()))

    @staticmethod
    def stack(rows: Sequence[DenoisedMotion]) -> DenoisedMotion:
        """Join samples."""
        if len(rows) == 1:
            return rows[0]
        columns = zip(*(vars(row).values() for row in rows), strict=True)
        return DenoisedMotion(*(np.concatenate(column) for column in columns))

    def regressor(self) -> Array:
        """Y (B, 6, 10) of the net contact wrench, [torque, force] = Y phi."""
        vectors = np.concatenate([self.linear[:, 2:] - GRAVITY_W, self.rates[:, 1:]], axis=1)
        return regressor(*self._in_body(vectors).swapaxes(0, 1))

    def samples(self, contacts: ContactRows) -> WrenchSamples:
        """Newton-Euler quantities with the contacts' readings."""
        omega, alpha = self._in_body(self.rates[:, 1:]).swapaxes(0, 1)
        loaded = contacts.in_contact[..., None]
        return WrenchSamples(
            time=self.time,
            position=self.linear[:, 0],
            rotation=self.rotation,
            velocity=self.linear[:, 1],
            acceleration=self.linear[:, 2],
            angular_velocity=omega,
            angular_acceleration=alpha,
            contact_names=contacts.names,
            contact_point=self._in_body((contacts.point - self.linear[:, None, 0]) * loaded),
            contact_rotation=np.swapaxes(self.rotation, 1, 2)[:, None] @ contacts.rotation,
            contact_force=self._in_body(contacts.force),
            contact_torque=self._in_body(contacts.torque),
            in_contact=contacts.in_contact,
            gravity=GRAVITY_W,
        )

    def _in_body(self, vectors: Array) -> Array:
        """Vectors (B, k, 3) of the world in body axes."""
        to_body = np.swapaxes(self.rotation, 1, 2)[:, None]
        return np.asarray((to_body @ vectors[..., None])[..., 0])


@dataclass(frozen=True)
class ResidualBatch:
    """Residuals r(phi + dx) = residual + jacobian dx of B samples.

    Attributes:
        motion: denoised.
        jacobian: (B, 6, 10) with respect to phi.
        residual: (B, 6) at phi, [torque, force], body frame.
        pose_noise: (B, 6, 6 (2 short + 1)) response to one deviation of each pose in the window.
        draw: (B, 6) what a draw of the pose noise makes of the residual.
        contact_covariance: (B, 6, 6).
    """

    motion: DenoisedMotion
    jacobian: Array
    residual: Array
    pose_noise: Array
    draw: Array
    contact_covariance: Array


def _centred_rotation(windows: PoseWindows, weights: Array) -> tuple[Array, Array]:
    """Denoised rotation (B, 3, 3) and the window's world rotation vectors (B, W, 3) from it."""
    middle = windows.time.shape[1] // 2
    centre = windows.rotation[:, middle]
    local = log_so3(windows.rotation @ np.swapaxes(centre, 1, 2)[:, None])
    centre = exp_so3(np.einsum("bk,bki->bi", weights[:, 0], local)) @ centre
    local = log_so3(windows.rotation @ np.swapaxes(centre, 1, 2)[:, None])
    return centre, local


def contact_covariance(samples: WrenchSamples, contacts: ContactRows) -> Array:
    """Covariance (B, 6, 6) of the residual from noise of forces, torques and contact points."""
    to_body = np.swapaxes(samples.rotation, 1, 2)[:, None]
    loaded = samples.in_contact
    by_force = to_body * (contacts.std * loaded[..., None])[:, :, None]
    factors = np.concatenate([skew(samples.contact_point) @ by_force, by_force], axis=2)
    covariance = (factors @ np.swapaxes(factors, 2, 3)).sum(axis=1)
    arm = contacts.point_std[:, None, None] * skew(samples.contact_force)
    covariance[:, :3, :3] += np.einsum("bcij,bckj->bik", arm, arm)
    covariance[:, :3, :3] += (loaded @ contacts.torque_std**2)[:, None, None] * np.eye(3)
    return np.asarray(covariance)


def _inner(windows: PoseWindows) -> slice:
    middle = windows.time.shape[1] // 2
    return slice(middle - windows.short, middle + windows.short + 1)


def denoise_motion(windows: PoseWindows, degree: int) -> tuple[DenoisedMotion, Array, Array]:
    """Motion of the long windows, the short weights and the short minus the long readings.

    Returns:
        The motion, (B, 3, w) weights and (B, 2, 3, 3) differences of [rotation, position].
    """
    middle, inner = windows.time.shape[1] // 2, _inner(windows)
    offset = windows.time - windows.time[:, middle, None]
    equal = np.ones_like(offset)
    long_weights = polynomial_weights(equal, offset, degree)
    weights = polynomial_weights(equal[:, inner], offset[:, inner], degree)
    rotation, local = _centred_rotation(windows, long_weights)
    centre = windows.position[:, middle, None]
    shift = windows.position - centre
    rates, linear = long_weights @ local, long_weights @ shift
    steps = np.stack([weights @ local[:, inner], weights @ shift[:, inner]], axis=1)
    steps -= np.stack([rates, linear], axis=1)
    linear[:, 0] += centre[:, 0]
    rates[:, 0] = 0.0
    response = _pose_response(long_weights, windows.noise)
    draw = np.einsum("bkem,bke->bm", response, windows.draw)
    motion = DenoisedMotion(windows.time[:, middle], rotation, rates, linear, response, draw)
    return motion, weights, steps


def _pose_response(weights: Array, noise: Array) -> Array:
    """(B, W, 6, 18) from weights (B, 3, W) and noise factors (B, W, 2, 3, 3)."""
    count, _, width = weights.shape
    response = np.zeros((count, width, 2, 3, 2, 3, 3))
    by_order = np.einsum("bok,bksie->bskeoi", weights, noise)
    for signal in range(2):
        response[:, :, signal, :, signal] = by_order[:, signal]
    return response.reshape(count, width, 6, 18)


def _residual_noise(weights: Array, response: Array, noise: Array) -> Array:
    """Response (B, 6, 6 w) of the residual to one deviation of each pose.

    Args:
        weights: (B, 3, w) by derivative order and pose.
        response: (B, 2, 3, 6, 3) response of the residual to [rotation, position] by order.
        noise: (B, w, 2, 3, 3) square roots of the poses' covariance.
    """
    count, _, width = weights.shape
    orders = response.swapaxes(1, 2).reshape(count, 3, -1)
    by_pose = (np.swapaxes(weights, 1, 2) @ orders).reshape(count, width, 2, 6, 3) @ noise
    return np.asarray(np.transpose(by_pose, (0, 3, 1, 2, 4)).reshape(count, 6, -1))


def linearise_residuals(
    windows: PoseWindows, contacts: ContactRows, degree: int, phi: Array
) -> ResidualBatch:
    """Residuals e = Y phi - w of B samples and how they move with noise.

    Args:
        windows: poses around the samples.
        contacts: the samples' contacts.
        degree: degree of the local polynomials.
        phi: (10,) dynamic parameters.
    """
    motion, weights, steps = denoise_motion(windows, degree)
    samples = motion.samples(contacts)
    sensitivity = motion_sensitivity(samples, phi, False, False)
    response = np.stack([sensitivity["orientation"], sensitivity["position"]], axis=1)
    noise = _residual_noise(weights, response, windows.noise[:, _inner(windows)])
    jacobian = motion.regressor()
    residual = jacobian @ phi - samples.measured_wrench
    residual += np.einsum("bsoij,bsoj->bi", response, steps)
    drawn = windows.draw[:, _inner(windows)].reshape(len(residual), -1)
    return ResidualBatch(
        motion,
        jacobian,
        residual,
        noise,
        np.einsum("bij,bj->bi", noise, drawn),
        contact_covariance(samples, contacts),
    )
