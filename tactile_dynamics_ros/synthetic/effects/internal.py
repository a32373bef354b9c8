"""Hidden physics of the object itself and of gravity, and what happens at one time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects.base import (
    HiddenEffect,
    Quantity,
    force_at_point,
    pure_torque,
)
from tactile_dynamics_ros.synthetic.objects import HeldObject
from tactile_dynamics_ros.synthetic.scenario import Scenario, Scene


@dataclass(frozen=True)
class SpinningRotor(HiddenEffect):
    """A flywheel of constant angular momentum in the body frame."""

    name = "spinning_rotor"
    axis: np.ndarray

    @property
    def momentum(self) -> np.ndarray:
        """Angular momentum in kg m^2/s, body axes."""
        return 0.01 * self.magnitude * self.axis

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"angular_momentum": Quantity(self.momentum.tolist(), "kg m^2/s")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Reaction to turning the flywheel's momentum."""
        momentum = scene.motion.to_world(self.momentum)
        return pure_torque(-np.cross(scene.motion.angular_velocity, momentum))

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> SpinningRotor:
        """Any axis."""
        return cls(magnitude, randomness.unit_vector(rng))


@dataclass(frozen=True)
class SloshingMass(HiddenEffect):
    """Part of the mass is a ball on a spring and damper inside the object.

    The ball obeys Newton in the moving frame; what the recording lacks is the difference between
    the force that really moves it and the force that a ball glued at its rest place would need.
    """

    name = "sloshing_mass"
    total_mass: float
    rest: np.ndarray
    frequency_hz: float
    damping_ratio: float

    @property
    def mass(self) -> float:
        """Mass of the ball in kg."""
        return 0.3 * self.magnitude * self.total_mass

    @property
    def maximal_magnitude(self) -> float:
        """No more than six tenths of the mass can slosh."""
        return 2.0

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {
            "mass": Quantity(self.mass, "kg"),
            "frequency": Quantity(self.frequency_hz, "Hz"),
            "damping_ratio": Quantity(self.damping_ratio, ""),
            "point": Quantity(self.rest.tolist(), "m"),
        }

    def wrench(self, scene: Scene) -> np.ndarray:
        """Glued ball minus moving ball."""
        motion = scene.motion
        place, spring = self.integrate(scene)
        arm, moving = motion.to_world(place), self.mass * motion.to_world(spring)
        glued = self.mass * (motion.point_acceleration(self.rest) - scene.gravity)
        moving_wrench = np.concatenate([np.cross(arm, moving), moving], axis=1)
        return force_at_point(scene, self.rest, glued) - moving_wrench

    def integrate(self, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Ball position (N, 3) and spring-damper force per kilogram (N, 3), body axes.

        Starts at the static sag; classical Runge-Kutta over pairs of samples, cubic in between.
        """
        motion, time = scene.motion, scene.time
        omega, alpha = (
            motion.to_body(motion.angular_velocity),
            motion.to_body(motion.angular_acceleration),
        )
        free_fall = motion.to_body(scene.gravity - motion.acceleration)
        natural = 2 * np.pi * self.frequency_hz
        stiffness, damping = natural**2, 2 * self.damping_ratio * natural
        coupling, coriolis = _moving_frame_matrices(omega, alpha)
        position_map = -coupling - stiffness * np.eye(3)
        velocity_map = -coriolis - damping * np.eye(3)
        drive = free_fall + stiffness * self.rest
        system = np.zeros((len(time), 6, 7))
        system[:, :3, 3:6] = np.eye(3)
        system[:, 3:, :3], system[:, 3:, 3:6], system[:, 3:, 6] = position_map, velocity_map, drive
        start = np.concatenate([np.linalg.solve(-position_map[0], drive[0]), np.zeros(3)])
        state = _integrate_linear(system, start, time[1] - time[0])
        place, speed = state[:, :3], state[:, 3:]
        return place, -stiffness * (place - self.rest) - damping * speed

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> SloshingMass:
        """A liquid that sloshes at 2 to 4 Hz near the middle of the object."""
        rest = rng.uniform(-0.15, 0.15, size=3) * scenario.body.size
        frequency, damping = rng.uniform(2.0, 4.0), rng.uniform(0.05, 0.3)
        return cls(magnitude, scenario.body.mass, rest, frequency, damping)


@dataclass(frozen=True)
class AddedMass(HiddenEffect):
    """Fluid around the object that has to be accelerated but weighs nothing."""

    name = "added_mass"
    com: np.ndarray
    object_mass: float

    @property
    def mass(self) -> float:
        """Added inertial mass in kg."""
        return 0.2 * self.magnitude * self.object_mass

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"mass": Quantity(self.mass, "kg")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Resistance to the acceleration of the centre of mass."""
        force = -self.mass * scene.motion.point_acceleration(self.com)
        return force_at_point(scene, self.com, force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> AddedMass:
        """Nothing but the size is free."""
        return cls(magnitude, scenario.body.com, scenario.body.mass)


@dataclass(frozen=True)
class MassChange(HiddenEffect):
    """A ball of matter around the centre of mass grows or shrinks at a constant rate."""

    name = "mass_change"
    com: np.ndarray
    object_mass: float
    duration: float
    sign: float
    radius: float = 0.01

    @property
    def rate(self) -> float:
        """Mass rate in kg/s; the sign is that of filling."""
        return 0.3 * self.sign * self.magnitude * self.object_mass / self.duration

    @property
    def maximal_magnitude(self) -> float:
        """A leak cannot take more than nine tenths of the mass."""
        return 3.0 if self.sign < 0 else np.inf

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"rate": Quantity(self.rate, "kg/s")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Minus the wrench that the gained matter needs; matter joins and leaves at rest."""
        gained = (self.rate * (scene.time - scene.time[0]))[:, None]
        force = -gained * (scene.motion.point_acceleration(self.com) - scene.gravity)
        spin = -gained * 0.4 * self.radius**2 * scene.motion.angular_acceleration
        return force_at_point(scene, self.com, force) + pure_torque(spin)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> MassChange:
        """Leak or fill."""
        body, sign = scenario.body, float(rng.choice([-1.0, 1.0]))
        return cls(magnitude, body.com, body.mass, scenario.options.duration, sign)


@dataclass(frozen=True)
class GravityTilt(HiddenEffect):
    """Gravity is turned about a level axis against the world frame's -z."""

    name = "gravity_tilt"
    com: np.ndarray
    object_mass: float
    heading: float

    @property
    def angle(self) -> float:
        """Tilt in rad."""
        return np.radians(2.0) * self.magnitude

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        level = self.angle * np.array([np.cos(self.heading), np.sin(self.heading)])
        return {"tilt": Quantity(level.tolist(), "rad")}

    @property
    def maximal_magnitude(self) -> float:
        """At most 60 degrees."""
        return 30.0

    def wrench(self, scene: Scene) -> np.ndarray:
        """Weight in the true direction minus weight along -z."""
        axis = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        true_gravity = Rotation.from_rotvec(self.angle * axis).apply(scene.gravity)
        change = self.object_mass * (true_gravity - scene.gravity)
        return force_at_point(scene, self.com, np.broadcast_to(change, (len(scene.time), 3)))

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> GravityTilt:
        """Any heading."""
        return cls(magnitude, scenario.body.com, scenario.body.mass, rng.uniform(0, 2 * np.pi))


def _moving_frame_matrices(omega: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices of x -> alpha x x + omega x (omega x x) and of v -> 2 omega x v, (N, 3, 3) each."""
    basis = np.eye(3)
    turn = np.cross(omega[:, None, :], basis).transpose(0, 2, 1)
    twist = np.cross(alpha[:, None, :], basis).transpose(0, 2, 1)
    return twist + turn @ turn, 2 * turn


def _integrate_linear(system: np.ndarray, start: np.ndarray, step: float) -> np.ndarray:
    """Integrate y' = A y + b given [A | b] at every sample: RK4 with midpoints by interpolation."""
    middle = 0.5 * (system[:-1] + system[1:])
    middle[1:-1] = (-system[:-3] + 9 * system[1:-2] + 9 * system[2:-1] - system[3:]) / 16
    states = np.empty((len(system), 6))
    states[0] = start
    y = np.append(start, 1.0)
    for n in range(len(system) - 1):
        first, between, last = system[n], middle[n], system[n + 1]
        k1 = first @ y
        k2 = between[:, :6] @ (y[:6] + 0.5 * step * k1) + between[:, 6]
        k3 = between[:, :6] @ (y[:6] + 0.5 * step * k2) + between[:, 6]
        k4 = last[:, :6] @ (y[:6] + step * k3) + last[:, 6]
        y[:6] += step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states[n + 1] = y[:6]
    return states


@dataclass(frozen=True)
class PayloadChange(HiddenEffect):
    """A small heavy thing is put on the object, and moves with it from then on."""

    name = "payload_change"
    added: float
    place: np.ndarray
    at: float

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {
            "dm": Quantity(self.added, "kg"),
            "place": Quantity(self.place.tolist(), "m"),
            "t": Quantity(self.at, "s"),
        }

    def wrench(self, scene: Scene) -> np.ndarray:
        """Minus the force that carries it, after it was put there."""
        carried = -self.added * (scene.motion.point_acceleration(self.place) - scene.gravity)
        there = scene.time - scene.time[0] >= self.at
        return there[:, None] * force_at_point(scene, self.place, carried)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> PayloadChange:
        """A third to two thirds of the object's mass, somewhere on it, in the middle part."""
        body, duration = scenario.body, scenario.options.duration
        added = magnitude * body.mass * rng.uniform(0.33, 0.67)
        place = body.com + rng.uniform(-0.3, 0.3, 3) * body.size
        return cls(magnitude, float(added), place, duration * float(rng.uniform(0.3, 0.7)))


@dataclass(frozen=True)
class GraspShift(HiddenEffect):
    """The object slips on the sensor: it is carried at another place and turned."""

    name = "grasp_shift"
    before: HeldObject
    shift: np.ndarray
    turn: np.ndarray
    at: float

    @property
    def after(self) -> HeldObject:
        """The object after it slipped."""
        turn = Rotation.from_rotvec(self.turn).as_matrix()
        inertia = turn @ self.before.inertia_com @ turn.T
        return replace(self.before, com=self.before.com + self.shift, inertia_com=inertia)

    @property
    def parameters(self) -> dict[str, Quantity]:
        """True values by name."""
        return {"d": Quantity(self.shift.tolist(), "m"), "t": Quantity(self.at, "s")}

    def wrench(self, scene: Scene) -> np.ndarray:
        """What carries it where it was less what carries it where it is."""
        was, now = (
            body.inertial_wrench(scene.motion, scene.gravity) for body in (self.before, self.after)
        )
        return np.asarray((scene.time - scene.time[0] >= self.at)[:, None] * (was - now))

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> GraspShift:
        """A centimetre and a few degrees, in the middle part."""
        shift = 0.01 * magnitude * randomness.unit_vector(rng)
        turn = 0.1 * magnitude * randomness.unit_vector(rng)
        at = scenario.options.duration * float(rng.uniform(0.3, 0.7))
        return cls(magnitude, scenario.body, shift, turn, at)
