"""Recordings of pushed objects: streams as an estimator gets them, and the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.pushed.actions import (
    ActionOptions,
    PlannedPush,
    draw_actions,
    straight_push,
)
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
        faults: of the force sensor.
    """

    streams: PushedStreams
    scene: Scene
    effects: Mapping[str, dict[str, Any]]
    motion: Motion
    faults: Faults = field(default_factory=Faults)

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


def record_pushes(
    first: HiddenPush, planned: PlannedPush, count: int, sensors: SensorOptions
) -> HiddenPush:
    """Push an object on from where a recording left it, each time alike in its own frame.

    Noise is new; lasting errors of the sensors, and what is hidden, stay as they were. Its clock
    begins anew.

    Args:
        first: the recording.
        planned: each of the pushes, of link_1.
        count: how many.
        sensors: as of the first recording.
    """
    scene = first.scene
    push = straight_push(scene.thing, planned, STEP)
    longer = replace(scene, actions=(*scene.actions, *[push] * count))
    motion = _since(simulate([longer])[0], scene.steps)
    streams = read_sensors(
        motion, longer, first.faults, sensors, _noise(scene.seed, "second"), _noise(scene.seed)
    )
    return replace(first, streams=streams, scene=longer, motion=motion)


def _since(motion: Motion, step: int) -> Motion:
    """Return what happened after a step, on a clock that begins there."""
    columns = {one.name: getattr(motion, one.name)[step:] for one in fields(motion)}
    columns["time"] = motion.time[: len(motion.time) - step]
    return Motion(**columns)


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
    faults = hidden.faults or Faults()
    streams = read_sensors(motion, hidden.scene, faults, options.sensors, _noise(seed))
    return HiddenPush(streams, hidden.scene, found, motion, faults)


def _noise(seed: int, *recording: str) -> np.random.Generator:
    """Return the generator of the sensors' noise, of lasting errors first.

    Args:
        seed: of the recording.
        recording: name of another one of the same object.
    """
    return randomness.stream(seed, "noise", *recording)
