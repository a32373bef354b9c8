"""Hidden faults between the skin and the message: friction at the tip, gain, zero, axes, clock."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pybullet
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.hidden_effects.base import (
    Array,
    HiddenEffect,
    Plant,
    SensorView,
    quantity,
)


@dataclass
class TouchEffect(HiddenEffect):
    """An effect that changes the force which a fingertip sensor reports, in the sensor's axes.

    Attributes:
        fingers: names of the robot's fingers, once attached.
    """

    fingers: tuple[str, ...] = ()

    def attach(self, plant: Plant) -> None:
        """Learn which fingers there are, and draw what is random."""
        self.fingers = plant.fingers
        self.draw(plant)

    def draw(self, plant: Plant) -> None:
        """Draw what is random."""

    def feel(self, view: SensorView) -> dict[str, ContactReading]:
        """Change the force of every finger that touches."""
        return {finger: self._measured(finger, view) for finger in view.contacts}

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Return the reported force (3,) of the true one, N, sensor axes."""
        return force

    def _measured(self, finger: str, view: SensorView) -> ContactReading:
        reading = view.contacts[finger]
        if finger not in view.sensor_rotation or self.magnitude == 0.0:
            return reading
        rotation = view.sensor_rotation[finger]
        force = self.change(finger, rotation.T @ reading.force, view.time)
        if not reading.in_contact:
            return reading
        return dataclasses.replace(reading, force=rotation @ force)

    def draw_affected(self) -> Array:
        """Which fingers are faulty (F,): one of them, or all to different degrees."""
        if self.rng.uniform() < 0.5:
            return np.asarray(np.eye(len(self.fingers))[self.rng.integers(len(self.fingers))])
        return np.asarray(self.rng.uniform(0.4, 1.0, size=len(self.fingers)))

    def per_finger(self, rows: Array, name: str, unit: str) -> dict[str, Any]:
        """True parameters named `<finger>.<name>`."""
        return {
            f"{finger}.{name}": quantity(row, unit)
            for finger, row in zip(self.fingers, rows, strict=True)
        }


@dataclass
class ForceBias(TouchEffect):
    """A constant of about 0.3 N is added."""

    name = "force_bias"
    rows: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def draw(self, plant: Plant) -> None:
        """Draw the offsets."""
        directions = np.stack([self.unit_vector() for _ in self.fingers])
        self.rows = 0.3 * self.magnitude * self.draw_affected()[:, None] * directions

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Add the offset."""
        return np.asarray(force + self.rows[self.fingers.index(finger)])

    def truth(self) -> dict[str, Any]:
        """Offset of each finger."""
        return self.per_finger(self.rows, "bias", "N")


@dataclass
class ForceDrift(TouchEffect):
    """The zero wanders by about 0.01 N/s from the moment at which the effect is attached."""

    name = "force_drift"
    rows: Array = field(default_factory=lambda: np.zeros((0, 3)))
    start: float = 0.0

    def draw(self, plant: Plant) -> None:
        """Draw the rates."""
        directions = np.stack([self.unit_vector() for _ in self.fingers])
        self.rows = 0.01 * self.magnitude * self.draw_affected()[:, None] * directions
        self.start = plant.time

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Add rate times elapsed time."""
        return np.asarray(force + (time - self.start) * self.rows[self.fingers.index(finger)])

    def truth(self) -> dict[str, Any]:
        """Rate of each finger."""
        return self.per_finger(self.rows, "rate", "N/s")


@dataclass
class ForceScale(TouchEffect):
    """The gain is wrong by about 0.2."""

    name = "force_scale"
    excess: Array = field(default_factory=lambda: np.zeros(0))

    def draw(self, plant: Plant) -> None:
        """Draw the gains."""
        sign = self.rng.choice([-1.0, 1.0], size=len(self.fingers))
        self.excess = np.maximum(0.2 * self.magnitude * self.draw_affected() * sign, -0.9)

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Multiply."""
        return np.asarray(force * (1.0 + self.excess[self.fingers.index(finger)]))

    def truth(self) -> dict[str, Any]:
        """Gain minus one of each finger."""
        return self.per_finger(self.excess, "gain_error", "")


@dataclass
class SensorRotation(TouchEffect):
    """The sensor is mounted askew by about 10 degrees."""

    name = "sensor_rotation"
    rows: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def draw(self, plant: Plant) -> None:
        """Draw the axes."""
        directions = np.stack([self.unit_vector() for _ in self.fingers])
        angle = np.radians(10.0) * self.magnitude * self.draw_affected()
        self.rows = np.minimum(angle, np.pi / 2)[:, None] * directions

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Turn the force."""
        turn = Rotation.from_rotvec(self.rows[self.fingers.index(finger)])
        return np.asarray(turn.apply(force))

    def truth(self) -> dict[str, Any]:
        """Rotation vector of each finger."""
        return self.per_finger(self.rows, "rotation", "rad")


@dataclass
class SensorLag(TouchEffect):
    """The skin answers with a first-order lag of 30 ms."""

    name = "sensor_lag"
    last: dict[str, tuple[float, Array, Array]] = field(default_factory=dict)

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Solve y' = (f - y) / tau exactly for a force that is linear between readings."""
        if finger not in self.last:
            self.last[finger] = (time, force, force)
            return force
        before, old_force, old_output = self.last[finger]
        ratio = (time - before) / (0.03 * self.magnitude)
        decay = np.exp(-ratio)
        ramp = (1.0 - decay) / ratio if ratio > 0 else 1.0
        output = decay * old_output + (ramp - decay) * old_force + (1.0 - ramp) * force
        self.last[finger] = (time, force, output)
        return np.asarray(output)

    def truth(self) -> dict[str, Any]:
        """Time constant."""
        return {"time_constant": quantity(0.03 * self.magnitude, "s")}


@dataclass
class TimeOffset(HiddenEffect):
    """The fingertips' clock is 20 ms late or early."""

    name = "time_offset"
    offset: float = 0.0

    def attach(self, plant: Plant) -> None:
        """Late or early."""
        self.offset = 0.02 * self.magnitude * float(self.rng.choice([-1.0, 1.0]))

    def delay(self, stream: str) -> float:
        """Only touch is affected."""
        return self.offset if stream == "touch" else 0.0

    def truth(self) -> dict[str, Any]:
        """Stamp minus time of the forces."""
        return {"offset": quantity(self.offset, "s")}


@dataclass
class ContactOffset(HiddenEffect):
    """One finger reports its contact point 8 mm beside its place, constant in the object frame."""

    name = "contact_offset"
    finger: str = ""
    offset: Array = field(default_factory=lambda: np.zeros(3))

    def attach(self, plant: Plant) -> None:
        """Draw finger and direction."""
        self.finger = plant.fingers[self.rng.integers(len(plant.fingers))]
        self.offset = 0.008 * self.magnitude * self.unit_vector()

    def feel(self, view: SensorView) -> dict[str, ContactReading]:
        """Shift the point."""
        reading = view.contacts[self.finger]
        shift = view.object_pose[:3, :3] @ self.offset
        return {
            **view.contacts,
            self.finger: dataclasses.replace(reading, point=reading.point + shift),
        }

    def truth(self) -> dict[str, Any]:
        """Offset in the object frame."""
        return {f"{self.finger}.offset": quantity(self.offset, "m")}


@dataclass
class ContactTorsion(HiddenEffect):
    """The skins resist spin about the contact normal with up to 2 mm times the normal force.

    torque = -mu_t f_n tanh(spin / 0.1 rad/s) n on the object, the opposite on the fingertip.
    """

    name = "contact_torsion"
    skins: frozenset[int] = frozenset()

    @property
    def coefficient(self) -> float:
        """mu_t in m."""
        return 0.002 * self.magnitude

    def attach(self, plant: Plant) -> None:
        """Act before every step."""
        self.skins = frozenset(_skins(plant))
        if self.magnitude != 0.0 and self.skins:
            plant.add_pre_step(self.act)

    def act(self, plant: Plant) -> None:
        """Brake the spin at every contact with a skin."""
        points = pybullet.getContactPoints(
            plant.object_id, plant.robot, physicsClientId=plant.client
        )
        angular, _ = plant.object_velocity()
        for point in points:
            link, normal, pressure = point[4], np.array(point[7]), point[9]
            if link in self.skins and pressure > 0.0:
                state = pybullet.getLinkState(
                    plant.robot, link, computeLinkVelocity=1, physicsClientId=plant.client
                )
                spin = normal @ (angular - np.array(state[7]))
                torque = -self.coefficient * pressure * np.tanh(spin / 0.1) * normal
                plant.apply_torque(torque)
                pybullet.applyExternalTorque(
                    plant.robot,
                    link,
                    (-torque).tolist(),
                    pybullet.WORLD_FRAME,
                    physicsClientId=plant.client,
                )

    def truth(self) -> dict[str, Any]:
        """Torque per normal force."""
        return {"mu_t": quantity(self.coefficient, "m")}


def _skins(plant: Plant) -> list[int]:
    if plant.robot < 0:
        return []
    names = {finger.touches for finger in plant.machine.hand}
    count = pybullet.getNumJoints(plant.robot, plant.client)
    infos = (pybullet.getJointInfo(plant.robot, joint, plant.client) for joint in range(count))
    return [info[0] for info in infos if info[12].decode() in names]
