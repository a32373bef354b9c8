"""Things of the world that pull at the object: a tether, a cable."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples, once_per_motion
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.geometry import (
    arm_basis,
    body_from_world,
    force_at,
    force_columns,
    point_columns,
    to_body,
    torque_columns,
    vector_parameters,
)
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import skew

_SHORTEST = 1e-4
"""Shortest length by which the stretch of a spring is divided, m: the direction of a spring whose
ends meet is undefined. It is below the noise of poses (0.5 mm), so that it acts in no recording."""


@register_effect
class HangingCable(Effect):
    """A force of constant direction and size in the world at one point of the body."""

    name = "hanging_cable"
    family = "elastic"
    formula = "F constant in the world, at the body point p: [p x R_OW F, R_OW F]"
    looks_like = (
        "A force residual that stands still in the world while the object turns, and a torque "
        "residual that follows its lever arm."
    )
    sentence = "something pulls at the object with a force that is constant in the world"
    remedy = "Detach or support the cable, or add it to the model."

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Force (3) in the world, point (3) in the body frame."""
        return vector_parameters("F", "N", 5.0, "force, world axes", 0.5) + vector_parameters(
            "p", "m", 0.1, "point of attack, body frame", 0.04
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """[p x R_OW F, R_OW F]."""
        return force_at(theta[3:], to_body(samples, theta[:3]))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By force and by point."""
        by_force = force_columns(theta[3:], body_from_world(samples))
        by_point = point_columns(to_body(samples, theta[:3]))
        return np.concatenate([by_force, by_point], axis=2)

    def factored(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array]:
        """Forces at the origin and products of lever arm and force."""
        return _world_forces(samples), _by_force_and_point(theta[:3], theta[3:])

    def coefficients(self, samples: WrenchSamples, theta: Array) -> Array:
        """F and p_j F_k."""
        return _force_and_products(theta[:3], theta[3:])

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Three forces at the origin and the nine products of lever arm and force."""
        return _world_forces(samples)

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """Force from the force rows, point from the rank-one part of the products."""
        products = coefficients[3:].reshape(3, 3)
        force = coefficients[:3]
        size = float(force @ force)
        point = products @ force / size if size > 0 else np.zeros(3)
        return np.concatenate([force, np.clip(point, -0.3, 0.3)])


@register_effect
class TetherSpring(Effect):
    """A linear spring from a world anchor to a body point, with or without rest length.

    f = -k (1 - l / |d|) d, d = p_WO + R_WO b - a; a slack string (l > |d|) pushes, as a rod would.
    """

    name = "tether_spring"
    family = "elastic"
    formula = "f = -k (1 - l/|d|) d at the body point b, d = p_WO + R_WO b - a"
    looks_like = "A force residual that follows the position of the object: it always points home."
    sentence = "a spring ties the object to a fixed point of the world"
    remedy = "Add it to the model, or cut the tether (hose, cable, rubber band)."

    def __init__(self, rest: bool = False) -> None:
        """Choose whether the spring has a rest length.

        Args:
            rest: estimate a rest length; otherwise it is zero.
        """
        self.rest = rest
        self.reading = "rest_length" if rest else ""

    @property
    def screened_as(self) -> str:
        """The basis does not depend on the rest length."""
        return self.name

    def with_reading(self, reading: str) -> Effect:
        """`rest_length`."""
        if reading != "rest_length":
            raise BadInputError(f"effect '{self.name}' has no reading '{reading}': rest_length")
        return TetherSpring(rest=True)

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Without and with rest length."""
        return (TetherSpring(), TetherSpring(rest=True))

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Stiffness, anchor (3, world), point (3, body), rest length."""
        rest = (EffectParameter("l", "m", 1.0, "rest length", 0.1),) if self.rest else ()
        return (
            EffectParameter("k", "N/m", 100.0, "stiffness", 8.0, least=0.0),
            *vector_parameters("a", "m", 2.0, "anchor, world", 0.3),
            *vector_parameters("b", "m", 0.1, "point of attack, body frame", 0.04),
            *rest,
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """[b x f, f] in the body frame."""
        stretch, direction, length = self._geometry(samples, theta)
        force = -theta[0] * (stretch - self._rest_length(theta) * direction)
        return force_at(theta[4:7], to_body(samples, force))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By k, a, b and, with rest length, l."""
        stiffness, point, rest = theta[0], theta[4:7], self._rest_length(theta)
        stretch, direction, length = self._geometry(samples, theta)
        unit_force = -(stretch - rest * direction)
        projector = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        by_stretch = -stiffness * (np.eye(3) - (rest / length)[:, None, None] * projector)
        turn = body_from_world(samples)
        by_k = force_at(point, to_body(samples, unit_force))[..., None]
        by_anchor = force_columns(point, -turn @ by_stretch)
        by_point = force_columns(point, turn @ by_stretch @ samples.rotation)
        by_point = by_point + point_columns(stiffness * to_body(samples, unit_force))
        columns = [by_k, by_anchor, by_point]
        if self.rest:
            columns.append(force_at(point, stiffness * to_body(samples, direction))[..., None])
        return np.concatenate(columns, axis=2)

    def factored(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array] | None:
        """Without rest length: k, k a, k b and the products of b with k a, see `coefficients`."""
        if self.rest:
            return None
        stiffness, anchor, point = theta[0], theta[1:4], theta[4:7]
        weights = np.zeros((19, 7))
        weights[0, 0] = 1.0
        pull = _by_force_and_point(stiffness * anchor, point)
        weights[1:13, 0] = pull[:, :3] @ anchor
        weights[1:13, 1:4] = stiffness * pull[:, :3]
        weights[1:13, 4:7] = pull[:, 3:]
        weights[13:16, 0] = weights[16:, 0] = point
        weights[13:16, 4:7] = weights[16:, 4:7] = stiffness * np.eye(3)
        return _spring_columns(samples), weights

    def coefficients(self, samples: WrenchSamples, theta: Array) -> Array | None:
        """The numbers k, k a, b_j k a_k, k b and k b, see `_spring_columns`."""
        if self.rest:
            return None
        stiffness, anchor, point = theta[0], theta[1:4], theta[4:7]
        pull = _force_and_products(stiffness * anchor, point)
        return np.concatenate([[stiffness], pull, stiffness * point, stiffness * point])

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Spring at the origin, constant world force, spring of the body point, lever arms.

        With rest length the direction to a nearby anchor turns, which the same columns follow to
        first order.
        """
        world = body_from_world(samples)
        middle = samples.position - samples.position.mean(axis=0)
        spring = -np.einsum("nij,nj->ni", world, middle)[..., None]
        forces = np.concatenate([spring, world], axis=2)
        at_origin = force_columns(np.zeros(3), forces)
        constant = np.broadcast_to(np.eye(3), (len(middle), 3, 3))
        arms = np.einsum("jab,nb->naj", skew(np.eye(3)), spring[..., 0])
        point = force_columns(np.zeros(3), -constant)
        return np.concatenate([at_origin, point, torque_columns(arms), arm_basis(world)], axis=2)

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """Stiffness and anchor from the force columns, the point from the torques."""
        stiffness = coefficients[0] if abs(coefficients[0]) > 1e-3 else 1e-3
        pull = coefficients[1:4]
        anchor = samples.position.mean(axis=0) + np.clip(pull / stiffness, -3.0, 3.0)
        products = coefficients[10:].reshape(3, 3)
        size = float(pull @ pull)
        point = products @ pull / size if size > 0 else np.zeros(3)
        theta = np.concatenate([[stiffness], anchor, np.clip(point, -0.2, 0.2)])
        return np.append(theta, 0.0) if self.rest else theta

    def _rest_length(self, theta: Array) -> float:
        return float(theta[7]) if self.rest else 0.0

    def _geometry(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array, Array]:
        """Stretch vector d, its direction and length."""
        stretch = samples.position + samples.rotation @ theta[4:7] - theta[1:4]
        length = np.maximum(np.linalg.norm(stretch, axis=1), _SHORTEST)
        return stretch, stretch / length[:, None], length


@once_per_motion
def _world_forces(samples: WrenchSamples) -> Array:
    """Forces along the world axes at the origin and their nine torques on arms, (N, 6, 12)."""
    force = body_from_world(samples)
    return np.concatenate([force_columns(np.zeros(3), force), arm_basis(force)], axis=2)


def _force_and_products(force: Array, point: Array) -> Array:
    """Coefficients (12,) of `_world_forces` for a force at a point."""
    return np.concatenate([force, np.outer(point, force).ravel()])


def _by_force_and_point(force: Array, point: Array) -> Array:
    """Their derivative (12, 6)."""
    products = np.zeros((3, 3, 6))
    products[:, range(3), range(3)] = point[:, None]
    products[range(3), :, range(3, 6)] = force
    return np.concatenate([np.eye(3, 6), products.reshape(9, 6)])


@once_per_motion
def _spring_columns(samples: WrenchSamples) -> Array:
    """Force -p, `_world_forces`, torques of -p on arms and forces along the body, (N, 6, 19)."""
    spring = -to_body(samples, samples.position)[..., None]
    arms = np.swapaxes(skew(np.eye(3)) @ spring[:, None], 1, 3)[:, 0]
    fixed = np.broadcast_to(-np.eye(3), (len(spring), 3, 3))
    at_origin = [force_columns(np.zeros(3), forces) for forces in (spring, fixed)]
    columns = [at_origin[0], _world_forces(samples), torque_columns(arms), at_origin[1]]
    return np.concatenate(columns, axis=2)
