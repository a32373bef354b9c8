"""Recordings of pushed objects: streams as an estimator gets them, and the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions, draw_actions
from tactile_dynamics_ros.synthetic.pushed.effects import Faults, Hidden, hide
from tactile_dynamics_ros.synthetic.pushed.friction_field import FrictionField
from tactile_dynamics_ros.synthetic.pushed.objects import (
    GRAVITY,
    Link,
    PushedObject,
    draw_object,
    with_uneven_support,
)
from tactile_dynamics_ros.synthetic.pushed.regimes import REGIONAL, hide_in_regime
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, Scene, Tip
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions, read_sensors
from tactile_dynamics_ros.synthetic.pushed.simulator import Motion, simulate


@dataclass(frozen=True)
class PushOptions:
    """What a recording is like.

    Attributes:
        kind: of the object, one of `objects.KINDS`.
        things: objects by seed, in place of those that are drawn.
        actions: what the robot does.
        sensors: noise and defects.
        variation: relative std of friction from place to place.
        stiction: relative gain of friction at rest.
        uneven: relative std of the pressure's shape.
    """

    kind: str = "single"
    actions: ActionOptions = field(default_factory=ActionOptions)
    sensors: SensorOptions = field(default_factory=SensorOptions)
    variation: float = 0.0
    stiction: float = 0.0
    uneven: float = 0.0
    things: Mapping[int, PushedObject] = field(default_factory=dict)


@dataclass(frozen=True)
class HiddenPush:
    """What was recorded, and the truth that the estimation side never sees.

    Attributes:
        streams: as an estimator gets them.
        scene: what was simulated.
        effects: magnitude and parameters of what is hidden, by name.
        motion: what happened.
    """

    streams: PushedStreams
    scene: Scene
    effects: Mapping[str, dict[str, Any]]
    motion: Motion

    def truth(self) -> dict[str, Any]:
        """Links, joint and effects as plain numbers, ready for JSON."""
        thing = self.scene.thing
        joint = None
        if thing.joint is not None:
            joint = {"position": [*thing.joint], "friction_torque_nm": thing.joint_friction}
        return {
            "seed": self.scene.seed,
            "kind": thing.kind,
            "links": [_describe(link) for link in thing.links],
            "joint": joint,
            "push_height": self.scene.tip.height,
            "effects": dict(self.effects),
        }


def _describe(link: Link) -> dict[str, Any]:
    share = link.stiffness / link.stiffness.sum()
    radius = float(share @ np.linalg.norm(link.feet - link.com, axis=1))
    return {
        "mass": link.mass,
        "friction": link.friction,
        "friction_force_n": link.mass * link.friction * GRAVITY,
        "com": [*link.com],
        "com_height": 0.5 * link.height,
        "inertia_zz": link.inertia,
        "friction_radius_if_even_m": radius,
    }


def generate(
    seeds: Sequence[int],
    effects: Mapping[str, float] | None = None,
    options: PushOptions | None = None,
) -> list[HiddenPush]:
    """Generate recordings, all at once: many cost hardly more than one.

    Args:
        seeds: one for each recording; of object, actions, table, effects and noise.
        effects: hidden in all of them, at multiples of their typical sizes; also of `REGIONAL`.
        options: of all of them.

    Raises:
        KeyError: an effect is unknown.
    """
    chosen = options or PushOptions()
    hidden = [_hidden(seed, effects or {}, chosen) for seed in seeds]
    motions = simulate([h.scene for h, _ in hidden])
    return [
        _recorded(seed, h, found, motion, chosen)
        for seed, (h, found), motion in zip(seeds, hidden, motions, strict=True)
    ]


def draw_scene(seed: int, options: PushOptions) -> Scene:
    """Return the scene of a seed without anything hidden."""
    rng = randomness.stream(seed, "pushed", "scene")
    thing = options.things.get(seed) or draw_object(seed, options.kind)
    if options.uneven:
        thing = with_uneven_support(thing, randomness.stream(seed, "uneven"), options.uneven)
    table = None
    if options.variation:
        table = FrictionField.draw(randomness.stream(seed, "table"), options.variation)
    height = rng.uniform(0.3, 0.8) * min(link.height for link in thing.links)
    actions = draw_actions(thing, options.actions, randomness.stream(seed, "actions"), STEP)
    tip = Tip(height=float(height), friction=float(rng.uniform(0.2, 0.5)))
    return Scene(seed, thing, tip, tuple(actions), field=table, stiction=options.stiction)


def _hidden(
    seed: int, effects: Mapping[str, float], options: PushOptions
) -> tuple[Hidden, dict[str, dict[str, Any]]]:
    hidden, found = Hidden(draw_scene(seed, options)), {}
    for name, magnitude in effects.items():
        maker = hide_in_regime if name in REGIONAL else hide
        added = maker(name, magnitude, hidden.scene, randomness.stream(seed, "effect", name))
        found[name] = {"magnitude": magnitude, "parameters": added.parameters}
        faults = added.faults or hidden.faults
        hidden = replace(hidden, scene=added.scene, faults=faults)
    return hidden, found


def _recorded(
    seed: int,
    hidden: Hidden,
    found: dict[str, dict[str, Any]],
    motion: Motion,
    options: PushOptions,
) -> HiddenPush:
    rng = randomness.stream(seed, "noise")
    streams = read_sensors(motion, hidden.scene, hidden.faults or Faults(), options.sensors, rng)
    return HiddenPush(streams, hidden.scene, found, motion)
