"""Scripted pushes: where each part of an object is at every image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import pose_of
from tactile_dynamics_ros.sim.objects import PlanarObject

RATE_HZ = 15.0
PUSH_S, PAUSE_S, RAMP_S = 1.4, 0.4, 0.15
FASTEST, FASTEST_TURN = 0.1, 0.5
"""m/s, rad/s."""
WIDEST = 0.06
"""Distance from the start, m, from which pushes lead back."""
WIDEST_JOINT = np.deg2rad(15.0)
"""Turn of a joint to each side: gaps of some millimetres allow no more."""
PLACE = np.array([0.5, 0.0])
OPEN_S, HALF_S, GONE_S, BACK_S = 6.0, 3.0, 0.7, 2.0
"""Pushes in full view, half hidden, without the object, and with it put back elsewhere."""


@dataclass(frozen=True)
class Moment:
    """One image's truth.

    Attributes:
        time: s. phase: "open", "half", "gone" or "back".
        parts: poses (4, 4) of the parts, whose frames are the object's at the start.
        direction: (2,) in which the object is pushed.
    """

    time: float
    phase: str
    parts: tuple[Array, ...]
    direction: Array


def write_script(thing: PlanarObject, seed: int) -> list[Moment]:
    """Return the moments of a run.

    Args:
        thing: object that is pushed.
        seed: of places, directions and speeds.
    """
    rng = np.random.default_rng([seed, thing.number])
    place, angle, joint = np.array([*PLACE, 0.0]), rng.uniform(-np.pi, np.pi), 0.0
    place[2] = angle
    found = []
    lasting = (("open", OPEN_S), ("half", HALF_S), ("gone", GONE_S), ("back", BACK_S))
    phases = [name for name, span in lasting for _ in range(round(span * RATE_HZ))]
    twist, bend, since = np.zeros(3), 0.0, np.inf
    centre = np.mean(np.vstack([part.corners for part in thing.parts]), axis=0)
    for k, phase in enumerate(phases):
        if since >= PUSH_S + PAUSE_S:
            twist, bend, since = *_push(place, joint, rng), 0.0
        if phase == "back" and phases[k - 1] == "gone":
            place = place + [*rng.uniform(-0.05, 0.05, 2), rng.uniform(-0.5, 0.5)]
        parts = _poses(thing, place, joint, centre)
        found.append(Moment(1.0 + k / RATE_HZ, phase, parts, twist[:2]))
        share = np.clip(min(since, PUSH_S - since) / RAMP_S, 0.0, 1.0) if phase != "gone" else 0.0
        place = place + share * twist / RATE_HZ
        joint += share * bend / RATE_HZ if thing.joint is not None else 0.0
        since += 1.0 / RATE_HZ
    return found


def _push(place: Array, joint: float, rng: np.random.Generator) -> tuple[Array, float]:
    """Return velocity (x, y, turn) of the next push, and of the joint."""
    away = place[:2] - PLACE
    direction = rng.uniform(-np.pi, np.pi)
    if np.linalg.norm(away) > WIDEST:
        direction = np.arctan2(-away[1], -away[0])
    speed = rng.uniform(0.3, 1.0) * FASTEST
    turn = rng.uniform(-1.0, 1.0) * FASTEST_TURN
    bend = rng.uniform(0.2, 1.0) * FASTEST_TURN * (-1.0 if joint > 0.0 else 1.0)
    bend = np.clip(bend, *((np.array([-1, 1]) * WIDEST_JOINT - joint) / (PUSH_S - RAMP_S)))
    return np.array([speed * np.cos(direction), speed * np.sin(direction), turn]), float(bend)


def _poses(thing: PlanarObject, place: Array, joint: float, centre: Array) -> tuple[Array, ...]:
    """Return poses of the parts of an object whose centre is at a place (x, y, yaw)."""
    pose = pose_of([*place[:2], 0.0], [0.0, 0.0, place[2]])
    pose = pose @ pose_of([*-centre, 0.0], [0.0, 0.0, 0.0])
    if len(thing.parts) == 1:
        return (pose,)
    if thing.joint is None:
        return (pose, pose)
    hinge = pose_of([*thing.joint, 0.0], [0.0, 0.0, joint])
    return (pose, pose @ hinge @ pose_of([*-thing.joint, 0.0], [0.0, 0.0, 0.0]))
