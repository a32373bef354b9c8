"""How do I add an effect of my own as a Python class?

    python examples/04_effect_as_a_class.py

Prints the estimate without the effect and with it: something dry rubs on a simulated object.
"""

import numpy as np

import tactile_dynamics_ros as td
from tactile_dynamics_ros.core.effects import EffectParameter, LinearEffect, register_effect
from tactile_dynamics_ros.core.effects.geometry import to_body
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms


@register_effect
class Rubbing(LinearEffect):
    """F = -k v / |v| at the origin of the object."""

    name, family, formula = "rubbing", "drag", "F = -k v / |v|"
    looks_like, remedy = "A force of constant size against the velocity.", "Find what rubs."
    sentence = "something dry rubs on the object"

    def parameters(self, samples):
        """Return the size of the friction."""
        return (EffectParameter("k", "N", 1.0, "friction"),)

    def jacobian(self, samples, inertia, theta):
        """Return the wrench per newton, (N, 6, 1): torque, then force, in body axes."""
        speed = np.linalg.norm(samples.velocity, axis=1, keepdims=True) + 0.005
        force = -to_body(samples, samples.velocity / speed)
        return np.concatenate([np.zeros_like(force), force], axis=1)[..., None]


made = generate_at_whitened_rms(3, {"dry_rubbing": 3.0}, ScenarioOptions(duration=6.0))
for effects in ((), (Rubbing(),)):
    print(td.estimate(Recording(made.streams, "synthetic"), effects))
