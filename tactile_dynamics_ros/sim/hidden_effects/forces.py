"""Hidden forces on the object from its surroundings; mass that moves, clings, comes or goes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pybullet
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.sim.hidden_effects.base import (
    Array,
    HiddenEffect,
    Plant,
    place,
    point_velocity,
    quantity,
)

TAUT_HEIGHT = (0.01, 0.02)


def typical_force(plant: Plant) -> float:
    """Three tenths of the object's weight, but 0.2 to 0.6 N: noticeable, and the grasp holds."""
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
