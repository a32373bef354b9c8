"""Effects of contacts: one that nobody senses, misplaced points."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.fingers import FingerEffect
from tactile_dynamics_ros.core.effects.geometry import (
    force_at,
    force_columns,
    point_columns,
    torque_columns,
    vector_parameters,
)
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.rigid_body.rotation import skew

_WORST_OFFSET = 0.5
"""Displacement of a contact against the others, over the contacts' RMS distance from their middle,
beyond which it is no calibration error: half a grasp. Offsets of whole distances explain clean data
by taking the noise of the forces out of the torque; those of fingertips are some millimetres. Lower
refuses true offsets of small grasps, higher admits such explanations."""
_FARTHEST_OFFSET = 0.3
"""Displacement of a contact, m, beyond which it is no calibration error: a hand's length and more.
A mounting may be off by the length of a flange (5 cm); torques in N mm look like metres. Lower
refuses flanges, higher admits wrong units of torque as offsets."""
_LEAST_REACH = 0.02
"""Distance from the middle, m, that is presumed at least, so that contacts close together may be
off by a centimetre. Less would refuse a true offset in a pinch, more admits offsets of whole
distances there."""


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

    def is_possible(self, samples: WrenchSamples, inertia: Array, theta: Array) -> bool:
        """Whether no contact is off by a hand's length, nor against the others by half its reach.

        Offsets of metres stand in for torques in another unit; those that take all points to their
        middle take the noise of the forces out of the torque, which explains anything.
        """
        touching = samples.in_contact[..., None]
        count = np.maximum(touching.sum(axis=0), 1)
        point = (samples.contact_point * touching).sum(axis=0) / count
        offset = np.zeros_like(point)
        for contact, part in self._split(samples, theta):
            offset[contact] = part
        apart = np.linalg.norm(point - point.mean(axis=0), axis=1)
        reach = max(float(np.sqrt(np.mean(apart**2))), _LEAST_REACH)
        shift = np.linalg.norm(offset - offset.mean(axis=0), axis=1)
        near = np.all(np.linalg.norm(offset, axis=1) <= _FARTHEST_OFFSET)
        return bool(near and np.all(shift <= _WORST_OFFSET * reach))

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
