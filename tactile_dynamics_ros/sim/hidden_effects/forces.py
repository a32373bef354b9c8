"""Hidden forces and torques on the object from its surroundings, applied before every step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_dynamics_ros.sim.hidden_effects.base import (
    Array,
    HiddenEffect,
    Plant,
    place,
    quantity,
)

TAUT_HEIGHT = (0.01, 0.02)


def typical_force(plant: Plant) -> float:
    """Three tenths of the object's weight, but 0.2 to 0.6 N: felt, and no danger to the grasp."""
    return float(np.clip(0.3 * 9.81 * plant.model.inertia.mass, 0.2, 0.6))


@dataclass
class ForceEffect(HiddenEffect):
    """An effect that pushes or twists the object before every simulation step.

    Attributes:
        size: force in N that belongs to the magnitude; set when the effect is attached.
    """

    size: float = 0.0

    def attach(self, plant: Plant) -> None:
        """Draw what is free, then act before every step."""
        self.size = self.magnitude * typical_force(plant)
        self.prepare(plant)
        if self.magnitude != 0.0:
            plant.add_pre_step(self.act)

    def prepare(self, plant: Plant) -> None:
        """Draw directions and places."""

    def act(self, plant: Plant) -> None:
        """Push or twist the object for the coming step."""


@dataclass
class PullEffect(ForceEffect):
    """A force at a body point that grows taut while the object is lifted off its table.

    Half the typical force: a pull that lasts loads the grasp more than drag does.

    Attributes:
        point: (3,) where it acts, body frame, m.
        start_height: of the object when the effect was attached, m.
    """

    point: Array = field(default_factory=lambda: np.zeros(3))
    start_height: float = -np.inf

    def prepare(self, plant: Plant) -> None:
        """Draw the point; without a table the pull is taut at once."""
        self.size *= 0.5
        self.point = self.surface_point(plant)
        if plant.table >= 0:
            self.start_height = float(plant.object_pose()[2, 3])

    def act(self, plant: Plant) -> None:
        """Pull at the point."""
        pose = plant.object_pose()
        tautness = np.interp(pose[2, 3] - self.start_height, TAUT_HEIGHT, (0.0, 1.0))
        if tautness > 0.0:
            here = place(pose, self.point)
            plant.apply_force(tautness * self.pull(plant, pose, here), here)

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """Return the force (3,) on the point that is at ``here``, world axes, N."""
        return np.zeros(3)


@dataclass
class ViscousDrag(ForceEffect):
    """Force -c v on the body origin: the typical force at 0.3 m/s."""

    name = "viscous_drag"

    @property
    def coefficient(self) -> float:
        """Drag coefficient c in N s/m."""
        return self.size / 0.3

    def act(self, plant: Plant) -> None:
        """Drag the body origin."""
        _, velocity = plant.object_velocity()
        plant.apply_force(-self.coefficient * velocity, plant.object_pose()[:3, 3])

    def truth(self) -> dict[str, Any]:
        """Coefficient."""
        return {"c": quantity(self.coefficient, "N s/m")}


@dataclass
class QuadraticDrag(ForceEffect):
    """Force -c |v| v on the body origin: the typical force at 0.17 m/s."""

    name = "quadratic_drag"

    @property
    def coefficient(self) -> float:
        """Drag coefficient c in N s^2/m^2."""
        return self.size / 0.17**2

    def act(self, plant: Plant) -> None:
        """Drag the body origin."""
        _, velocity = plant.object_velocity()
        force = -self.coefficient * np.linalg.norm(velocity) * velocity
        plant.apply_force(force, plant.object_pose()[:3, 3])

    def truth(self) -> dict[str, Any]:
        """Coefficient."""
        return {"c": quantity(self.coefficient, "N s^2/m^2")}


@dataclass
class RotationalDrag(ForceEffect):
    """Torque -c w: the typical force at an arm of 2 cm for 1 rad/s."""

    name = "rotational_drag"

    @property
    def coefficient(self) -> float:
        """Drag coefficient c in N m s/rad."""
        return 0.02 * self.size

    def act(self, plant: Plant) -> None:
        """Brake the rotation."""
        angular, _ = plant.object_velocity()
        plant.apply_torque(-self.coefficient * angular)

    def truth(self) -> dict[str, Any]:
        """Coefficient."""
        return {"c": quantity(self.coefficient, "N m s/rad")}


@dataclass
class TetherSpring(PullEffect):
    """Spring of zero rest length from a point above the start: the typical force at 30 cm."""

    name = "tether_spring"
    anchor: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """Anchor 15 to 30 cm from the start, above it."""
        super().prepare(plant)
        away = self.unit_vector()
        away[2] = abs(away[2])
        self.anchor = plant.object_pose()[:3, 3] + self.rng.uniform(0.15, 0.3) * away

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """Pull towards the anchor."""
        return np.asarray(self.size / 0.3 * (self.anchor - here))

    def truth(self) -> dict[str, Any]:
        """Stiffness, anchor and point."""
        return {
            "stiffness": quantity(self.size / 0.3, "N/m"),
            "anchor": quantity(self.anchor, "m"),
            "point": quantity(self.point, "m"),
        }


@dataclass
class HangingCable(PullEffect):
    """Constant world force, aside and down, at a body point."""

    name = "hanging_cable"
    force: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """Draw direction and point."""
        super().prepare(plant)
        heading, fall = self.rng.uniform(0, 2 * np.pi), np.radians(self.rng.uniform(10.0, 50.0))
        level = np.cos(fall) * np.array([np.cos(heading), np.sin(heading), 0.0])
        self.force = self.size * (level - np.array([0.0, 0.0, np.sin(fall)]))

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """The same force in the world."""
        return self.force

    def truth(self) -> dict[str, Any]:
        """Force and point."""
        return {"force": quantity(self.force, "N"), "point": quantity(self.point, "m")}


@dataclass
class UnsensedContact(PullEffect):
    """Constant body force at a body point, as from a frame that touches the object."""

    name = "unsensed_contact"
    force: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """Draw direction and point."""
        super().prepare(plant)
        self.force = self.size * self.unit_vector()

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """The same force in the body frame."""
        return np.asarray(pose[:3, :3] @ self.force)

    def truth(self) -> dict[str, Any]:
        """Force and point."""
        return {"force": quantity(self.force, "N"), "point": quantity(self.point, "m")}


@dataclass
class SpinningRotor(ForceEffect):
    """A flywheel in the object: 0.04 m times the typical force when turned by 1 rad/s."""

    name = "spinning_rotor"
    momentum: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """Draw the axis."""
        self.momentum = 0.04 * self.size * self.unit_vector()

    def act(self, plant: Plant) -> None:
        """Gyroscopic torque -w x h."""
        angular, _ = plant.object_velocity()
        plant.apply_torque(-np.cross(angular, plant.object_pose()[:3, :3] @ self.momentum))

    def truth(self) -> dict[str, Any]:
        """Angular momentum in the body frame."""
        return {"angular_momentum": quantity(self.momentum, "kg m^2/s")}
