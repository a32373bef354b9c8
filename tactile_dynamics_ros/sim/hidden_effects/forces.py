"""Hidden forces and torques on the object from its surroundings, applied before every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.sim.hidden_effects.base import (
    Array,
    HiddenEffect,
    Plant,
    place,
    quantity,
)


@dataclass
class ForceEffect(HiddenEffect):
    """An effect that pushes or twists the object before every simulation step."""

    def attach(self, plant: Plant) -> None:
        """Draw what is free, then act before every step."""
        self.prepare(plant)
        if self.magnitude != 0.0:
            plant.add_pre_step(self.act)

    def prepare(self, plant: Plant) -> None:
        """Draw directions and places."""

    def act(self, plant: Plant) -> None:
        """Push or twist the object for the coming step."""


@dataclass
class ViscousDrag(ForceEffect):
    """Force -c v on the body origin, c = 1 N s/m."""

    name = "viscous_drag"

    def act(self, plant: Plant) -> None:
        """Drag the body origin."""
        _, velocity = plant.object_velocity()
        plant.apply_force(-self.magnitude * velocity, plant.object_pose()[:3, 3])

    def truth(self) -> dict[str, Any]:
        """Coefficient."""
        return {"c": quantity(self.magnitude, "N s/m")}


@dataclass
class QuadraticDrag(ForceEffect):
    """Force -c |v| v on the body origin, c = 4 N s^2/m^2."""

    name = "quadratic_drag"

    def act(self, plant: Plant) -> None:
        """Drag the body origin."""
        _, velocity = plant.object_velocity()
        force = -4.0 * self.magnitude * np.linalg.norm(velocity) * velocity
        plant.apply_force(force, plant.object_pose()[:3, 3])

    def truth(self) -> dict[str, Any]:
        """Coefficient."""
        return {"c": quantity(4.0 * self.magnitude, "N s^2/m^2")}


@dataclass
class RotationalDrag(ForceEffect):
    """Torque -c w, c = 0.02 N m s/rad."""

    name = "rotational_drag"

    def act(self, plant: Plant) -> None:
        """Brake the rotation."""
        angular, _ = plant.object_velocity()
        plant.apply_torque(-0.02 * self.magnitude * angular)

    def truth(self) -> dict[str, Any]:
        """Coefficient."""
        return {"c": quantity(0.02 * self.magnitude, "N m s/rad")}


@dataclass
class TetherSpring(ForceEffect):
    """Spring of 5 N/m and zero rest length from a point above the start to a body point."""

    name = "tether_spring"
    anchor: Array | None = None
    point: Array | None = None

    def prepare(self, plant: Plant) -> None:
        """Anchor 15 to 30 cm from the start, above it."""
        away = self.unit_vector()
        away[2] = abs(away[2])
        self.point = self.surface_point(plant)
        self.anchor = plant.object_pose()[:3, 3] + self.rng.uniform(0.15, 0.3) * away

    def act(self, plant: Plant) -> None:
        """Pull the point towards the anchor."""
        assert self.point is not None and self.anchor is not None
        point = place(plant.object_pose(), self.point)
        plant.apply_force(5.0 * self.magnitude * (self.anchor - point), point)

    def truth(self) -> dict[str, Any]:
        """Stiffness, anchor and point."""
        return {
            "stiffness": quantity(5.0 * self.magnitude, "N/m"),
            "anchor": quantity(self.anchor, "m"),
            "point": quantity(self.point, "m"),
        }


@dataclass
class HangingCable(ForceEffect):
    """Constant world force of 0.5 N, aside and down, at a body point."""

    name = "hanging_cable"
    force: Array | None = None
    point: Array | None = None

    def prepare(self, plant: Plant) -> None:
        """Draw direction and point."""
        heading, fall = self.rng.uniform(0, 2 * np.pi), np.radians(self.rng.uniform(10.0, 50.0))
        level = np.cos(fall) * np.array([np.cos(heading), np.sin(heading), 0.0])
        self.force = 0.5 * self.magnitude * (level - np.array([0.0, 0.0, np.sin(fall)]))
        self.point = self.surface_point(plant)

    def act(self, plant: Plant) -> None:
        """Pull at the point."""
        assert self.force is not None and self.point is not None
        plant.apply_force(self.force, place(plant.object_pose(), self.point))

    def truth(self) -> dict[str, Any]:
        """Force and point."""
        return {"force": quantity(self.force, "N"), "point": quantity(self.point, "m")}


@dataclass
class UnsensedContact(ForceEffect):
    """Constant body force of 0.5 N at a body point, as from a frame that touches the object."""

    name = "unsensed_contact"
    force: Array | None = None
    point: Array | None = None

    def prepare(self, plant: Plant) -> None:
        """Draw direction and point."""
        self.force = 0.5 * self.magnitude * self.unit_vector()
        self.point = self.surface_point(plant)

    def act(self, plant: Plant) -> None:
        """Push in the body frame."""
        assert self.force is not None and self.point is not None
        pose = plant.object_pose()
        plant.apply_force(pose[:3, :3] @ self.force, place(pose, self.point))

    def truth(self) -> dict[str, Any]:
        """Force and point."""
        return {"force": quantity(self.force, "N"), "point": quantity(self.point, "m")}


@dataclass
class SpinningRotor(ForceEffect):
    """A flywheel of 0.01 kg m^2/s in the object: it resists being turned."""

    name = "spinning_rotor"
    momentum: Array | None = None

    def prepare(self, plant: Plant) -> None:
        """Draw the axis."""
        self.momentum = 0.01 * self.magnitude * self.unit_vector()

    def act(self, plant: Plant) -> None:
        """Gyroscopic torque -w x h."""
        assert self.momentum is not None
        angular, _ = plant.object_velocity()
        plant.apply_torque(-np.cross(angular, plant.object_pose()[:3, :3] @ self.momentum))

    def truth(self) -> dict[str, Any]:
        """Angular momentum in the body frame."""
        return {"angular_momentum": quantity(self.momentum, "kg m^2/s")}
