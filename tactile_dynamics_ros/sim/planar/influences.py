"""What else may act on an object: springs, cables, wheels, magnets, motors, loose weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.sim.planar.bed import GRAVITY
from tactile_dynamics_ros.sim.planar.table import TableWorld

_SLOW = 0.005
"""Speed, m/s, below which the rubbing of wheels and loose weights fades: their forces act a step
late, and stay stable so."""


_SPRUNG = 5e-4
"""Rise of the object, m, at which a wheel under it bears nothing any more: five times what the bed
gives way, so that leaning changes the load little."""


class Influence(Protocol):
    """Something that acts on the first part of the first object."""

    def act(self, world: TableWorld) -> None:
        """Push during the coming step."""


def _place(world: TableWorld, point: Array) -> Array:
    """Return where a point (3,) of the first part is."""
    pose = world.bodies[0].pose()
    return np.asarray(pose[:3, 3] + pose[:3, :3] @ point)


def _speed(world: TableWorld, point: Array) -> Array:
    """Return how fast it moves along the table, (2,) m/s."""
    angular, linear = world.bodies[0].velocity()
    arm = world.bodies[0].pose()[:3, :3] @ point
    return np.array([linear[0] - angular[2] * arm[1], linear[1] + angular[2] * arm[0]])


def _push(world: TableWorld, force: Array, point: Array, lift: float = 0.0) -> None:
    """Push a point of the first part along the table (2,) and lift it, N."""
    world.bodies[0].push(0, np.array([*force, lift]), _place(world, point))


@dataclass(frozen=True)
class Tether:
    """A spring without slack from a place (2,) of the table to a point (3,) of the object."""

    stiffness: float
    anchor: Array
    point: Array

    def act(self, world: TableWorld) -> None:
        """Pull towards the anchor."""
        _push(world, self.stiffness * (self.anchor - _place(world, self.point)[:2]), self.point)


@dataclass(frozen=True)
class Pull:
    """A constant force (2,) at a point (3,), which may turn with the object."""

    force: Array
    point: Array
    turns: bool

    def act(self, world: TableWorld) -> None:
        """Pull."""
        turn = world.bodies[0].pose()[:2, :2] if self.turns else np.eye(2)
        _push(world, turn @ self.force, self.point)


@dataclass(frozen=True)
class Magnet:
    """A magnet under the table at a place (2,) that draws a point (3,) of the object to it."""

    strength: float
    reach: float
    place: Array
    point: Array

    def act(self, world: TableWorld) -> None:
        """Pull towards the magnet, and down."""
        arm = (self.place - _place(world, self.point)[:2]) / self.reach
        fading = self.strength / (1.0 + float(arm @ arm)) ** 2
        _push(world, fading * arm, self.point, -fading)


@dataclass(frozen=True)
class Shaker:
    """A motor with an unbalanced mass at a point (3,): a force that turns in the object."""

    size: float
    frequency: float
    point: Array

    def act(self, world: TableWorld) -> None:
        """Shake."""
        phase = 2.0 * np.pi * self.frequency * world.time
        spin = self.size * np.array([np.cos(phase), np.sin(phase)])
        _push(world, world.bodies[0].pose()[:2, :2] @ spin, self.point)


@dataclass
class Caster:
    """A trailing wheel under a point (3,): it bears a load, rolls freely and rubs sideways."""

    load: float
    friction: float
    trail: float
    point: Array
    heading: float

    def act(self, world: TableWorld) -> None:
        """Bear the load and rub; the wheel swings behind."""
        side = np.array([-np.sin(self.heading), np.cos(self.heading)])
        across = float(side @ _speed(world, self.point))
        self.heading += world.time_step * across / self.trail
        under = self.point * [1.0, 1.0, 0.0]
        raised = (_place(world, under)[2] - world.height) / _SPRUNG
        load = self.load * float(np.clip(1.0 - raised, 0.0, 2.0))
        rubbing = -self.friction * load * np.tanh(across / _SLOW)
        _push(world, rubbing * side, under, load)


@dataclass
class LooseBallast:
    """A weight that slides about a middle (3,) in the object between stops."""

    mass: float
    friction: float
    play: float
    middle: Array
    offset: Array = field(default_factory=lambda: np.zeros(2))
    velocity: Array = field(default_factory=lambda: np.zeros(2))

    _STOP = 800.0
    """N/m of a stop: a weight of 0.1 kg at 0.1 m/s is turned round within 1 mm."""

    def act(self, world: TableWorld) -> None:
        """Weigh and rub; the ballast moves on."""
        point = self.middle + [*self.offset, 0.0]
        turn = world.bodies[0].pose()[:2, :2]
        slip = self.velocity - _speed(world, point)
        size = float(np.linalg.norm(slip))
        rubbing = self.friction * self.mass * GRAVITY * np.tanh(size / _SLOW)
        force = rubbing * slip / max(size, 1e-9)
        distance = float(np.linalg.norm(self.offset))
        if distance > self.play:
            out = turn @ self.offset / distance
            force = force + (self._STOP * (distance - self.play) + 4.0 * float(slip @ out)) * out
        self.velocity = self.velocity - world.time_step * force / self.mass
        self.offset = self.offset + world.time_step * turn.T @ slip
        _push(world, force, point, -self.mass * GRAVITY)
