"""Hidden laws that neither the catalogue nor the installed generators have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.synthetic import OUTSIDE, randomness
from tactile_dynamics_ros.synthetic.effects import create_hidden_effect
from tactile_dynamics_ros.synthetic.effects.base import (
    HiddenEffect,
    force_at_origin,
    force_at_point,
)
from tactile_dynamics_ros.synthetic.effects.external import draw_body_point
from tactile_dynamics_ros.synthetic.pushed.actions import draw_actions
from tactile_dynamics_ros.synthetic.pushed.effects import Faults, hide
from tactile_dynamics_ros.synthetic.pushed.friction_field import FrictionField
from tactile_dynamics_ros.synthetic.pushed.recordings import PushOptions, draw_scene
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, BodyState
from tactile_dynamics_ros.synthetic.pushed.scene import Scene as PushScene
from tactile_dynamics_ros.synthetic.pushed.sensors import read_sensors
from tactile_dynamics_ros.synthetic.pushed.simulator import simulate
from tactile_dynamics_ros.synthetic.scenario import Scenario, Scene


@dataclass(frozen=True)
class PowerDrag(HiddenEffect):
    """Force against the velocity of the body origin that grows with a power of speed."""

    name = "square_root_drag"
    power = 0.5

    def wrench(self, scene: Scene) -> np.ndarray:
        """0.4 N at 0.1 m/s."""
        velocity = scene.motion.velocity
        speed = np.sqrt((velocity**2).sum(1, keepdims=True) + 1e-8)
        size = 0.4 * self.magnitude * (speed / 0.1) ** self.power
        return force_at_origin(-size * velocity / speed)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> PowerDrag:
        """Nothing but the size is free."""
        return cls(magnitude)


@dataclass(frozen=True)
class CubicDrag(PowerDrag):
    """Drag with the cube of speed."""

    name = "cubic_drag"
    power = 3.0


@dataclass(frozen=True)
class RailFriction(HiddenEffect):
    """Dry friction of a rail: against the motion along one axis of the world only."""

    name = "rail_friction"
    axis: np.ndarray

    def wrench(self, scene: Scene) -> np.ndarray:
        """0.4 N, smooth below 5 mm/s."""
        along = scene.motion.velocity @ self.axis
        size = -0.4 * self.magnitude * along / np.sqrt(along**2 + 0.005**2)
        return force_at_origin(size[:, None] * self.axis)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> RailFriction:
        """Any direction."""
        return cls(magnitude, randomness.unit_vector(rng))


@dataclass(frozen=True)
class SlowShaker(HiddenEffect):
    """Somebody shakes a point of the object at 2 to 4 Hz along one axis of the world."""

    name = "slow_shaker"
    frequency_hz: float
    force: np.ndarray
    point: np.ndarray

    def wrench(self, scene: Scene) -> np.ndarray:
        """A sinusoidal force of 0.3 N."""
        tone = np.sin(2 * np.pi * self.frequency_hz * scene.time)
        force = 0.3 * self.magnitude * tone[:, None] * self.force
        return force_at_point(scene, self.point, force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> SlowShaker:
        """Any axis, frequency and point."""
        point = draw_body_point(rng, scenario)
        return cls(magnitude, float(rng.uniform(2.0, 4.0)), randomness.unit_vector(rng), point)


@dataclass(frozen=True)
class FadingPull(HiddenEffect):
    """A pull in the world that fades, as of a bag that runs empty."""

    name = "fading_pull"
    rate: float
    force: np.ndarray

    def wrench(self, scene: Scene) -> np.ndarray:
        """0.5 N at the start."""
        size = 0.5 * self.magnitude * np.exp(-self.rate * scene.time)
        return force_at_origin(size[:, None] * self.force)

    @classmethod
    def draw(cls, rng: np.random.Generator, magnitude: float, scenario: Scenario) -> FadingPull:
        """A time constant of 3 to 10 s, any direction."""
        return cls(magnitude, 1.0 / float(rng.uniform(3.0, 10.0)), randomness.unit_vector(rng))


_OWN = (PowerDrag, CubicDrag, RailFriction, SlowShaker, FadingPull)
"""Laws of this module."""
LAWS: dict[str, tuple[str, str, float | None]] = {
    "charge_pull": ("central_force", "power", -2.0),
    "dipole_pull": ("central_force", "power", -3.0),
    "magnetic_pull": ("central_force", "power", -4.0),
    "stiffening_spring": ("central_force", "power", 3.0),
    "dry_rubbing": ("drag", "power", 0.0),
    "square_root_drag": ("drag", "power", 0.5),
    "cubic_drag": ("drag", "power", 3.0),
    "rail_friction": ("drag_along_axis", "power", 0.0),
    "aerodynamic_lift": ("side_force", "", None),
    "motor_vibration": ("body_shaker", "frequency", None),
    "slow_shaker": ("world_shaker", "frequency", None),
    "fading_pull": ("world_decay", "rate", None),
}
"""Form of each hidden law, the parameter that is graded and its truth (None: of the draw)."""
NO_FORM = tuple(name for name in OUTSIDE if name not in LAWS)
"""Hidden effects that no form describes: of these, nothing should be learnt."""


def draw_law(name: str, seed: int, scenario: Scenario) -> HiddenEffect:
    """Hidden law of a name at its usual size.

    Args:
        name: of LAWS, or any hidden effect.
        seed: of its place, direction and so on.
        scenario: on what it acts.
    """
    for kind in _OWN:
        if kind.name == name:
            return kind.draw(randomness.stream(seed, "effect", name), 1.0, scenario)
    return create_hidden_effect(name, 1.0, seed, scenario)


def true_value(effect: HiddenEffect, parameter: str) -> float | None:
    """Value of a graded parameter that was drawn."""
    drawn = {"frequency": "frequency_hz", "rate": "rate"}.get(parameter, "")
    value = getattr(effect, drawn, None) if drawn else None
    return None if value is None else float(value)


@dataclass(frozen=True)
class OnTable:
    """What acts at a point of a pushed object: a force of its place, velocity and the time.

    Attributes:
        law: gives the force (2,) N of place (2,) m, velocity (2,) m/s and time s.
        point: (2,) m, of the object.
    """

    law: Callable[[np.ndarray, np.ndarray, float], np.ndarray]
    point: np.ndarray

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Force, place and no load."""
        at, speed = state.place(self.point), state.speed(self.point)
        return self.law(at, speed, state.time), at, 0.0


PUSHED_LAWS: dict[str, tuple[str, str, float | None]] = {
    "magnet": ("place_pull", "power", -3.0),
    "cubic_spring": ("place_pull", "power", 3.0),
    "root_drag": ("speed_drag", "power", 0.5),
    "rail": ("axis_drag", "power", 0.0),
    "spot": ("friction_spot", "", None),
    "fading": ("fade", "rate", 0.1),
}
"""Form of each law hidden in pushes, the parameter that is graded and its truth."""


def hide_on_table(name: str, scene: PushScene, rng: np.random.Generator) -> PushScene:
    """Scene of pushes in which a law of PUSHED_LAWS acts.

    Args:
        name: of the law.
        scene: without it.
        rng: of places and directions.
    """
    angle = rng.uniform(0.0, 2.0 * np.pi)
    way, place = np.array([np.cos(angle), np.sin(angle)]), rng.uniform(-0.05, 0.05, 2)
    if name == "magnet":
        return hide("magnet", 2.0, scene, rng).scene
    if name == "spot":
        field = FrictionField.even()
        step = 0.64 / len(field.cells)
        axis = (np.arange(len(field.cells)) * step + 0.32) % 0.64 - 0.32
        gap = (axis[:, None] - place[0]) ** 2 + (axis[None, :] - place[1]) ** 2
        return replace(scene, field=replace(field, cells=0.8 * np.exp(-0.5 * gap / 0.06**2)))
    laws: dict[str, Callable[[np.ndarray, np.ndarray, float], np.ndarray]] = {
        "cubic_spring": lambda p, v, t: 600.0 * (place - p) * ((place - p) @ (place - p)),
        "root_drag": lambda p, v, t: -1.5 * v / max(float(np.hypot(*v)), 1e-4) ** 0.5,
        "rail": lambda p, v, t: -0.4 * np.tanh(float(v @ way) / 0.005) * way,
        "fading": lambda p, v, t: 0.6 * np.exp(-0.1 * t) * way,
    }
    point = np.zeros(2) if name in ("root_drag", "rail") else rng.uniform(-0.02, 0.02, 2)
    return replace(scene, influences=(*scene.influences, OnTable(laws[name], point)))


def push(name: str, seed: int) -> tuple[PushedStreams, PushedStreams]:
    """Two recordings of one pushed object and one hidden law, other pushes in the second.

    Args:
        name: of PUSHED_LAWS, or empty.
        seed: of everything.
    """
    options = PushOptions()
    scene, other = draw_scene(seed, options), draw_scene(seed + 500_000, options)
    if name:
        scene = hide_on_table(name, scene, randomness.stream(seed, "law", name))
    actions = draw_actions(
        scene.thing, options.actions, randomness.stream(other.seed, "actions"), STEP
    )
    both = [scene, replace(scene, seed=other.seed, actions=tuple(actions))]
    made = zip(both, simulate(both), strict=True)
    first, second = (
        read_sensors(motion, one, Faults(), options.sensors, randomness.stream(one.seed, "noise"))
        for one, motion in made
    )
    return first, second
