"""Two parts: rigid or jointed by their motion, the joint's place, and what pushes tell of each.

*Told*: where a structure is undecided, the next push is the one that the answer proposes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.linked.description import LinkedEstimate
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair
from tactile_dynamics_ros.synthetic import pushed, randomness
from tactile_dynamics_ros.synthetic.pushed.actions import Action, ActionOptions
from tactile_dynamics_ros.synthetic.pushed.effects import Faults, Hidden, hide
from tactile_dynamics_ros.synthetic.pushed.recordings import draw_scene
from tactile_dynamics_ros.synthetic.pushed.scene import Scene
from tactile_dynamics_ros.synthetic.pushed.sensors import read_sensors
from tactile_dynamics_ros.synthetic.pushed.simulator import Motion, simulate

KINDS = ("rigid_pair", "jointed")
SPEED = (0.1, 0.3)
"""m/s of the pushes: on either part in turn."""
NEAR = (55.0, 80.0)
"""Degrees between the line to the other part and the place that is pushed: sideways, close to where
the parts meet. There a push makes the other part trail, and its friction turns the joint."""
TOLD = 3
"""Pushes of a recording in which the answer proposes the next one: as many as it should need."""
USUAL = (0.03, 0.2)
"""m/s of the generator's own pushes, which are spread over the free sides."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--pairs", type=int, default=40, help="seeds of each kind of pair")
    parser.add_argument("--full-pairs", type=int, default=12, help="seeds fitted in full")
    parser.add_argument("--pair-variation", type=float, default=0.0, help="of friction by place")
    parser.add_argument("--pair-play", type=float, default=0.0, help="m, of more joints' pins")
    parser.add_argument("--first-pair", type=int, default=200, help="first seed of pairs")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Structures after one and three pushes, and properties after six."""
    count = 2 if options.quick else options.pairs
    full = 1 if options.quick else options.full_pairs
    first, variation = options.first_pair, options.pair_variation
    seeds, fully = range(first, first + count), range(first, first + full)
    found: dict[str, Any] = {}
    for name, pushes, own in (("1 near", 1, True), ("3 near", 3, True), ("3 usual", 3, False)):
        for kind in KINDS if count else ():
            drawn = recorded(seeds, kind, pushes, own, variation)
            found[f"{name} {kind}"] = [_structure(*pair) for pair in drawn]
    for kind in KINDS if count else ():
        drawn = told(seeds, kind, variation)
        found[f"1 near, 2 told, {kind}"] = [_structure(*pair) for pair in drawn]
    if options.pair_play:
        drawn = recorded(seeds, "jointed", 3, True, variation, options.pair_play)
        found["3 near, play, jointed"] = [_structure(*pair) for pair in drawn]
        found["3 near, loose_joint, jointed"] = [_structure(*pair, loose=True) for pair in drawn]
    for kind in KINDS if full else ():
        drawn = recorded(fully, kind, 6, True, variation)
        found[f"6 near {kind}"] = [_properties(*pair) for pair in drawn]
    return found


def recorded(
    seeds: Sequence[int],
    kind: str,
    pushes: int,
    near: bool,
    variation: float = 0.0,
    play: float = 0.0,
    hidden: Mapping[str, float] | None = None,
) -> list[tuple[pushed.HiddenPush, Motion]]:
    """Recordings of pairs that are pushed near where their parts meet, or as usual.

    Args:
        seeds: one of each recording.
        kind: of the pair.
        pushes: in each recording.
        near: whether near where parts meet.
        variation: relative, of friction from place to place.
        play: m, by which a joint's pin is thinner than its hole.
        hidden: effects at multiples of their typical sizes.
    """
    actions = ActionOptions(count=pushes, speed=SPEED if near else USUAL)
    options = pushed.PushOptions(kind=kind, actions=actions, variation=variation)
    scenes = [draw_scene(seed, options) for seed in seeds]
    if near:
        scenes = [_pushed_near(scene) for scene in scenes]
    scenes = [replace(scene, thing=replace(scene.thing, play=play)) for scene in scenes]
    added = [_hidden(scene, hidden or {}) for scene in scenes]
    found = []
    for more, motion in zip(added, simulate([more.scene for more in added]), strict=True):
        found.append(_read(more, motion, options))
    return found


def _read(
    made: Hidden, motion: Motion, options: pushed.PushOptions
) -> tuple[pushed.HiddenPush, Motion]:
    """What sensors read of a motion."""
    rng = randomness.stream(made.scene.seed, "noise")
    faults = made.faults or Faults()
    streams = read_sensors(motion, made.scene, faults, options.sensors, rng)
    return pushed.HiddenPush(streams, made.scene, made.parameters, motion), motion


def told(
    seeds: Sequence[int], kind: str, variation: float = 0.0
) -> list[tuple[pushed.HiddenPush, Motion]]:
    """Recordings of one push near where parts meet, then of up to two that the answer proposes.

    Args:
        seeds: one of each recording.
        kind: of the pair.
        variation: relative, of friction from place to place.
    """
    options = pushed.PushOptions(
        kind=kind, actions=ActionOptions(count=TOLD, speed=SPEED), variation=variation
    )
    planned = [_pushed_near(draw_scene(seed, options)) for seed in seeds]
    scenes = [replace(scene, actions=scene.actions[:1]) for scene in planned]
    read: list[tuple[pushed.HiddenPush, Motion]] = []
    for k in range(TOLD):
        read = [_read(Hidden(s), m, options) for s, m in zip(scenes, simulate(scenes), strict=True)]
        if k + 1 < TOLD:
            more = zip(scenes, planned, read, strict=True)
            scenes = [_as_told(s, p.actions[k + 1], made) for s, p, (made, _) in more]
    return read


def _as_told(scene: Scene, planned: Action, made: pushed.HiddenPush) -> Scene:
    """The scene with one more push if its structure is undecided, made as the answer says."""
    pair = Pair.of_streams(made.streams)
    push = pair.telling_push
    if pair.structure.name != "undecided" or push is None:
        return scene
    heading = float(np.arctan2(push.normal[1], push.normal[0]))
    action = replace(planned, link=push.part, point=push.point, normal=push.normal, heading=heading)
    return replace(scene, actions=(*scene.actions, action))


def _hidden(scene: Scene, effects: Mapping[str, float]) -> Hidden:
    """The scene with effects, and their true parameters by name."""
    made = Hidden(scene)
    for name, size in effects.items():
        added = hide(name, size, made.scene, randomness.stream(scene.seed, "effect", name))
        told = made.parameters | {name: {"parameters": added.parameters}}
        made = Hidden(added.scene, added.faults or made.faults, told)
    return made


def _pushed_near(scene: Scene) -> Scene:
    """The same actions, begun sideways close to where the parts meet."""
    rng = randomness.stream(scene.seed, "near")
    actions = []
    for k, action in enumerate(scene.actions):
        side = 1.0 if (k // 2 + scene.seed) % 2 == 0 else -1.0
        towards = 0.0 if action.link == 0 else np.pi
        angle = towards + side * np.radians(rng.uniform(*NEAR))
        point, normal = point_at(scene.thing.links[action.link].corners, angle)
        tilt = np.radians(rng.uniform(-7.5, 7.5))
        heading = float(np.arctan2(normal[1], normal[0]) + tilt)
        actions.append(replace(action, point=point, normal=normal, heading=heading))
    return replace(scene, actions=tuple(actions))


def point_at(corners: Array, angle: float) -> tuple[Array, Array]:
    """Point of a convex outline in a direction from its origin, and the normal inwards."""
    ray = np.array([np.cos(angle), np.sin(angle)])
    edge = np.roll(corners, -1, axis=0) - corners
    outwards = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    facing = outwards @ ray
    reach = np.sum(outwards * corners, axis=1) / np.where(facing > 1e-9, facing, np.nan)
    k = int(np.nanargmin(reach))
    return reach[k] * ray, -outwards[k]


def _structure(hidden: pushed.HiddenPush, motion: Motion, loose: bool = False) -> dict[str, Any]:
    start = time.process_time()
    structure = Pair.of_streams(hidden.streams, loose).structure
    row: dict[str, Any] = {
        "cpu_s": time.process_time() - start,
        "structure": structure.name,
        "probability": structure.probability,
        "play_m": structure.hinge.play,
        "shows_play": structure.slack is not None,
        "true_play_m": hidden.scene.thing.play,
        "turned_rad": float(np.ptp(motion.angle[:, -1] - motion.angle[:, 0])),
    }
    joint = hidden.truth()["joint"]
    if joint is not None:
        away = structure.hinge.first - joint["position"]
        covariance = structure.hinge.covariance[:2, :2]
        row["joint_m"] = float(np.linalg.norm(away))
        row["joint_z"] = float(np.sqrt(away @ np.linalg.solve(covariance, away) / 2.0))
    return row


def _properties(hidden: pushed.HiddenPush, motion: Motion) -> dict[str, Any]:
    start = time.process_time()
    try:
        found = estimate(hidden.streams)
    except NotIdentifiableError as error:
        return {"refused": str(error), "cpu_s": time.process_time() - start}
    assert isinstance(found, LinkedEstimate)
    row: dict[str, Any] = {"cpu_s": time.process_time() - start, "structure": found.structure}
    row["undetermined"] = list(found.undetermined)
    truth = hidden.truth()
    row["z"], row["relative"] = _errors(found, truth)
    return row


def _errors(
    found: LinkedEstimate, truth: dict[str, Any]
) -> tuple[dict[str, float], dict[str, float]]:
    """Errors over std and over the truth (m of centres), of all that is told."""
    pairs: dict[str, tuple[tuple[float, float], float]] = {}
    for k, (link, real) in enumerate(zip(found.links, truth["links"], strict=True)):
        for name in ("friction_force_n", "mass"):
            pairs[f"link_{k + 1}.{name}"] = (link[name], real[name])
        for axis, name in enumerate(("com_x", "com_y")):
            pairs[f"link_{k + 1}.{name}"] = (link[name], real["com"][axis])
    for name in ("friction_force_n", "mass"):
        pairs[name] = (found.whole[name], sum(real[name] for real in truth["links"]))
    if found.joint is not None and found.joint.friction_torque is not None and truth["joint"]:
        torque = truth["joint"]["friction_torque_nm"]
        pairs["joint.friction_torque_nm"] = (found.joint.friction_torque, torque)
    z = {name: (value - real) / std for name, ((value, std), real) in pairs.items()}
    relative = {
        name: value - real if "com" in name else value / real - 1.0
        for name, ((value, _), real) in pairs.items()
    }
    return z, relative


def table(found: dict[str, Any]) -> str:
    """Right, undecided and wrong structures; then errors of properties."""
    head = (
        "| pushes, pair | n | right | undecided | wrong | of those that turned 0.5 deg: right "
        "| joint mm | joint z RMS | cpu s |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    lines += [_structure_line(n, rows) for n, rows in found.items() if not n.startswith("6")]
    lines += [_play_line(n, rows) for n, rows in found.items() if "play" in n or "loose" in n]
    head = "| pushes, pair | number | told of n | median error | 90 % hold | largest z |"
    lines += ["", head, "|" + "---|" * (head.count("|") - 1)]
    for name, rows in found.items():
        if name.startswith("6"):
            lines += _property_lines(name, rows)
    return "\n".join(lines)


def _structure_line(name: str, rows: list[dict[str, Any]]) -> str:
    wanted = "rigid" if name.endswith("rigid_pair") else "jointed"
    right = [row["structure"] == wanted for row in rows]
    undecided = sum(row["structure"] == "undecided" for row in rows)
    moved = [r for r, row in zip(right, rows, strict=True) if row["turned_rad"] > 0.0087]
    cells = [name, len(rows), sum(right), undecided, len(rows) - sum(right) - undecided]
    told = [row for row in rows if row["structure"] == "jointed" and "joint_m" in row]
    place = [f"{sum(moved)} of {len(moved)}" if moved else "-", "-", "-"]
    if told:
        place[1] = f"{1e3 * np.median([row['joint_m'] for row in told]):.1f}"
        place[2] = f"{np.sqrt(np.mean([row['joint_z'] ** 2 for row in told])):.2f}"
    cpu = f"{np.median([row['cpu_s'] for row in rows]):.1f}"
    return "| " + " | ".join(str(cell) for cell in [*cells, *place, cpu]) + " |"


def _play_line(name: str, rows: list[dict[str, Any]]) -> str:
    told = np.array([row["play_m"] for row in rows])
    true = np.array([row["true_play_m"] for row in rows])
    hold = np.abs(told[:, 0] - true) < 1.645 * told[:, 1]
    middle, size = 1e3 * np.median(told[:, 0]), 1e3 * np.median(true)
    line = f"{name}: play {middle:.1f} mm (median; true {size:.1f}), "
    line += f"90 % intervals hold in {hold.mean():.2f}"
    shown = sum(row["shows_play"] for row in rows)
    return line if "loose" in name else f"{line}, asked for in {shown} of {len(rows)}"


def _property_lines(name: str, rows: list[dict[str, Any]]) -> list[str]:
    told = [row for row in rows if "z" in row]
    groups = ("friction_force_n", "mass", "link_.friction_force_n", "link_.mass", "link_.com")
    lines = []
    for group in (*groups, "joint.friction_torque_nm"):
        z, errors = [], []
        for row in told:
            for key, value in row["z"].items():
                plain = key.replace("link_1", "link_").replace("link_2", "link_")
                plain = plain.replace("com_x", "com").replace("com_y", "com")
                unknown = key.replace("com_x", "com").replace("com_y", "com")
                if plain == group and unknown not in row["undetermined"]:
                    z.append(abs(value))
                    errors.append(abs(row["relative"][key]))
        lines.append(_property_line(name, group, len(told), z, errors))
    cpu = max(row["cpu_s"] for row in rows)
    return [*lines, f"| {name} | refused {len(rows) - len(told)} | cpu s at most {cpu:.0f} | | | |"]


def _property_line(name: str, group: str, count: int, z: list[float], errors: list[float]) -> str:
    if not z:
        return f"| {name} | {group} | 0 of {count} | - | - | - |"
    middle = float(np.median(errors))
    size = f"{1e3 * middle:.1f} mm" if "com" in group else f"{100 * middle:.1f} %"
    hold = float(np.mean(np.array(z) < 1.645))
    return f"| {name} | {group} | {len(z)} of {count} | {size} | {hold:.2f} | {max(z):.1f} |"
