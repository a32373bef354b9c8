"""Hidden effects of the simulated table, physically, by code of its own."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pybullet
from scipy.spatial import ConvexHull

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.sim.bodies import TABLE_CENTRE, ContactReading
from tactile_dynamics_ros.sim.hidden_effects.base import quantity
from tactile_dynamics_ros.sim.planar import influences
from tactile_dynamics_ros.sim.planar.bed import GRAVITY
from tactile_dynamics_ros.sim.planar.table import TableWorld

_AIR = 0.01
"""Gap to another object over the length of the face that they share: a millimetre of 100 mm, so
that they do not begin by pushing each other away."""


@dataclass
class HiddenPushEffect:
    """What is wrong with the table, the object or the sensors, and no estimator is told.

    Attributes:
        name, magnitude: as asked for. in_catalogue: whether estimators know such a law.
        truth: true parameters by name, as {"value", "unit"}.
        bias: (3,) N, axes of the gripper. gain: factor on forces. angle: rad, of the sensor about
            the vertical. shift: (3,) m, of contact points, world. lag: s, first order, of forces.
        delay: s, by which stamps of forces are late.
        begins: s, when it began by call; None if it was there from the start.
    """

    name: str = "none"
    magnitude: float = 0.0
    in_catalogue: bool = True
    truth: dict[str, Any] = field(default_factory=dict)
    bias: Array = field(default_factory=lambda: np.zeros(3))
    gain: float = 1.0
    angle: float = 0.0
    shift: Array = field(default_factory=lambda: np.zeros(3))
    lag: float = 0.0
    delay: float = 0.0
    begins: float | None = None
    _lagging: dict[str, Array] = field(default_factory=dict)

    def feel(
        self, contacts: list[ContactReading], turn: float, period: float
    ) -> list[ContactReading]:
        """Return what the sensors report of true contacts.

        Args:
            contacts: of tip and pads.
            turn: rad, of the gripper.
            period: s, since the last reading.
        """
        return [self._feel(contact, turn, period) for contact in contacts]

    def describe(self) -> dict[str, Any]:
        """Return name, size and true parameters as plain numbers, ready for JSON."""
        return {
            "name": self.name,
            "magnitude": self.magnitude,
            "in_catalogue": self.in_catalogue,
            "parameters": self.truth,
            "begins": self.begins,
        }

    def _feel(self, contact: ContactReading, turn: float, period: float) -> ContactReading:
        force = contact.force
        if self.lag > 0.0:
            before = self._lagging.get(contact.name, np.zeros(3))
            force = before + (1.0 - np.exp(-period / self.lag)) * (force - before)
            self._lagging[contact.name] = force
        if not contact.in_contact:
            return replace(contact, time=contact.time + self.delay)
        force = self.gain * (_about_vertical(self.angle) @ force)
        force = force + _about_vertical(turn) @ self.bias
        point = contact.point + self.shift
        return replace(contact, time=contact.time + self.delay, force=force, point=point)


@dataclass(frozen=True)
class _Draw:
    """What makers draw from: world, size, random numbers and the time of sudden changes."""

    world: TableWorld
    size: float
    rng: np.random.Generator
    time: float

    @property
    def mass(self) -> float:
        """Of the first object, kg."""
        return sum(part.mass for part in self.world.bodies[0].thing.parts)

    def way(self) -> Array:
        """Draw a direction (2,)."""
        angle = self.rng.uniform(0.0, 2.0 * np.pi)
        return np.array([np.cos(angle), np.sin(angle)])

    def sign(self) -> float:
        """Draw 1 or -1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def inside(self, share: float = 0.6) -> Array:
        """Draw a point (3,) of the first part, at half its height, object's frame."""
        part = self.world.bodies[0].thing.parts[0]
        flat = share * 0.5 * np.ptp(part.corners, axis=0) * self.way()
        return np.array([*flat, 0.5 * part.height])

    def act(self, influence: influences.Influence) -> None:
        """Let something act on the first part."""
        self.world.add_pre_step(influence.act)

    def later(self, change: Callable[[TableWorld], None]) -> None:
        """Change something once the time has come."""
        waiting = [change]

        def check(world: TableWorld) -> None:
            if waiting and world.time >= self.time:
                waiting.pop()(world)

        self.world.add_pre_step(check, lambda: not waiting)


Fields = dict[str, Any]
Maker = Callable[[_Draw], Fields]


def _support_tilt(draw: _Draw) -> Fields:
    angle, way = np.radians(2.0) * draw.size, draw.way()
    gravity = GRAVITY * np.array([*(np.sin(angle) * way), -np.cos(angle)])
    pybullet.setGravity(*gravity.tolist(), physicsClientId=draw.world.client)
    return {"angle": (angle, "rad"), "direction": (way, "")}


def _viscous_support(draw: _Draw) -> Fields:
    draw.world.surface.viscosity = 4.0 * draw.size
    return {"coefficient": (4.0 * draw.size, "N s/m")}


def _velocity_weakening(draw: _Draw) -> Fields:
    surface = draw.world.surface
    surface.lost = min(0.25 * draw.size, 0.9)
    return {"lost": (surface.lost, ""), "speed": (surface.lost_speed, "m/s")}


def _anisotropic_support(draw: _Draw) -> Fields:
    more, angle = 1.0 + 0.15 * draw.size, draw.rng.uniform(0.0, np.pi)
    turn = _about_vertical(angle)[:2, :2]
    draw.world.surface.stretch = turn @ np.diag([np.sqrt(more), 1.0 / np.sqrt(more)]) @ turn.T
    return {"ratio": (more, ""), "direction": (angle, "rad")}


def _friction_gradient(draw: _Draw) -> Fields:
    surface, slope = draw.world.surface, draw.size * draw.way()
    before, middle = surface.variation, draw.world.bodies[0].pose()[:2, 3]
    surface.variation = lambda place: (
        before(place) * np.maximum(1.0 + (place - middle) @ slope, 0.1)
    )
    return {"gradient": (slope, "1/m")}


def _concentrated_pressure(draw: _Draw) -> Fields:
    amount = 1.2 * draw.size * draw.sign()
    for bed in draw.world.bodies[0].beds:
        places = bed.places()
        half = 0.5 * np.ptp(places, axis=0)
        out = np.sum(((places - places.mean(axis=0)) / half) ** 2, axis=1)
        share = bed.shares * np.exp(amount * (out - out.mean()) / out.std())
        bed.reshape(share / share.sum())
    return {"towards_rim": (amount, "")}


def _tether_spring(draw: _Draw) -> Fields:
    stiffness, point = 6.0 * draw.size, draw.inside()
    anchor = draw.world.bodies[0].pose()[:2, 3] + 0.12 * draw.way()
    draw.act(influences.Tether(stiffness, anchor, point))
    return {"stiffness": (stiffness, "N/m"), "anchor": (anchor, "m"), "point": (point, "m")}


def _constant_pull(draw: _Draw) -> Fields:
    parts = draw.world.bodies[0].thing.parts
    holds = sum(part.friction * part.mass for part in parts) * GRAVITY
    force, point = min(0.3 * draw.size, 0.6 * holds) * draw.way(), draw.inside()
    draw.act(influences.Pull(force, point, turns=False))
    return {"force": (force, "N"), "point": (point, "m")}


def _unsensed_contact(draw: _Draw) -> Fields:
    force, point = 0.3 * draw.size * draw.way(), draw.inside()
    draw.act(influences.Pull(force, point, turns=True))
    return {"force": (force, "N"), "point": (point, "m")}


def _friction_change(draw: _Draw) -> Fields:
    factor = float(np.exp(0.25 * draw.size * draw.sign()))

    def change(world: TableWorld) -> None:
        world.surface.factor *= factor

    draw.later(change)
    return {"factor": (factor, ""), "time": (draw.time, "s")}


def _load_change(draw: _Draw) -> Fields:
    mass, place = 0.2 * draw.size * draw.mass, draw.inside(0.4)
    place[2] = draw.world.bodies[0].thing.parts[0].height
    draw.later(lambda world: world.bodies[0].load(mass, place))
    return {"mass": (mass, "kg"), "time": (draw.time, "s"), "place": (place, "m")}


def _caster(draw: _Draw) -> Fields:
    load = min(0.3 * draw.size, 0.6) * draw.world.bodies[0].thing.parts[0].mass * GRAVITY
    heading = draw.rng.uniform(0.0, 2.0 * np.pi)
    draw.act(influences.Caster(load, 0.6, 0.015, draw.inside(0.3), heading))
    return {"load": (load, "N")}


def _magnet(draw: _Draw) -> Fields:
    place = draw.world.bodies[0].pose()[:2, 3] + 0.05 * draw.way()
    draw.act(influences.Magnet(1.5 * draw.size, 0.03, place, draw.inside(0.4)))
    return {"strength": (1.5 * draw.size, "N"), "place": (place, "m")}


def _shaker(draw: _Draw) -> Fields:
    force, frequency = 0.6 * draw.size, draw.rng.uniform(5.0, 12.0)
    draw.act(influences.Shaker(force, frequency, draw.inside(0.4)))
    return {"force": (force, "N"), "frequency": (frequency, "Hz")}


def _loose_ballast(draw: _Draw) -> Fields:
    part = draw.world.bodies[0].thing.parts[0]
    mass, play = 0.2 * draw.size * part.mass, 0.2 * float(np.ptp(part.corners, axis=0).min())
    draw.act(influences.LooseBallast(mass, 0.15, play, np.array([*part.com, 0.5 * part.height])))
    return {"mass": (mass, "kg"), "play": (play, "m")}


def _second_object(draw: _Draw) -> Fields:
    """Another like the first lies face to face with it, in its way to the middle of the table."""
    body = draw.world.bodies[0]
    part = body.thing.parts[0]
    around = part.corners[ConvexHull(part.corners).vertices]
    edges = np.roll(around, -1, axis=0) - around
    ahead = body.pose()[:2, :2].T @ (TABLE_CENTRE - body.pose()[:2, 3])
    n = int(np.argmax(np.column_stack([edges[:, 1], -edges[:, 0]]) @ ahead))
    beside = np.diag([-1.0, -1.0, 1.0, 1.0])  # the first turned by half about the middle of an edge
    beside[:2, 3] = 2.0 * around[n] + edges[n] + _AIR * np.array([edges[n, 1], -edges[n, 0]])
    mass = 0.5 * draw.size * part.mass
    other = replace(body.thing, parts=(replace(part, mass=mass),), joint=None)
    draw.world.add(other, body.pose() @ beside)
    return {"mass": (mass, "kg"), "friction": (part.friction, "")}


def _force_bias(draw: _Draw) -> Fields:
    return {"bias": (np.array([*(0.15 * draw.size * draw.way()), 0.0]), "N")}


def _force_scale(draw: _Draw) -> Fields:
    return {"gain": (float(np.exp(0.1 * draw.size * draw.sign())), "")}


def _sensor_rotation(draw: _Draw) -> Fields:
    return {"angle": (np.radians(4.0) * draw.size * draw.sign(), "rad")}


def _contact_offset(draw: _Draw) -> Fields:
    return {"shift": (np.array([*(0.002 * draw.size * draw.way()), 0.0]), "m")}


def _sensor_lag(draw: _Draw) -> Fields:
    return {"lag": (0.02 * draw.size, "s")}


def _time_offset(draw: _Draw) -> Fields:
    return {"delay": (0.012 * draw.size * draw.sign(), "s")}


_ACTING: dict[str, Maker] = {
    "support_tilt": _support_tilt,
    "viscous_support": _viscous_support,
    "velocity_weakening": _velocity_weakening,
    "anisotropic_support": _anisotropic_support,
    "friction_gradient": _friction_gradient,
    "concentrated_pressure": _concentrated_pressure,
    "tether_spring": _tether_spring,
    "constant_pull": _constant_pull,
    "unsensed_contact": _unsensed_contact,
    "friction_change": _friction_change,
    "load_change": _load_change,
}
_SENSING: dict[str, Maker] = {
    "force_bias": _force_bias,
    "force_scale": _force_scale,
    "sensor_rotation": _sensor_rotation,
    "contact_offset": _contact_offset,
    "sensor_lag": _sensor_lag,
    "time_offset": _time_offset,
}
_BESIDE: dict[str, Maker] = {"second_object": _second_object}
"""What lies on the table too; no law of one object, so that draws leave it out."""
_UNKNOWN: dict[str, Maker] = {
    "caster": _caster,
    "magnet": _magnet,
    "shaker": _shaker,
    "loose_ballast": _loose_ballast,
}
CATALOGUED, OUTSIDE = (*_ACTING, *_SENSING), tuple(_UNKNOWN)


def known_effect(name: str) -> None:
    """Refuse the name of a hidden effect that does not exist.

    Raises:
        BadInputError: there is no such effect.
    """
    known = ("none", "random", "outside", *CATALOGUED, *OUTSIDE, *_BESIDE)
    if name and name not in known:
        raise BadInputError(
            f"hidden effect '{name}' does not exist{nearest(name, known)}; expected one of "
            f"{', '.join(known)}"
        )


def hide(
    name: str, magnitude: float, seed: int, world: TableWorld, time: float
) -> HiddenPushEffect:
    """Put a hidden effect into a table's world.

    Args:
        name: of an effect; "none" (or empty) for no effect; "random" for one that estimators know
            and "outside" for one that they do not, chosen by the seed.
        magnitude: multiple of the effect's typical size; 0 is off.
        seed: of everything that is drawn.
        world: with at least one object.
        time: s, when effects that are sudden begin.

    Raises:
        BadInputError: there is no such effect, no object, or the magnitude is negative.
    """
    if not (np.isfinite(magnitude) and magnitude >= 0):
        raise BadInputError(f"hidden effect magnitude {magnitude}: expected zero or more")
    known_effect(name)
    choice = np.random.default_rng([seed, zlib.crc32(b"choice")])
    if name in ("random", "outside"):
        name = str(choice.choice(CATALOGUED if name == "random" else OUTSIDE))
    if name in ("", "none"):
        return HiddenPushEffect()
    makers = {**_ACTING, **_SENSING, **_UNKNOWN, **_BESIDE}
    if not world.bodies:
        raise BadInputError(f"hidden effect {name!r}: there is no object on the table")
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    found = makers[name](_Draw(world, magnitude, rng, time))
    truth = {key: quantity(value, unit) for key, (value, unit) in found.items()}
    sensing = {key: value for key, (value, _) in found.items()} if name in _SENSING else {}
    return HiddenPushEffect(name, magnitude, name in CATALOGUED, truth, **sensing)


def _about_vertical(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
