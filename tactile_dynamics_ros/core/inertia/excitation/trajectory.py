"""Candidate motions: sums of sines on six Cartesian axes, at rest at both ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3

CHANNELS = 6
"""Axes of a motion: rotation vector, then translation. Fixed by a rigid body's freedom and by the
plan's format."""
_STENCIL = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
"""Places of the five-point central difference, in steps. Three would be exact to second order only,
seven read farther for digits that rounding takes."""
_FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
"""Weights of its first derivative, over the step; exact for polynomials of degree four. Other
weights on these places are exact for less."""
_SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
"""Weights of its second derivative, over the step squared; exact for degree five. Other weights on
these places are exact for less."""
_STEP = 2e-3
"""Its step, s: at 2.5 Hz derivatives are off by 3e-8 of their size, and rounding of positions
(1e-16 m) makes 3e-11 m/s^2. Ten times as long would be off by 3e-4."""


@dataclass(frozen=True)
class FourierOffsets:
    """Offsets x_c(t) = w(t) sum_k a_ck sin(2 pi f_k t) + b_ck cos(2 pi f_k t), (C,) per instant.

    Of a held object C = 6: [rotation vector (rad), translation (m)], world axes; of an arm they
    are its joints. The window w fades in and out over `ramp`, with zero velocity and acceleration
    at both ends.

    Attributes:
        duration: s.
        frequency_hz: (K,).
        sine: (C, K); cosine: (C, K).
        ramp: s.
    """

    duration: float
    frequency_hz: Array
    sine: Array
    cosine: Array
    ramp: float = 1.0

    @property
    def coefficients(self) -> Array:
        """All amplitudes, (2 C K,)."""
        return np.concatenate([self.sine.ravel(), self.cosine.ravel()])

    def with_coefficients(self, values: Array) -> FourierOffsets:
        """Return the motion with other amplitudes, (2 C K,)."""
        sine, cosine = np.reshape(values, (2, len(self.sine), -1))
        return FourierOffsets(self.duration, self.frequency_hz, sine, cosine, self.ramp)

    def scaled(self, factors: Array | float) -> FourierOffsets:
        """Return the motion with the amplitudes of each channel multiplied, (C,) or a number."""
        column = np.broadcast_to(np.asarray(factors, dtype=float), (len(self.sine),))[:, None]
        return self.with_coefficients(
            np.concatenate([(column * self.sine).ravel(), (column * self.cosine).ravel()])
        )

    def evaluate(self, time: Array) -> Array:
        """Offsets (N, C) at times (N,) s; zero outside [0, duration]."""
        angle = 2.0 * np.pi * np.asarray(time)[:, None] * self.frequency_hz
        value = np.sin(angle) @ self.sine.T + np.cos(angle) @ self.cosine.T
        ramp = min(self.ramp, 0.5 * self.duration)
        inside = np.clip(np.minimum(time, self.duration - np.asarray(time)) / ramp, 0.0, 1.0)
        window = inside**3 * (10.0 - 15.0 * inside + 6.0 * inside**2)
        return np.asarray(window[:, None] * value)

    def __call__(self, time: float) -> Array:
        """Return the offset (C,) at one instant, as controllers take it."""
        return np.asarray(self.evaluate(np.array([time]))[0])


@dataclass(frozen=True)
class ObjectMotion:
    """Exact kinematics of the object at N instants; angular quantities and forces in body axes.

    Attributes:
        time: (N,) s; rotation: (N, 3, 3) R_WO.
        position: (N, 3) m, velocity: (N, 3) m/s, acceleration: (N, 3) m/s^2, world axes.
        angular_velocity: (N, 3) rad/s, angular_acceleration: (N, 3) rad/s^2, body axes.
    """

    time: Array
    rotation: Array
    position: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array

    @property
    def specific_acceleration(self) -> Array:
        """R_OW (a - g), (N, 3) m/s^2."""
        specific = np.einsum("nji,nj->ni", self.rotation, self.acceleration - GRAVITY_W)
        return np.asarray(specific)


@dataclass(frozen=True)
class HeldPose:
    """Where the object is when the motion starts, and the point about which offsets turn it.

    Attributes:
        rotation: (3, 3) R_WO.
        position: (3,) p_WO, m.
        pivot: (3,) m, world.
    """

    rotation: Array
    position: Array
    pivot: Array

    def move(self, offsets: Array) -> tuple[Array, Array]:
        """Rotations (..., 3, 3) and positions (..., 3) of the object at offsets (..., 6)."""
        turn = exp_so3(offsets[..., :3])
        arm = self.position - self.pivot
        return np.asarray(turn @ self.rotation), np.asarray(
            self.pivot + turn @ arm + offsets[..., 3:]
        )

    def follow(self, motion: FourierOffsets, time: Array) -> ObjectMotion:
        """Kinematics along a motion, by five-point differences of the exact pose."""
        return follow(lambda times: self.move(motion.evaluate(times)), time)


def follow(poses: Callable[[Array], tuple[Array, Array]], time: Array) -> ObjectMotion:
    """Return the kinematics of a body, by five-point differences of its exact poses.

    Args:
        poses: gives rotations (N, 3, 3) and positions (N, 3) at times (N,).
        time: (N,) s.
    """
    stencil = np.asarray(time)[:, None] + _STEP * _STENCIL
    turned, moved = poses(stencil.ravel())
    rotation = turned.reshape(len(time), len(_STENCIL), 3, 3)
    position = moved.reshape(len(time), len(_STENCIL), 3)
    centre = rotation[:, 2]
    local = log_so3(np.swapaxes(centre, 1, 2)[:, None] @ rotation)
    return ObjectMotion(
        time=np.asarray(time),
        rotation=centre,
        position=position[:, 2],
        velocity=np.einsum("k,nki->ni", _FIRST, position) / _STEP,
        acceleration=np.einsum("k,nki->ni", _SECOND, position) / _STEP**2,
        angular_velocity=np.einsum("k,nki->ni", _FIRST, local) / _STEP,
        angular_acceleration=np.einsum("k,nki->ni", _SECOND, local) / _STEP**2,
    )
