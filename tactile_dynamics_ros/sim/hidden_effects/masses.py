"""Hidden mass: matter that moves inside, clings outside, comes or goes; gravity that is askew."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.sim.hidden_effects.base import (
    HiddenEffect,
    Plant,
    place,
    point_velocity,
    quantity,
)
from tactile_dynamics_ros.sim.hidden_effects.forces import ForceEffect


def set_mass(plant: Plant, mass: float) -> None:
    """Give the object another mass, with centre of mass and inertia about it unchanged."""
    moments = np.linalg.eigvalsh(plant.model.inertia.inertia_com)
    pybullet.changeDynamics(
        plant.object_id,
        -1,
        mass=mass,
        localInertiaDiagonal=moments.tolist(),
        physicsClientId=plant.client,
    )


@dataclass
class SloshingMass(ForceEffect):
    """Half of the mass is a second body, held at the centre of mass by a spring and a damper.

    It swings at 0.8 to 1.1 Hz, slowly enough for the motions of an arm to wake it.
    """

    name = "sloshing_mass"
    frequency_hz: float = 3.0
    damping_ratio: float = 0.1
    ball: int = -1
    mass: float = 0.0

    def prepare(self, plant: Plant) -> None:
        """Take the mass out of the object and put it into a ball that touches nothing."""
        self.frequency_hz = float(self.rng.uniform(0.8, 1.1))
        self.damping_ratio = float(self.rng.uniform(0.05, 0.2))
        total = plant.model.inertia.mass
        self.mass = min(0.5 * self.magnitude, 0.9) * total
        if self.mass == 0.0:
            return
        set_mass(plant, total - self.mass)
        com = place(plant.object_pose(), plant.model.inertia.com)
        sag = plant.gravity / (2 * np.pi * self.frequency_hz) ** 2
        self.ball = pybullet.createMultiBody(
            baseMass=self.mass,
            basePosition=(com + sag).tolist(),
            physicsClientId=plant.client,
        )
        pybullet.changeDynamics(
            self.ball, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=plant.client
        )

    def act(self, plant: Plant) -> None:
        """Spring and damper between the ball and the body point where it is."""
        pose, inertia = plant.object_pose(), plant.model.inertia
        centre, _ = pybullet.getBasePositionAndOrientation(self.ball, plant.client)
        speed, _ = pybullet.getBaseVelocity(self.ball, plant.client)
        here = pose[:3, :3].T @ (np.array(centre) - pose[:3, 3])
        natural = 2 * np.pi * self.frequency_hz
        slide = np.array(speed) - point_velocity(plant, here)
        stretch = np.array(centre) - place(pose, inertia.com)
        force = -self.mass * (natural**2 * stretch + 2 * self.damping_ratio * natural * slide)
        pybullet.applyExternalForce(
            self.ball,
            -1,
            force.tolist(),
            centre,
            pybullet.WORLD_FRAME,
            physicsClientId=plant.client,
        )
        plant.apply_force(-force, np.array(centre))

    def truth(self) -> dict[str, Any]:
        """Mass, frequency and damping."""
        return {
            "mass": quantity(self.mass, "kg"),
            "frequency": quantity(self.frequency_hz, "Hz"),
            "damping_ratio": quantity(self.damping_ratio, ""),
        }


@dataclass
class AddedMass(ForceEffect):
    """The object carries its own mass in fluid that has to be accelerated but weighs nothing."""

    name = "added_mass"
    mass: float = 0.0

    def prepare(self, plant: Plant) -> None:
        """Make the body heavier."""
        self.mass = self.magnitude * plant.model.inertia.mass
        set_mass(plant, plant.model.inertia.mass + self.mass)

    def act(self, plant: Plant) -> None:
        """Carry the weight of the fluid."""
        com = place(plant.object_pose(), plant.model.inertia.com)
        plant.apply_force(-self.mass * plant.gravity, com)

    def truth(self) -> dict[str, Any]:
        """Added inertial mass."""
        return {"mass": quantity(self.mass, "kg")}


@dataclass
class MassChange(ForceEffect):
    """The object fills by one hundredth of its mass per second, or leaks as fast."""

    name = "mass_change"
    rate: float = 0.0
    start: float = 0.0

    def prepare(self, plant: Plant) -> None:
        """Leak or fill."""
        sign = float(self.rng.choice([-1.0, 1.0]))
        self.rate = 0.01 * sign * self.magnitude * plant.model.inertia.mass
        self.start = plant.time

    def act(self, plant: Plant) -> None:
        """Set the mass of this moment; a tenth of it never leaks."""
        mass = plant.model.inertia.mass
        set_mass(plant, max(mass + self.rate * (plant.time - self.start), 0.1 * mass))

    def truth(self) -> dict[str, Any]:
        """Rate; the sign is that of filling."""
        return {"rate": quantity(self.rate, "kg/s")}


@dataclass
class GravityTilt(HiddenEffect):
    """Gravity is turned by 5 degrees about a level axis: the world frame is not upright."""

    name = "gravity_tilt"
    heading: float = 0.0

    @property
    def angle(self) -> float:
        """Tilt in rad."""
        return float(np.radians(5.0) * self.magnitude)

    def attach(self, plant: Plant) -> None:
        """Turn gravity for everything."""
        self.heading = float(self.rng.uniform(0, 2 * np.pi))
        axis = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        plant.set_gravity(Rotation.from_rotvec(self.angle * axis).apply(plant.gravity))

    def truth(self) -> dict[str, Any]:
        """Rotation about the level axes x and y."""
        level = np.array([np.cos(self.heading), np.sin(self.heading)])
        return {"tilt": quantity(self.angle * level, "rad")}
