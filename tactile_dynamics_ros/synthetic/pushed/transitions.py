"""Steps of simulated pushes and pulls, free of noise: what networks learn from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.network.graph import Push, Thing, grip_axis
from tactile_dynamics_ros.core.planar.network.transitions import Transitions
from tactile_dynamics_ros.synthetic.pushed.bodies import rotation
from tactile_dynamics_ros.synthetic.pushed.objects import PushedObject
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, Scene
from tactile_dynamics_ros.synthetic.pushed.simulator import Motion

_UNTOUCHED_EVERY = 6
"""One in how many steps without contact is kept: an object at rest stays there."""


def describe(thing: PushedObject) -> Thing:
    """Return what is known of an object before it is pushed."""
    return Thing(
        patches=tuple(SupportPatch(link.corners, 25) for link in thing.links),
        com_height=np.array([0.5 * link.height for link in thing.links]),
        joint=_meeting(thing),
        rigid=thing.kind == "rigid_pair",
    )


def _meeting(thing: PushedObject) -> np.ndarray | None:
    if len(thing.links) == 1:
        return None
    return thing.joint if thing.joint is not None else 0.5 * thing.offset


def true_parameters(scene: Scene) -> np.ndarray:
    """Return the parameters (p,) of a scene, in the order of `GraphProcess.names`."""
    values = []
    for link in scene.thing.links:
        values += [np.log(link.mass * link.friction), np.log(link.mass), *link.com]
    values.append(np.log(scene.tip.friction))
    if scene.thing.joint is not None:
        values.append(np.log(scene.thing.joint_friction))
    return np.array(values)


def states_at(scene: Scene, motion: Motion) -> np.ndarray:
    """Return the states (K, 6 L) of the links' frames at every step of the physical clock."""
    parts = []
    for k in range(len(scene.thing.links)):
        rigid = scene.thing.kind == "rigid_pair"
        body = 0 if rigid else k
        yaw = motion.angle[:, body]
        place = motion.origin[:, body]
        if rigid:
            place = place + np.einsum("nij,j->ni", rotation(yaw), k * scene.thing.offset)
        pose = np.column_stack([place, yaw])
        rate = np.diff(pose, axis=0, prepend=pose[:1]) / STEP
        parts.append(np.concatenate([pose, rate], axis=1))
    return np.concatenate(parts, axis=1)


def cut_steps(
    scene: Scene, motion: Motion, period: float, every: float | None = None
) -> list[Transitions]:
    """Return the steps of a simulated recording, those of each touched link together.

    It has pushes or pulls, not both.

    Args:
        scene: what was simulated.
        motion: what happened.
        period: s of each step.
        every: s between the beginnings of steps; the period by default.
    """
    states = states_at(scene, motion)
    span = round(period / STEP)
    stride = span if every is None else max(1, round(every / STEP))
    start = np.arange(3, len(states) - span - 1, stride)
    start = start[steady(motion, start, span)]
    pulls = bool(motion.contact[:, 1:].any())
    holds = motion.contact[:, 1:].all(axis=1) if pulls else motion.contact[:, 0]
    touched = np.array([holds[k + 1 : k + span + 1].mean() for k in start])
    kept = (touched > 0.99) | ((touched == 0.0) & (np.arange(len(start)) % _UNTOUCHED_EVERY == 0))
    start, touched = start[kept], touched[kept]
    thing, truth = describe(scene.thing), true_parameters(scene)
    found = []
    for link in range(len(scene.thing.links)):
        rows = start[motion.touched[start + 1] == link]
        if len(rows):
            push = _push(scene, motion, rows, span, link, pulls)
            force = np.stack([_measured(motion, k, span, pulls) for k in rows])
            parameters = np.broadcast_to(truth, (len(rows), len(truth)))
            after = states[rows + span]
            found.append(Transitions(thing, parameters, states[rows], after, push, force))
    return found


def steady(motion: Motion, start: np.ndarray, span: int) -> np.ndarray:
    """Return whether the pusher does not jump to its next action within a step."""
    jump = np.linalg.norm(np.diff(motion.pusher[:, :2], axis=0), axis=1) > 1.5 * STEP
    jumps = np.concatenate([[0], np.cumsum(jump)])
    return np.asarray(jumps[start + span] == jumps[start])


def _push(
    scene: Scene, motion: Motion, rows: np.ndarray, span: int, link: int, pulls: bool
) -> Push:
    place = motion.pusher[rows]
    rate = (motion.pusher[rows + span] - place) / (span * STEP)
    velocity, contact = rate[:, :2], motion.contact[rows + 1]
    normal = grip_axis(velocity, place[:, 2]) if pulls else motion.normal[rows + 1, 0]
    return Push(
        point=place[:, :2] if pulls else place[:, :2] + scene.tip.radius * normal,
        velocity=velocity,
        normal=normal,
        touching=(contact[:, 1:].all(axis=1) if pulls else contact[:, 0]).astype(float),
        height=np.full(len(rows), scene.tip.height),
        step=span * STEP,
        link=link,
        turning=rate[:, 2] if pulls else None,
    )


def _measured(motion: Motion, k: int, span: int, pulls: bool) -> np.ndarray:
    """Mean force (2,) of a tip, or wrench (3,) of both pads about where the gripper begins."""
    window = slice(k + 1, k + span + 1)
    if not pulls:
        return np.asarray(motion.force[window, 0].mean(axis=0))
    force, arm = motion.force[window, 1:], motion.point[window, 1:] - motion.pusher[k, :2]
    torque = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
    return np.append(force.sum(axis=1).mean(axis=0), torque.sum(axis=1).mean())


def cut_all(
    pairs: Sequence[tuple[Scene, Motion]], period: float, every: float | None = None
) -> list[Transitions]:
    """Return the steps of several recordings."""
    return [steps for scene, motion in pairs for steps in cut_steps(scene, motion, period, every)]
