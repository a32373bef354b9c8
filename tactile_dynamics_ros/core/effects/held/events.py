"""Something that changes at once: the sensor is zeroed, the payload changes, the grasp shifts."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.contract import central_differences
from tactile_dynamics_ros.core.effects.effect import Effect, LinearEffect
from tactile_dynamics_ros.core.effects.geometry import vector_parameters
from tactile_dynamics_ros.core.effects.held.gravity import load_regressor
from tactile_dynamics_ros.core.effects.held.sensor import ForceBias
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

_MOMENTS = ("xx", "xy", "yy", "xz", "yz", "zz")
"""Endings of the six moments of inertia, in the order of the dynamic parameters. It is API."""
_TURN_STEP, _SHIFT_STEP = 1e-5, 1e-6
"""Steps of central differences of the shifted body, rad and m: its parameters are polynomials and
sines of them, so that the error is 1e-10 of the change. Larger bends, smaller rounds."""
_SHARE_STEP = 1e-6
"""Step by dynamic parameters, in shares of their largest: as above."""


@register_effect
class SensorZeroed(ForceBias):
    """The zero of a single sensor steps at one time, as when it is tared with a load on it."""

    name = "sensor_zeroed"
    family = "event"
    lasting = False
    event = True
    formula = "from t on, measured w = true w + b, b a constant force and torque (sensor axes)"
    looks_like = "All axes of one sensor step at one time, by a constant in its own axes."
    sentence = "the sensor was zeroed, or its zero jumped"
    remedy = "Zero the sensor before the recording, or add the event to the model."

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """None of several contacts, of which `force_bias` in a regime says which steps."""
        return (self,) if len(samples.contact_names) == 1 else ()


@register_effect
class PayloadChange(LinearEffect):
    """The load is another one from one time on: something was taken up or put down."""

    name = "payload_change"
    family = "event"
    linear = True
    event = True
    formula = "from t on, the load has phi + d, d = [dm, dh, dI]; wrench -Y d"
    looks_like = "Weight and its moment step at one time, and inertial forces with them."
    sentence = "the payload changes"
    remedy = "Estimate before and after apart, or add the event to the model."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Change of mass, first moment (3) and inertia about the origin (6)."""
        unit = "kg m^2"
        return (
            EffectParameter("dm", "kg", 2.0, "change of the mass", 0.2),
            *vector_parameters("dh", "kg m", 0.2, "change of the first moment", 0.01),
            *(
                EffectParameter(f"dI_{k}", unit, 0.02, f"change of the inertia, {k}", 5e-4)
                for k in _MOMENTS
            ),
        )

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """-Y."""
        return -load_regressor(samples)

    def load_after(self, inertia: Array, theta: Array) -> Array:
        """The sum, phi + d."""
        return inertia + theta

    def is_possible(self, samples: WrenchSamples, inertia: Array, theta: Array) -> bool:
        """Whether a mass is left."""
        return bool(inertia[0] + theta[0] > 0.0)


@register_effect
class GraspShift(Effect):
    """The same load is held another way from one time on: its frame moved on the sensor."""

    name = "grasp_shift"
    family = "event"
    event = True
    formula = "from t on, the load is turned by r about its centre of mass, which moves by d"
    looks_like = "The moment of the weight steps at one time, the weight itself does not."
    sentence = "the grasp shifts: the load moves on the sensor"
    remedy = "Hold it more firmly, estimate before and after apart, or add the event to the model."

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """None of several contacts, whose places on the object are measured."""
        return (self,) if len(samples.contact_names) == 1 else ()

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Shift of the centre of mass (3) and turn about it (3)."""
        return vector_parameters("d", "m", 0.05, "shift of the centre of mass", 0.01) + (
            vector_parameters("r", "rad", 0.5, "turn about the centre of mass", 0.1)
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """-Y (phi' - phi)."""
        return np.asarray(load_regressor(samples) @ (inertia - self.load_after(inertia, theta)))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By shift and turn."""
        steps = np.repeat([_SHIFT_STEP, _TURN_STEP], 3)
        by_theta = central_differences(lambda at: self.load_after(inertia, at), theta, steps)
        return np.asarray(-load_regressor(samples) @ by_theta)

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By the load before."""
        steps = np.full(10, _SHARE_STEP * np.abs(inertia).max())
        by_phi = central_differences(lambda phi: self.load_after(phi, theta), inertia, steps)
        return np.asarray(load_regressor(samples) @ (np.eye(10) - by_phi))

    def load_after(self, inertia: Array, theta: Array) -> Array:
        """T P T^T with T the turn about the centre of mass and the shift."""
        centre, turn = inertia[1:4] / inertia[0], exp_so3(theta[3:])
        moved = np.eye(4)
        moved[:3, :3], moved[:3, 3] = turn, centre + theta[:3] - turn @ centre
        return dynamic_parameters_from_pseudo_inertia(moved @ pseudo_inertia(inertia) @ moved.T)
