"""Errors of the fingertip force sensors: bias, drift, gain, misalignment."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import (
    WrenchSamples,
    once_per_motion,
    once_per_samples,
)
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.fingers import FingerEffect, FramedFingerEffect
from tactile_dynamics_ros.core.effects.geometry import right_jacobian, vector_parameters
from tactile_dynamics_ros.core.effects.parameter import EffectParameter, ParameterSum
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.rigid_body.rotation import cross, exp_so3, skew

_SEEN = 4.0
"""Standard deviations from which a gain is seen: one in ten thousand by chance. It only decides
what the gain that all sensors may share is uncertain by. Lower: one gain by chance makes the others
pass for right; higher: a true one leaves all as uncertain as the prior."""
_LEAST_GAIN = -0.9
"""Lowest gain that is evaluated: at -1 a sensor reads nothing, and its force would be divided by
zero. No sensor that is worth a model reads a tenth of the force. Closer to -1 a fit may leave for
huge forces, higher cuts gains that sensors do have."""


def carries_torque(samples: WrenchSamples) -> bool:
    """Whether any contact measures torque (a wrist force/torque sensor)."""
    return samples.torque_measured and bool(np.any(samples.contact_torque != 0.0))


def contact_map(samples: WrenchSamples, contact: int) -> Array:
    """Wrench about the body origin of a unit wrench [force, torque] at a contact, (N, 6, 6)."""
    arm = skew(samples.contact_point[:, contact])
    result = np.zeros((len(arm), 6, 6))
    result[:, :3, :3], result[:, :3, 3:], result[:, 3:, :3] = arm, np.eye(3), np.eye(3)
    return result


class _OffsetEffect(FramedFingerEffect):
    """An error of each sensor that is constant in the body or in the contact frame.

    Sensors are tared between recordings: each of several that are joined has its own.
    """

    per_session = True

    def contact_parameters(
        self, samples: WrenchSamples, contact: int
    ) -> tuple[EffectParameter, ...]:
        """Force (3), and torque (3) where it is measured, of every recording."""
        return tuple(
            replace(p, name=_of_session(p.name, session, samples))
            for session in range(samples.sessions)
            for p in self._of_one(samples)
        )

    def _of_one(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        force = self.of_force(samples)
        return force + self.of_torque(samples) if carries_torque(samples) else force

    def of_force(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Three parameters for each course: the first half of all."""
        axes = self.axis_parameters()
        return axes[: len(axes) // 2]

    def of_torque(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Likewise, the second half."""
        axes = self.axis_parameters()
        return axes[len(axes) // 2 :]

    def sums(self, samples: WrenchSamples) -> tuple[ParameterSum, ...]:
        """Force of all chosen contacts together, which is all that one grasp tells of it."""
        chosen = [samples.contact_names[c] for c in self.chosen(samples)]
        if self.frame != "body" or self.common or len(chosen) < 2:
            return ()
        named = [
            (_of_session(p.name, session, samples), p.unit)
            for session in range(samples.sessions)
            for p in self.of_force(samples)
        ]
        return tuple(
            ParameterSum(f"sum_{name}", unit, tuple(f"{finger}_{name}" for finger in chosen))
            for name, unit in named
        )

    def finger_wrench(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """Columns times theta."""
        return np.asarray(self.finger_jacobian(samples, contact, theta) @ theta)

    def finger_jacobian(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """-[p x b, b] while in contact, times the course over time."""
        count = len(theta) // samples.sessions
        columns = _offset_columns(samples, type(self), self.frame, contact)[:, :, :count]
        if samples.sessions == 1:
            return columns
        own = samples.session[:, None] == np.arange(samples.sessions)
        spread = own[:, None, :, None] * columns[:, :, None]
        return np.asarray(spread.reshape(len(columns), 6, -1))

    @abstractmethod
    def courses(self, samples: WrenchSamples) -> Array:
        """How the error develops, (N, m)."""


def _of_session(name: str, session: int, samples: WrenchSamples) -> str:
    """Name of a parameter, with the number of the recording if there are several."""
    if samples.sessions == 1:
        return name
    symbol, axis = name.rsplit("_", 1)
    return f"{symbol}[{session + 1}]_{axis}"


@once_per_motion
def _offset_columns(
    samples: WrenchSamples, kind: type[_OffsetEffect], frame: str, contact: int
) -> Array:
    effect = kind(frame=frame)
    columns, turn = contact_map(samples, contact), effect.axes(samples, contact)
    columns = np.concatenate([columns[:, :, :3] @ turn, columns[:, :, 3:] @ turn], axis=2)
    courses = -effect.courses(samples) * samples.in_contact[:, [contact]]
    forces, torques = (courses[:, None, :, None] * c[:, :, None] for c in np.split(columns, 2, 2))
    shape = (len(courses), 6, -1)
    return np.concatenate([forces.reshape(shape), torques.reshape(shape)], axis=2)


@register_effect
class ForceBias(_OffsetEffect):
    """Measured force = true force + b, b fixed in the body or sensor frame, per finger."""

    name = "force_bias"
    family = "sensor"
    lasting = True
    linear = True
    formula = "measured f_i = true f_i + b_i (sensor/body frame)"
    looks_like = "A residual that is constant in the body frame and acts where one finger touches."
    sentence = "a force sensor reports a constant force too much"
    remedy = "Tare the sensor without contact, or add the bias to the model."

    def axis_parameters(self) -> tuple[EffectParameter, ...]:
        """Bias force and torque."""
        return vector_parameters("b", "N", 5.0, "bias", 0.3) + vector_parameters(
            "bt", "N m", 0.5, "torque bias", 0.02
        )

    def courses(self, samples: WrenchSamples) -> Array:
        """Constant."""
        return np.ones((len(samples.time), 1))


@register_effect
class ForceDrift(_OffsetEffect):
    """Measured force = true force + o + d t, t from the first sample on, per finger.

    A sensor drifts from its last zero on, which lies before the recording: o is what it came to by
    then. The zero of a single sensor is part of every model and has o in it.
    """

    name = "force_drift"
    family = "sensor"
    lasting = True
    linear = True
    contains = ForceBias.name
    formula = "measured f_i = true f_i + o_i + d_i t (sensor/body frame), t from the first sample"
    looks_like = "A residual that is fixed to the body frame and grows along the recording."
    sentence = "the zero of a force sensor drifts"
    remedy = "Let the sensor warm up, tare it more often, or add the drift to the model."

    def axis_parameters(self) -> tuple[EffectParameter, ...]:
        """Drift of force and torque, and what they came to before the first sample."""
        return (
            *vector_parameters("d", "N/s", 0.5, "drift", 0.02),
            *vector_parameters("o", "N", 5.0, "offset at the first sample", 0.1),
            *vector_parameters("dt", "N m/s", 0.05, "torque drift", 0.002),
            *vector_parameters("ot", "N m", 0.5, "torque offset at the first sample", 0.005),
        )

    def of_force(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Drift, and of each of several sensors the offset."""
        return super().of_force(samples)[: 6 if _has_several(samples) else 3]

    def of_torque(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Likewise."""
        return super().of_torque(samples)[: 6 if _has_several(samples) else 3]

    def courses(self, samples: WrenchSamples) -> Array:
        """Linear in time; and constant, where that is not the zero of the one sensor there is."""
        time = samples.session_time[:, None]
        return np.hstack([time, np.ones_like(time)]) if _has_several(samples) else time


def _has_several(samples: WrenchSamples) -> bool:
    return len(samples.contact_names) > 1


@register_effect
class ForceScale(FingerEffect):
    """Measured force = (1 + gain) true force, per finger.

    A gain common to all fingers is a larger mass and cannot be seen: where all fingers have one,
    the reciprocals c_i = 1 / (1 + gain_i) count relative to their mean.
    """

    name = "force_scale"
    family = "sensor"
    lasting = True
    formula = "measured f_i = (1 + gain_i) true f_i"
    looks_like = "A residual along the force of one finger and in proportion to it."
    sentence = "a force sensor reports its force too large or too small"
    remedy = "Recalibrate the sensor, or add the gain to the model."

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """None of a single contact, whose gain is a larger load."""
        return super().readings(samples) if len(samples.contact_names) > 1 else ()

    def axis_parameters(self) -> tuple[EffectParameter, ...]:
        """The gain error."""
        return (EffectParameter("gain", "", 0.5, "gain error", 0.15, least=-1.0),)

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Wrench of every finger, so that some fingers can be picked."""
        return super().jacobian(samples, inertia, self.zero(samples))

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Sum of (c_i - 1) of the contacts' wrenches."""
        return super().wrench(samples, inertia, self._relative(samples, theta))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By the gains."""
        relative = self._relative(samples, theta)
        columns = super().jacobian(samples, inertia, relative)
        return np.asarray(columns @ self._relative_jacobian(samples, theta))

    def factored(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array]:
        """Wrenches of the contacts times the derivative of -gain / (1 + gain) by the gains."""
        by_relative = -1.0 / (1.0 + self._relative(samples, theta)) ** 2
        weights = by_relative[:, None] * self._relative_jacobian(samples, theta)
        return -self.screening_basis(samples, np.zeros(10)), weights

    def coefficients(self, samples: WrenchSamples, theta: Array) -> Array:
        """-gain / (1 + gain), gains as they count."""
        relative = self._relative(samples, theta)
        return np.asarray(-relative / (1.0 + relative))

    def unseen_gain(self, samples: WrenchSamples, theta: Array, std: Array) -> float:
        """Standard deviation of the gain that all fingers have in common, for all that is seen.

        Only differences between the fingers' gains show. If one gain of three or more fingers is
        seen, the others agree and are taken to be right. If more are, nobody knows which are: gains
        that scatter by s have a mean that is known to s / sqrt(n). If none is, or all are relative,
        the mean is as uncertain as the prior.
        """
        fingers = len(samples.contact_names)
        (gain,) = self.axis_parameters()
        seen = int(np.sum(np.abs(theta) > _SEEN * std))
        if seen == 0 or self._is_relative(samples):
            return float(gain.prior_std / np.sqrt(fingers))
        if seen == 1 and fingers > 2:
            return 0.0
        gains = np.zeros(fingers)
        gains[: len(theta)] = theta
        return float(min(np.std(gains, ddof=1), gain.prior_std) / np.sqrt(fingers))

    def _relative(self, samples: WrenchSamples, theta: Array) -> Array:
        """Gains (k,) that count: 1 / c_i - 1, c over its mean where all fingers have a gain."""
        gain = np.maximum(theta, _LEAST_GAIN)
        mean = np.mean(1.0 / (1.0 + gain)) if self._is_relative(samples) else 1.0
        return np.asarray((1.0 + gain) * mean - 1.0)

    def _relative_jacobian(self, samples: WrenchSamples, theta: Array) -> Array:
        """Derivative (k, k) of `_relative`."""
        if not self._is_relative(samples):
            return np.eye(len(theta))
        factor = 1.0 + np.maximum(theta, _LEAST_GAIN)
        mean = np.mean(1.0 / factor)
        return np.asarray(mean * np.eye(len(theta)) - np.outer(factor, factor**-2.0) / len(theta))

    def _is_relative(self, samples: WrenchSamples) -> bool:
        return len(self.chosen(samples)) == len(samples.contact_names) > 1

    def finger_wrench(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """-gain / (1 + gain) of the contact's wrench."""
        gain = float(theta[0])
        return -gain / (1.0 + gain) * _contact_wrench(samples, contact)

    def finger_jacobian(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """-1 / (1 + gain)^2 of the contact's wrench."""
        gain = float(theta[0])
        return -_contact_wrench(samples, contact)[..., None] / (1.0 + gain) ** 2


def _contact_wrench(samples: WrenchSamples, contact: int) -> Array:
    """Wrench of one contact about the body origin, (N, 6)."""
    force = samples.contact_force[:, contact]
    torque = np.cross(samples.contact_point[:, contact], force)
    return np.concatenate([torque + samples.contact_torque[:, contact], force], axis=1)


@register_effect
class SensorRotation(FramedFingerEffect):
    """Measured force = exp(r) true force in the contact, body or world frame, per finger."""

    name = "sensor_rotation"
    family = "sensor"
    lasting = True
    formula = "measured f_i = exp([r_i]) true f_i, r_i in the contact (or body, world) frame"
    looks_like = "A residual at right angles to the force of one finger and in proportion to it."
    sentence = "a force sensor is mounted at an angle"
    remedy = "Correct the mounting angle in the robot description, or add it to the model."
    frames = ("sensor", "body", "world")

    def axis_parameters(self) -> tuple[EffectParameter, ...]:
        """Rotation vector (3)."""
        return vector_parameters("r", "rad", 0.3, "rotation vector", 0.1)

    def finger_wrench(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """Wrench of (exp(-r) - 1) f, and of the torque likewise."""
        turn = exp_so3(-theta) - np.eye(3)
        force = self._turned(samples, contact, samples.contact_force, turn)
        torque = cross(samples.contact_point[:, contact], force)
        if carries_torque(samples):
            torque += self._turned(samples, contact, samples.contact_torque, turn)
        return np.concatenate([torque, force], axis=1)

    def _turned(self, samples: WrenchSamples, contact: int, vectors: Array, matrix: Array) -> Array:
        """Vectors (N, C, 3) of one contact times a matrix (3, 3) of the frame, body axes."""
        own = vectors[:, contact]
        if self.frame == "body":
            return np.asarray(own @ matrix.T)
        axes = self.axes(samples, contact)
        return np.asarray((axes @ ((own[:, None] @ axes)[:, 0] @ matrix.T)[..., None])[..., 0])

    def finger_jacobian(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """By r: exp(-r) [v] J_r(-r)."""
        return _weighted(_product_columns(samples, self.frame, contact), _turn_jacobian(theta))

    def factored(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array] | None:
        """The wrench is linear in the nine numbers of exp(-r) - 1 of every finger."""
        if self.common:
            return None
        parts = self._split(samples, theta)
        columns = _all_product_columns(samples, self.frame, tuple(c for c, _ in parts))
        return columns, block_diag(*(_turn_jacobian(part) for _, part in parts))

    def coefficients(self, samples: WrenchSamples, theta: Array) -> Array | None:
        """The nine numbers of exp(-r) - 1 of every finger."""
        if self.common:
            return None
        turns = [exp_so3(-part) - np.eye(3) for _, part in self._split(samples, theta)]
        return np.ravel(turns)


@once_per_samples
def _product_columns(samples: WrenchSamples, frame: str, contact: int) -> Array:
    """Wrenches (N, 6, 9) of e_i v_j, v the force (and torque) of a contact in a frame."""
    axes = SensorRotation(frame=frame).axes(samples, contact)
    force, torque = (
        axes[..., None] * (values[:, contact, None] @ axes)[:, :, None]
        for values in (samples.contact_force, samples.contact_torque)
    )
    columns = np.concatenate([force, torque], axis=1).reshape(len(axes), 6, 9)
    return np.asarray(contact_map(samples, contact) @ columns)


@once_per_samples
def _all_product_columns(samples: WrenchSamples, frame: str, contacts: tuple[int, ...]) -> Array:
    return np.concatenate([_product_columns(samples, frame, c) for c in contacts], axis=2)


def _weighted(columns: Array, weights: Array) -> Array:
    """Columns (N, 6, b) times weights (b, ...), faster than one product per sample."""
    product = columns.reshape(-1, len(weights)) @ weights
    return np.asarray(product.reshape(*columns.shape[:2], *weights.shape[1:]))


def _turn_jacobian(theta: Array) -> Array:
    """Derivative (9, 3) of exp(-r) by r: exp(-r) [e_k] J_r(-r) e_j turns the k-th unit vector."""
    left, right = exp_so3(-theta), right_jacobian(-theta)
    by_vector = left @ skew(np.eye(3)) @ right
    return np.asarray(by_vector.transpose(1, 0, 2).reshape(9, 3))
