"""Effects of contacts: one that nobody senses, torsion of soft tips, misplaced points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.fingers import FingerEffect
from tactile_dynamics_ros.core.effects.geometry import (
    contact_rate,
    force_at,
    force_columns,
    point_columns,
    torque_columns,
    vector_parameters,
)
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, skew

Array = NDArray[np.float64]

_SCREENED_SPINS = (0.05, 0.3, 2.0)
"""Spins w_0 of which the screening family holds a column each, rad/s. Mixtures of the three come
within 0.5 % (energy) of any w_0 from 0.01 to 10 on a motion that spins at 1 rad/s; two of them
leave up to 2 %, the middle one alone up to 20 %."""
_SLOWEST_SPIN = 0.01
"""Smallest w_0 that a fit can tell from a step, rad/s: the spin is slower in 0.5 % of the samples
of a motion at 1 rad/s. Smaller ones are evaluated as this one, with no derivative by w_0."""
_LEAST_TWIST = 0.02
"""Turn of a contact frame in the body from which spins relative to the fingers are read too, rad.
Frames of fingers that do not roll err by up to 0.007 in synthetic recordings; fingers that roll
turn by 0.6, a re-grasp by 0.3. Readings that cannot be told apart would only cost evidence."""


@register_effect
class UnsensedContact(Effect):
    """A constant force at a point of the body, both fixed in the body frame."""

    name = "unsensed_contact"
    family = "contact"
    lasting = True
    formula = "f constant in the body frame at the body point p: [p x f, f]"
    looks_like = "A residual that turns with the object: force and torque constant in its frame."
    sentence = "something that no sensor feels pushes on the object, turning with it"
    remedy = "Look for the palm, a cable tie or a mount that touches the object, or add it."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Force (3) and point (3), body frame; the point along the force is not determined."""
        return vector_parameters("f", "N", 5.0, "force, body frame", 0.6) + vector_parameters(
            "p", "m", 0.1, "point of attack, body frame", 0.04
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """[p x f, f]."""
        return np.tile(force_at(theta[3:], theta[:3]), (len(samples.time), 1))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By force and by point."""
        by_force = force_columns(theta[None, 3:], np.eye(3)[None])
        by_point = point_columns(theta[None, :3])
        return np.tile(np.concatenate([by_force, by_point], axis=2), (len(samples.time), 1, 1))

    def factored(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array]:
        """Constant torque and force, times [p] and 1 by f, -[f] and 0 by p."""
        by_force = np.concatenate([skew(theta[3:]), np.eye(3)])
        by_point = np.concatenate([-skew(theta[:3]), np.zeros((3, 3))])
        columns = self.screening_basis(samples, np.zeros(10))
        return columns, np.concatenate([by_force, by_point], axis=1)

    def coefficients(self, samples: WrenchSamples, theta: Array) -> Array:
        """[p x f, f]."""
        return force_at(theta[3:], theta[:3])

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Constant torque and force."""
        return np.tile(np.eye(6), (len(samples.time), 1, 1))

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """Force, and the point nearest the origin with the torque across it."""
        torque, force = coefficients[:3], coefficients[3:]
        size = float(force @ force)
        point = np.cross(force, torque) / size if size > 0 else np.zeros(3)
        return np.concatenate([force, np.clip(point, -0.3, 0.3)])


@register_effect
class ContactTorsion(Effect):
    """Soft fingertips resist spin about their normals, bounded by the normal force.

    tau_i = -mu f_n tanh(w_n / w_0) n, w_n the spin about the normal n of the object, or relative
    to the finger; mu is a length. With reading `viscous` the slope does not follow the normal
    force: tau_i = -mu f_n tanh(k w_n / (mu f_n)) n.
    """

    name = "contact_torsion"
    family = "contact"
    external = True
    formula = "tau = -sum_i mu f_n,i tanh(w_n,i / w_0) n_i, w_n the spin about the contact normal"
    looks_like = "A torque residual about the contact normals against the spin, saturating early."
    sentence = "the soft fingertips resist being twisted about their normals"
    remedy = "Add it to the model; a harder tip or more fingers makes it smaller."

    _readings = ("", "viscous", "relative", "relative_viscous")

    def __init__(self, reading: str = "") -> None:
        """Choose the law and whose spin counts.

        Args:
            reading: empty, `viscous`, `relative` or `relative_viscous`.
        """
        self.reading = reading

    @property
    def variant(self) -> str:
        """The reading."""
        return self.reading

    def with_variant(self, variant: str) -> Effect:
        """Return the reading of that name."""
        if variant not in self._readings:
            known = ", ".join(self._readings[1:])
            raise BadInputError(f"effect '{self.name}' has no variant '{variant}': {known}")
        return ContactTorsion(variant)

    def variants(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Spin relative to the fingers only where the contact frames turn in the body."""
        still = np.abs(log_so3(_turned(samples))).max() < _LEAST_TWIST
        return tuple(ContactTorsion(r) for r in (self._readings[:2] if still else self._readings))

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Torsional friction length and spin scale (or viscosity)."""
        friction = EffectParameter("mu", "m", 0.05, "torsional friction length", 0.004)
        if self.reading.endswith("viscous"):
            return (
                EffectParameter("k", "N m s/rad", 0.1, "torsional viscosity", 0.004),
                EffectParameter("mu", "m", 0.3, "bound: torque per normal force", 0.02),
            )
        return (friction, EffectParameter("w_0", "rad/s", 3.0, "spin of half saturation", 0.3))

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Sum of the torques about the normals."""
        value, _, _ = self._law(samples, theta)
        return self._about_normals(samples, value[..., None])[..., 0]

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By both parameters."""
        _, first, second = self._law(samples, theta)
        return self._about_normals(samples, np.stack([first, second], axis=2))

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Three saturation speeds, or the viscous torque alone."""
        if self.reading.endswith("viscous"):
            return self._about_normals(samples, -self._spin(samples)[..., None])
        spin, normal_force = self._spin(samples), _normal_force(samples)
        laws = [-normal_force * np.tanh(spin / scale) for scale in _SCREENED_SPINS]
        return self._about_normals(samples, np.stack(laws, axis=2))

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """The screened law that explains most of the residual torque."""
        if self.reading.endswith("viscous"):
            return np.array([coefficients[0], 0.1])
        basis = self.screening_basis(samples, inertia)[:, :3]
        share = np.einsum("nim,ni->m", basis, residual[:, :3])
        power = np.einsum("nim,nim->m", basis, basis)
        gain = share**2 / np.where(power > 0, power, 1.0)
        best = int(np.argmax(gain))
        return np.array([share[best] / max(power[best], 1e-30), _SCREENED_SPINS[best]])

    def _law(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array, Array]:
        """Torque about each normal (N, C) and its derivatives by both parameters."""
        spin, force = self._spin(samples), _normal_force(samples)
        if self.reading.endswith("viscous"):
            return _bounded_viscous(spin, force, theta)
        scale = max(abs(float(theta[1])), _SLOWEST_SPIN)
        level = np.tanh(spin / scale)
        slope = np.sign(theta[1]) * float(abs(theta[1]) > _SLOWEST_SPIN)
        by_scale = theta[0] * force * (1.0 - level**2) * spin / scale**2 * slope
        return -theta[0] * force * level, -force * level, by_scale

    def _spin(self, samples: WrenchSamples) -> Array:
        """Spin of the object about each normal, rad/s, (N, C)."""
        normals = samples.contact_rotation[..., 2]
        rate = samples.angular_velocity[:, None]
        if self.reading.startswith("relative"):
            rate = rate - contact_rate(samples)
        spin = np.einsum("nci,nci->nc", normals, np.broadcast_to(rate, normals.shape))
        return np.asarray(spin * samples.in_contact)

    def _about_normals(self, samples: WrenchSamples, torque: Array) -> Array:
        """Wrench columns (N, 6, m) of torques (N, C, m) about the normals."""
        normals = samples.contact_rotation[..., 2]
        return torque_columns(np.swapaxes(normals, 1, 2) @ torque)


def _bounded_viscous(spin: Array, force: Array, theta: Array) -> tuple[Array, Array, Array]:
    bound = np.maximum(abs(float(theta[1])) * force, 1e-9)
    ratio = theta[0] * spin / bound
    level = np.tanh(ratio)
    by_bound = (-level + ratio * (1.0 - level**2)) * force * np.sign(theta[1])
    return -bound * level, -spin * (1.0 - level**2), by_bound


def _normal_force(samples: WrenchSamples) -> Array:
    """Pressing force of each contact, N, (N, C)."""
    along = np.einsum("nci,nci->nc", samples.contact_rotation[..., 2], samples.contact_force)
    return np.asarray(np.maximum(along, 0.0))


def _turned(samples: WrenchSamples) -> Array:
    """Rotation of the contact frames in the body since the first sample, (N, C, 3, 3)."""
    return samples.contact_rotation @ np.swapaxes(samples.contact_rotation[:1], 2, 3)


@register_effect
class ContactOffset(FingerEffect):
    """Contact points that are displaced by a constant in the object frame.

    Measured point = true point + d, one d for all contacts or one for each.
    """

    name = "contact_offset"
    family = "contact"
    linear = True
    formula = "measured point = true point + d (object frame): Delta = -[sum_i d_i x f_i, 0]"
    looks_like = "A torque residual that follows the grip force; the forces are explained."
    sentence = "the contact points are not where they are reported"
    remedy = "Calibrate the fingertip positions, or add the offset to the model."
    allows_common = True

    def axis_parameters(self) -> tuple[EffectParameter, ...]:
        """Displacement d (3)."""
        return vector_parameters("d", "m", 0.1, "displacement, object frame", 0.004)

    def finger_wrench(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """-[d x f, 0]."""
        torque = -np.cross(theta, samples.contact_force[:, contact])
        return np.concatenate([torque, np.zeros_like(torque)], axis=1)

    def finger_jacobian(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """[skew(f), 0]."""
        return torque_columns(skew(samples.contact_force[:, contact]))
