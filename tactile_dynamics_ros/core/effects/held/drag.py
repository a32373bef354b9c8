"""Resistance of the surroundings to the motion of the object."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import LinearEffect
from tactile_dynamics_ros.core.effects.geometry import to_body
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect


@register_effect
class ViscousDrag(LinearEffect):
    """Force -c v at the body origin."""

    name = "viscous_drag"
    family = "drag"
    linear = True
    formula = "f = -c v at the body origin, v the velocity of the origin"
    looks_like = "A force residual against the velocity, growing in proportion to the speed."
    sentence = "the object drags through something viscous"
    remedy = "Add it to the model, or move the object out of the liquid, cloth or air stream."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The coefficient c."""
        return (EffectParameter("c", "N s/m", 10.0, "drag coefficient", 1.0, least=0.0),)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Column [0, -R_OW v]."""
        force = -to_body(samples, samples.velocity)
        return np.concatenate([np.zeros_like(force), force], axis=1)[..., None]


@register_effect
class QuadraticDrag(LinearEffect):
    """Force -c |v| v at the body origin."""

    name = "quadratic_drag"
    family = "drag"
    linear = True
    formula = "f = -c |v| v at the body origin"
    looks_like = "A force residual against the velocity that grows with the square of the speed."
    sentence = "the object meets drag that grows with the square of its speed"
    remedy = "Add it to the model, or move more slowly."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The coefficient c."""
        return (EffectParameter("c", "N s^2/m^2", 20.0, "drag coefficient", 3.0, least=0.0),)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Column [0, -|v| R_OW v]."""
        speed = np.linalg.norm(samples.velocity, axis=1, keepdims=True)
        force = -speed * to_body(samples, samples.velocity)
        return np.concatenate([np.zeros_like(force), force], axis=1)[..., None]


@register_effect
class RotationalDrag(LinearEffect):
    """Torque -c omega."""

    name = "rotational_drag"
    family = "drag"
    linear = True
    formula = "tau = -c omega"
    looks_like = "A torque residual against the angular velocity; the forces are explained."
    sentence = "something viscous resists the rotation of the object"
    remedy = "Add it to the model, or remove what rubs on the object while it turns."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The coefficient c."""
        return (
            EffectParameter("c", "N m s/rad", 0.1, "rotational drag coefficient", 0.01, least=0.0),
        )

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Column [-omega, 0]."""
        torque = -samples.angular_velocity
        return np.concatenate([torque, np.zeros_like(torque)], axis=1)[..., None]
