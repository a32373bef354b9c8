"""Hidden forces and torques from the surroundings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects.base import (
    HiddenEffect,
    Quantity,
    force_at_origin,
    force_at_point,
    pure_torque,
)
from tactile_dynamics_ros.synthetic.scenario import Scenario, Scene


def draw_body_point(rng: np.random.Generator, scenario: Scenario) -> np.ndarray:
    """Draw a point in the outer half of the object, body frame."""
    return rng.choice([-1.0, 1.0], size=3) * rng.uniform(0.2, 0.5, size=3) * scenario.body.size


@dataclass(frozen=True)
class ViscousDrag(HiddenEffect):
    """Force -c v at the body origin."""

    name = "viscous_drag"

    @property
    def coefficient(self) -> float:
        """Drag coefficient c in N s/m."""
        return 1.0 * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"c": Quantity(self.coefficient, "N s/m")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Drag against the velocity of the body origin."""
        return force_at_origin(-self.coefficient * scene.motion.velocity)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> ViscousDrag:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class QuadraticDrag(HiddenEffect):
    """Force -c |v| v at the body origin."""

    name = "quadratic_drag"

    @property
    def coefficient(self) -> float:
        """Drag coefficient c in N s^2/m^2."""
        return 4.0 * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"c": Quantity(self.coefficient, "N s^2/m^2")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Drag that grows with the square of the speed."""
        velocity = scene.motion.velocity
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        return force_at_origin(-self.coefficient * speed * velocity)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> QuadraticDrag:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class RotationalDrag(HiddenEffect):
    """Torque -c w."""

    name = "rotational_drag"

    @property
    def coefficient(self) -> float:
        """Drag coefficient c in N m s/rad."""
        return 0.01 * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"c": Quantity(self.coefficient, "N m s/rad")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Torque against the angular velocity."""
        return pure_torque(-self.coefficient * scene.motion.angular_velocity)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> RotationalDrag:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class TetherSpring(HiddenEffect):
    """Spring of zero rest length between a world anchor and a point of the body."""

    name = "tether_spring"
    anchor: np.ndarray
    point: np.ndarray

    @property
    def stiffness(self) -> float:
        """Stiffness k in N/m."""
        return 5.0 * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {
            "stiffness": Quantity(self.stiffness, "N/m"),
            "anchor": Quantity(self.anchor.tolist(), "m"),
            "point": Quantity(self.point.tolist(), "m"),
        }

    def wrench(self, scene: Scene) -> np.ndarray:
        """Pull of the point towards the anchor."""
        stretch = self.anchor - scene.motion.point(self.point)
        return force_at_point(scene, self.point, self.stiffness * stretch)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> TetherSpring:
        """Anchor 8 to 25 cm away from the mean position."""
        anchor = scenario.motion.centre + rng.uniform(0.08, 0.25) * randomness.unit_vector(rng)
        return cls(magnitude, anchor, draw_body_point(rng, scenario))


@dataclass(frozen=True)
class HangingCable(HiddenEffect):
    """Constant world force at a point of the body."""

    name = "hanging_cable"
    direction: np.ndarray
    point: np.ndarray

    @property
    def force(self) -> np.ndarray:
        """Force in N, world axes."""
        return 0.5 * self.magnitude * self.direction

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {
            "force": Quantity(self.force.tolist(), "N"),
            "point": Quantity(self.point.tolist(), "m"),
        }

    def wrench(self, scene: Scene) -> np.ndarray:
        """The same world force at all times."""
        force = np.broadcast_to(self.force, (len(scene.time), 3))
        return force_at_point(scene, self.point, force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> HangingCable:
        """A cable that leads aside and down, at most 60 degrees from the horizontal."""
        heading, fall = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0.0, 60.0))
        level = np.array([np.cos(heading), np.sin(heading), 0.0])
        direction = np.cos(fall) * level - np.sin(fall) * np.array([0.0, 0.0, 1.0])
        return cls(magnitude, direction, draw_body_point(rng, scenario))


@dataclass(frozen=True)
class UnsensedContact(HiddenEffect):
    """Constant body force at a point of the body, as from the palm."""

    name = "unsensed_contact"
    direction: np.ndarray
    point: np.ndarray

    @property
    def force(self) -> np.ndarray:
        """Force in N, body axes."""
        return 0.5 * self.magnitude * self.direction

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {
            "force": Quantity(self.force.tolist(), "N"),
            "point": Quantity(self.point.tolist(), "m"),
        }

    def wrench(self, scene: Scene) -> np.ndarray:
        """The same force in the body frame at all times."""
        return force_at_point(scene, self.point, scene.motion.to_world(self.force))

    @classmethod
    def draw(
        cls, rng: np.random.Generator, magnitude: float, scenario: Scenario
    ) -> UnsensedContact:
        """A push on one face, at most 40 degrees from its inward normal."""
        point = draw_body_point(rng, scenario)
        axis = int(rng.integers(3))
        point[axis] = np.sign(point[axis]) * scenario.body.size[axis] / 2
        inward = -np.sign(point[axis]) * np.eye(3)[axis]
        push = inward + 0.5 * randomness.unit_vector(rng)
        return cls(magnitude, push / np.linalg.norm(push), point)
