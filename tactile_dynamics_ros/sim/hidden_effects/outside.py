"""Disturbances that the catalogue of effects does not know."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.hidden_effects.base import (
    Array,
    HiddenEffect,
    Plant,
    SensorView,
    place,
    quantity,
)
from tactile_dynamics_ros.sim.hidden_effects.forces import ForceEffect, PullEffect
from tactile_dynamics_ros.sim.hidden_effects.touch import TouchEffect


@dataclass
class MotorVibration(PullEffect):
    """An unbalanced motor in the object: a force at 6 to 20 Hz along one body axis."""

    name = "motor_vibration"
    in_catalogue = False
    frequency_hz: float = 10.0
    force: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """Draw frequency, axis and place."""
        super().prepare(plant)
        self.frequency_hz = float(self.rng.uniform(6.0, 20.0))
        self.force = self.size * self.unit_vector()

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """Shake."""
        tone = np.sin(2 * np.pi * self.frequency_hz * plant.time)
        return np.asarray(tone * (pose[:3, :3] @ self.force))

    def truth(self) -> dict[str, Any]:
        """Frequency and amplitude."""
        return {
            "frequency": quantity(self.frequency_hz, "Hz"),
            "force": quantity(self.force, "N"),
        }


@dataclass
class MagneticPull(PullEffect):
    """A magnet near the start attracts a body point: force ~ distance^-4, typical at 10 cm."""

    name = "magnetic_pull"
    in_catalogue = False
    magnet: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """A magnet 15 to 25 cm above the start."""
        super().prepare(plant)
        away = self.unit_vector()
        away[2] = abs(away[2]) + 0.5
        away /= np.linalg.norm(away)
        self.magnet = plant.object_pose()[:3, 3] + self.rng.uniform(0.15, 0.25) * away

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """Attract; never more than five times the typical force."""
        gap = self.magnet - here
        distance = np.sqrt(gap @ gap + 0.03**2)
        return np.asarray(min((0.1 / distance) ** 4, 5.0) * self.size * gap / distance)

    def truth(self) -> dict[str, Any]:
        """Places."""
        return {"magnet": quantity(self.magnet, "m"), "point": quantity(self.point, "m")}


@dataclass
class CableStickSlip(PullEffect):
    """A cable through a guide: a spring that lets go at a limit, keeps a third and sticks again."""

    name = "cable_stick_slip"
    in_catalogue = False
    stuck: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """Tie the cable to the object."""
        super().prepare(plant)
        self.stuck = place(plant.object_pose(), self.point)

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """Pull back to where the cable sticks; the limit is reached after 2 cm."""
        stiffness = self.size / 0.02
        pull = stiffness * (self.stuck - here)
        size = float(np.linalg.norm(pull))
        if size > self.size:
            pull *= self.size / (3.0 * size)
            self.stuck = here + pull / stiffness
        return np.asarray(pull)

    def truth(self) -> dict[str, Any]:
        """Limit."""
        return {"limit": quantity(self.size, "N")}


@dataclass
class DryRubbing(ForceEffect):
    """Dry friction of half the typical force against the velocity of the body origin."""

    name = "dry_rubbing"
    in_catalogue = False

    def act(self, plant: Plant) -> None:
        """Rub; smooth below 5 mm/s."""
        _, velocity = plant.object_velocity()
        speed = np.sqrt(velocity @ velocity + 0.005**2)
        plant.apply_force(-0.5 * self.size * velocity / speed, plant.object_pose()[:3, 3])

    def truth(self) -> dict[str, Any]:
        """Friction force."""
        return {"force": quantity(0.5 * self.size, "N")}


@dataclass
class ExternalTaps(PullEffect):
    """Somebody taps the object about every two seconds: half-sines of 40 to 120 ms."""

    name = "external_taps"
    in_catalogue = False
    begin: float = np.inf
    length: float = 0.1
    force: Array = field(default_factory=lambda: np.zeros(3))

    def prepare(self, plant: Plant) -> None:
        """Plan the first tap."""
        super().prepare(plant)
        self._plan(plant)

    def pull(self, plant: Plant, pose: Array, here: Array) -> Array:
        """Push during a tap, then plan the next."""
        phase = (plant.time - self.begin) / self.length
        if phase > 1.0:
            self._plan(plant)
        return np.asarray(np.sin(np.pi * np.clip(phase, 0.0, 1.0)) * (pose[:3, :3] @ self.force))

    def truth(self) -> dict[str, Any]:
        """Highest force of a tap."""
        return {"peak": quantity(3.0 * self.size, "N")}

    def _plan(self, plant: Plant) -> None:
        self.begin = plant.time + float(self.rng.exponential(2.0))
        self.length = float(self.rng.uniform(0.04, 0.12))
        self.force = 3.0 * self.size * self.unit_vector()
        self.point = self.surface_point(plant)


@dataclass
class SkinCreep(TouchEffect):
    """Under load the reading relaxes with the logarithm of time: 0.3 of the force in 30 s."""

    name = "skin_creep"
    in_catalogue = False
    lagged: dict[str, Array] = field(default_factory=dict)
    before: dict[str, float] = field(default_factory=dict)

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Subtract the mean of lagged forces whose time constants are even in log time."""
        constants = np.geomspace(0.3, 30.0, 5)[:, None]
        state = self.lagged.get(finger, np.zeros((5, 3)))
        elapsed = time - self.before.get(finger, time)
        state = state + (1.0 - np.exp(-elapsed / constants)) * (force - state)
        self.lagged[finger], self.before[finger] = state, time
        return np.asarray(force - 0.3 * self.magnitude * state.mean(axis=0))

    def truth(self) -> dict[str, Any]:
        """Relaxed share."""
        return {"share": quantity(0.3 * self.magnitude, "")}


@dataclass
class TemperatureStep(TouchEffect):
    """Some 10 to 20 s after the start, all zeros move by 0.4 N within a second or two."""

    name = "temperature_step"
    in_catalogue = False
    begin: float = 0.0
    time_constant: float = 1.0
    rows: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def draw(self, plant: Plant) -> None:
        """Draw moment and directions."""
        self.begin = plant.time + float(self.rng.uniform(10.0, 20.0))
        self.time_constant = float(self.rng.uniform(0.5, 2.0))
        self.rows = 0.4 * self.magnitude * np.stack([self.unit_vector() for _ in self.fingers])

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Add the settled part of the step."""
        rise = 1.0 - np.exp(-max(time - self.begin, 0.0) / self.time_constant)
        return np.asarray(force + rise * self.rows[self.fingers.index(finger)])

    def truth(self) -> dict[str, Any]:
        """When."""
        return {"time": quantity(self.begin, "s")}


@dataclass
class DeadZone(TouchEffect):
    """Each axis ignores the first 0.25 N."""

    name = "dead_zone"
    in_catalogue = False

    def change(self, finger: str, force: Array, time: float) -> Array:
        """Shrink every axis towards zero."""
        rest = np.maximum(np.abs(force) - 0.25 * self.magnitude, 0.0)
        return np.asarray(np.sign(force) * rest)

    def truth(self) -> dict[str, Any]:
        """Width."""
        return {"width": quantity(0.25 * self.magnitude, "N")}


@dataclass
class CrossTalk(HiddenEffect):
    """Each sensor also reads 0.2 of the next finger's force, axis by axis."""

    name = "cross_talk"
    in_catalogue = False

    def feel(self, view: SensorView) -> dict[str, ContactReading]:
        """Mix neighbours in sensor axes."""
        contacts = dict(view.contacts)
        fingers = tuple(finger for finger in view.contacts if finger in view.sensor_rotation)
        for index, finger in enumerate(fingers):
            partner = fingers[(index + 1) % len(fingers)]
            if contacts[finger].in_contact:
                there = view.sensor_rotation[partner].T @ view.contacts[partner].force
                extra = 0.2 * self.magnitude * (view.sensor_rotation[finger] @ there)
                force = view.contacts[finger].force + extra
                contacts[finger] = dataclasses.replace(view.contacts[finger], force=force)
        return contacts

    def truth(self) -> dict[str, Any]:
        """Share."""
        return {"share": quantity(0.2 * self.magnitude, "")}


@dataclass
class PoseBacklash(HiddenEffect):
    """The reported position of the object has 3 mm of play along every world axis."""

    name = "pose_backlash"
    in_catalogue = False
    held: Array | None = None

    def see(self, pose: Array, time: float) -> Array:
        """Move the reported position only when an edge of the play pushes it."""
        position = pose[:3, 3]
        half = 0.0015 * self.magnitude
        held = position if self.held is None else self.held
        self.held = np.clip(held, position - half, position + half)
        seen = pose.copy()
        seen[:3, 3] = self.held
        return np.asarray(seen)

    def truth(self) -> dict[str, Any]:
        """Play."""
        return {"play": quantity(0.003 * self.magnitude, "m")}
