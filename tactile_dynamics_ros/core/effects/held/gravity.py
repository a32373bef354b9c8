"""Effects on mass and gravity: fluid, leak, tilted base."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples, once_per_motion
from tactile_dynamics_ros.core.effects.effect import Effect, LinearEffect
from tactile_dynamics_ros.core.effects.geometry import body_from_world, right_jacobian, to_body
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, skew


class ChoiceEffect(Effect):
    """An effect with a default and one alternative reading of its name."""

    default: str = ""
    alternative: str = ""

    def __init__(self, reading: str = "") -> None:
        """Choose the reading.

        Args:
            reading: empty for the default.
        """
        self.reading = "" if reading == self.default else reading

    def with_reading(self, reading: str) -> Effect:
        """Return the reading of that name."""
        if reading not in ("", self.default, self.alternative):
            raise BadInputError(
                f"effect '{self.name}' has no reading '{reading}': "
                f"expected {self.default} or {self.alternative}"
            )
        return type(self)(reading)

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Both readings."""
        return (type(self)(), type(self)(self.alternative))


@once_per_motion
def load_regressor(samples: WrenchSamples) -> Array:
    """Newton-Euler regressor (N, 6, 10) of the samples."""
    return regressor(
        samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
    )


def point_mass(inertia: Array) -> Array:
    """Dynamic parameters per kg (10,) of a point mass at the centre of mass."""
    com = inertia[1:4] / inertia[0]
    square = com @ com * np.eye(3) - np.outer(com, com)
    six = square[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.concatenate([[1.0], com, six])


def point_mass_jacobian(inertia: Array) -> Array:
    """Derivative of `point_mass` by phi, (10, 10)."""
    mass, com = inertia[0], inertia[1:4] / inertia[0]
    by_com = np.zeros((10, 3))
    by_com[1:4] = np.eye(3)
    for axis in range(3):
        unit = np.eye(3)[axis]
        change = 2.0 * com[axis] * np.eye(3) - np.outer(unit, com) - np.outer(com, unit)
        by_com[4:, axis] = change[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    result = np.zeros((10, 10))
    result[:, 1:4] = by_com / mass
    result[:, 0] = -by_com @ com / mass
    return result


@register_effect
class AddedMass(ChoiceEffect):
    """Inertial mass beyond the gravitational mass, as in a fluid."""

    name = "added_mass"
    family = "gravity"
    formula = "f = -m_a a at the body origin (or at the centre of mass)"
    looks_like = (
        "A force residual against the acceleration; the weight at rest does not match the mass "
        "in motion."
    )
    sentence = "the object is heavier to accelerate than to hold (a fluid moves with it)"
    remedy = "Add it to the model, or weigh the object outside the fluid."
    default = "origin"
    alternative = "com"

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The added mass."""
        return (EffectParameter("m_a", "kg", 1.0, "inertial minus gravitational mass", 0.15),)

    def is_possible(self, samples: WrenchSamples, inertia: Array, theta: Array) -> bool:
        """Whether the inertial mass is positive."""
        return bool(theta[0] > -inertia[0])

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """-m_a times the wrench of accelerating a unit mass."""
        return np.asarray(self.jacobian(samples, inertia, theta) @ theta)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Column -[c x a, a] with the acceleration of the origin, or of the centre of mass."""
        if self.reading == self.alternative:
            column = -(self._inertial_regressor(samples) @ point_mass(inertia))
        else:
            force = -to_body(samples, samples.acceleration)
            column = np.concatenate([np.zeros_like(force), force], axis=1)
        return np.asarray(column[..., None])

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Through the centre of mass."""
        if self.reading != self.alternative:
            return np.zeros((len(samples.time), 6, 10))
        return np.asarray(
            -theta[0] * self._inertial_regressor(samples) @ point_mass_jacobian(inertia)
        )

    def moved_load(self, inertia: Array, theta: Array) -> Array:
        """The added mass, at the origin or the centre of mass."""
        at_com = self.reading == self.alternative
        return np.asarray(theta[0] * (point_mass(inertia) if at_com else np.eye(10)[0]))

    def _inertial_regressor(self, samples: WrenchSamples) -> Array:
        """Regressor without gravity."""
        acceleration = to_body(samples, samples.acceleration)
        return regressor(acceleration, samples.angular_velocity, samples.angular_acceleration)


@register_effect
class MassChange(ChoiceEffect):
    """Mass that leaks or fills at a constant rate from the first sample on."""

    name = "mass_change"
    family = "gravity"
    formula = "m(t) = m + rate t, at the centre of mass (or of the whole body in proportion)"
    looks_like = "A weight residual that grows along the recording and turns with gravity."
    sentence = "the load gets lighter or heavier while it is held"
    remedy = "Close the leak, or add the rate to the model."
    default = "com"
    alternative = "whole"

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """The rate."""
        return (EffectParameter("rate", "kg/s", 0.05, "change of mass per time", 0.003),)

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """-rate t Y(per kg)."""
        return np.asarray(self.jacobian(samples, inertia, theta) @ theta)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Column -t Y phi_1, phi_1 the load of one kilogram."""
        column = load_regressor(samples) @ self._per_kilogram(inertia)
        return -samples.time[:, None, None] * column[..., None]

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Through the place (and shape) of the added mass."""
        if self.reading == self.alternative:
            change = np.eye(10) / inertia[0]
            change[:, 0] -= inertia / inertia[0] ** 2
        else:
            change = point_mass_jacobian(inertia)
        scaled = -theta[0] * samples.time[:, None, None] * load_regressor(samples)
        return np.asarray(scaled @ change)

    def _per_kilogram(self, inertia: Array) -> Array:
        if self.reading == self.alternative:
            return np.asarray(inertia / inertia[0])
        return point_mass(inertia)


@register_effect
class GravityTilt(LinearEffect):
    """Gravity that is turned about the horizontal axes of the world frame."""

    name = "gravity_tilt"
    family = "gravity"
    formula = "g' = exp([tilt_x, tilt_y, 0]) g; [m c x R_OW dg, m R_OW dg], dg = g' - g"
    looks_like = "A horizontal force residual at the centre of mass that is constant in the world."
    sentence = "gravity does not point where the world frame says"
    remedy = "Level the base or correct the calibration of the camera or world frame."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Tilt about world x and y."""
        return (
            EffectParameter("tilt_x", "rad", 0.3, "tilt of gravity about world x", 0.06),
            EffectParameter("tilt_y", "rad", 0.3, "tilt of gravity about world y", -0.04),
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Wrench of the change of gravity on the load."""
        change = exp_so3(np.append(theta, 0.0)) @ samples.gravity - samples.gravity
        return np.asarray(self._weight(samples, inertia) @ change)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By both angles."""
        return self._weight(samples, inertia) @ _turn_jacobian(theta, samples.gravity)

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By mass and first moment."""
        change = exp_so3(np.append(theta, 0.0)) @ samples.gravity - samples.gravity
        force = to_body(samples, change)
        result = np.zeros((len(force), 6, 10))
        result[:, 3:, 0] = force
        result[:, :3, 1:4] = -skew(force)
        return result

    def _weight(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Derivative of the wrench by gravity (world), (N, 6, 3)."""
        world = body_from_world(samples)
        return np.concatenate([skew(inertia[1:4]) @ world, inertia[0] * world], axis=1)


def _turn_jacobian(tilt: Array, gravity: Array) -> Array:
    """Derivative of exp([tilt, 0]) g by tilt, (3, 2)."""
    angle = np.append(tilt, 0.0)
    return (-exp_so3(angle) @ skew(gravity) @ right_jacobian(angle))[:, :2]
