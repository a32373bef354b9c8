"""What else acts on an object: springs, cables, magnets, wheels, ballast."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tactile_dynamics_ros.synthetic.pushed.objects import GRAVITY
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, BodyState

_SLOW = 0.005
"""m/s below which friction of wheels and ballast fades; their forces are explicit in time and need
that to stay stable at the physical clock."""


@dataclass(frozen=True)
class Tether:
    """A linear spring without slack from a point of the table to one of the object."""

    stiffness: float
    anchor: np.ndarray
    point: np.ndarray

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return force, place and no load."""
        at = state.place(self.point)
        return self.stiffness * (self.anchor - at), at, 0.0


@dataclass(frozen=True)
class Pull:
    """A constant force at a point of the object, as of a cable over a pulley."""

    force: np.ndarray
    point: np.ndarray

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return force, place and no load."""
        return self.force, state.place(self.point), 0.0


@dataclass(frozen=True)
class Magnet:
    """A magnet under the table that draws iron in the object: f = s r / (1 + (r/d)^2)^2 / d."""

    strength: float
    reach: float
    place: np.ndarray
    point: np.ndarray

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return force, place and the load that the magnet adds."""
        at = state.place(self.point)
        arm = (self.place - at) / self.reach
        fading = self.strength / (1.0 + arm @ arm) ** 2
        return fading * arm, at, float(fading)


@dataclass(frozen=True)
class Shaker:
    """A motor with an unbalanced mass in the object: a force that turns with it."""

    size: float
    frequency_hz: float
    point: np.ndarray

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return force, place and no load."""
        phase = 2.0 * np.pi * self.frequency_hz * state.time
        spin = self.size * np.array([np.cos(phase), np.sin(phase)])
        return state.rotation @ spin, state.place(self.point), 0.0


@dataclass
class Caster:
    """A trailing wheel that carries part of the weight: it rolls freely and rubs sideways."""

    load: float
    friction: float
    trail: float
    point: np.ndarray
    heading: float

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the wheel's side force, where, and the load that it takes off the feet."""
        speed = state.speed(self.point)
        side = np.array([-np.sin(self.heading), np.cos(self.heading)])
        across = float(side @ speed)
        self.heading += STEP * across / self.trail
        rubbing = -self.friction * self.load * np.tanh(across / _SLOW)
        return rubbing * side, state.place(self.point), -self.load


@dataclass
class LooseBallast:
    """A weight that slides in the object between stops."""

    mass: float
    friction: float
    play: float
    middle: np.ndarray
    offset: np.ndarray = field(default_factory=lambda: np.zeros(2))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(2))

    _STOP = 800.0
    """N/m of a stop."""

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return what the ballast does to the object, where, and its weight; it moves on."""
        place = self.middle + self.offset
        slip = self.velocity - state.speed(place)
        size = float(np.hypot(*slip))
        force = self.friction * self.mass * GRAVITY * np.tanh(size / _SLOW) * slip
        force = force / max(size, 1e-9)
        distance = float(np.hypot(*self.offset))
        if distance > self.play:
            outwards = state.rotation @ self.offset / distance
            force = force + self._STOP * (distance - self.play) * outwards
            force = force + 4.0 * float(slip @ outwards) * outwards
        self.velocity = self.velocity - STEP * force / self.mass
        self.offset = self.offset + STEP * state.rotation.T @ slip
        return force, state.place(place), self.mass * GRAVITY
