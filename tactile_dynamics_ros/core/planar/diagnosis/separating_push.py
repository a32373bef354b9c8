"""The push that would tell two models of a pushed object apart."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals

Array = NDArray[np.float64]
Predict = Callable[[Array, tuple[PushEffect, ...]], Array]
Lacking = Callable[[Intervals, Array, Array, Array, tuple[PushEffect, ...]], Array]
"""Force and torque about the contact (R, 3) that are lacking, N and N m, from intervals, poses
(R, 3) of the frame, velocities (R, 3), common numbers and effects, in steady pushes."""

_HEADINGS_DEG = tuple(45.0 * k for k in range(8))
"""Ways to push that are compared, axes of the table: finer ones name other pushes and part the same
models."""
_SPEEDS = (0.03, 0.1, 0.3)
"""Speeds that are compared, m/s, from slow to as fast as arms push; laws of speed differ most at
the ends."""
_PLACES = ((0.0, 0.0), (0.12, 0.0), (-0.12, 0.0), (0.0, 0.12), (0.0, -0.12))
"""Places from the middle of the recording, m: there and beside it by the length of a push. Farther
ones part springs and gradients better, but tables end."""
_TURNS_DEG = (0.0, 90.0, 180.0)
"""Turns of the object from how it lay: what turns with it differs from what stays with the table at
each of them."""
_BEYOND = 1.5
"""Place of a push that tells a slope from variation, in widths of the pushed places from their
middle: a width outside of them. At 0.5 it is at their edge, farther tables end."""
_SAMPLES = 50
"""Samples of force by which a push tells: half a second at 100 Hz."""
_PATCHES = 2.0
"""Square root of the places over which a push averages friction that differs: 80 mm of 20 mm each.
At 1 pushes that would part models are not promised, at 4 some that would not are."""
_PARTED = 4.0
"""Standard deviations of the mean force by which models must differ: one in ten thousand by chance,
of some hundred pushes that are compared. At 3 pushes are promised that part nothing."""
SLIP = 5e-4
"""Speed below which friction falls, m/s, far below that of the pushes; smaller changes nothing."""


@dataclass(frozen=True, eq=False)
class Steady:
    """An object in pushes without turning, at speeds that last.

    Attributes:
        intervals: of the recording. typical_force: N.
        middle: (2,) m, mean place of the centroid. centroid: (2,) m, in the frame.
        size: m, radius of gyration of the footprint. lacking: of pushes.
    """

    intervals: Intervals
    typical_force: float
    middle: Array
    centroid: Array
    size: float
    lacking: Lacking


def plan_push(
    best: Callable[[Predict], Array],
    rivals: Mapping[str, Callable[[Predict], Array]],
    thing: Steady,
    variation: float,
) -> dict[str, Any] | None:
    """Choose the push in which the rivals' forces differ most from the best model's.

    Args:
        best: gives what a prediction makes of its numbers and effects.
        rivals: likewise, by name.
        thing: the object in such pushes.
        variation: relative standard deviation of friction from place to place.

    Returns:
        `heading_deg`, `speed`, `place`, `turn_deg`, `description`, `differs_by_n` and
        `separates_from`, the names of the rivals that it parts; None if it parts none.
    """
    if not rivals:
        return None
    pushes = list(product(_HEADINGS_DEG, _SPEEDS, _PLACES, _TURNS_DEG))
    predict = _prediction(pushes, thing)
    mine = best(predict)
    noise = float(np.median(thing.intervals.force_std)) / np.sqrt(_SAMPLES)
    noise = float(np.hypot(noise, variation * thing.typical_force / _PATCHES))
    away = np.stack([np.abs(rival(predict) - mine).max(axis=1) for rival in rivals.values()])
    chosen = int(np.argmax(away.min(axis=0)))
    parted = away[:, chosen] > _PARTED * noise
    if not parted.any():
        return None
    heading, speed, place, turn = pushes[chosen]
    where = np.asarray(thing.middle) + place
    difference = float(away[parted, chosen].min())
    turning = f", with the object turned by {turn:.0f} deg" if turn else ""
    return {
        "heading_deg": heading,
        "speed": speed,
        "place": [float(v) for v in where],
        "turn_deg": turn,
        "differs_by_n": difference,
        "separates_from": [name for name, p in zip(rivals, parted, strict=True) if p],
        "description": f"push it towards {heading:.0f} deg (axes of the table) at {speed:g} m/s "
        f"near ({where[0]:.2f}, {where[1]:.2f}) m{turning}: the forces differ there by "
        f"{difference:.2f} N",
    }


def plan_wider(thing: Steady) -> dict[str, Any]:
    """Plan the push that tells a slope of friction from friction that differs by place.

    A slope goes on beyond the places that were pushed; what merely differs does not.

    Args:
        thing: the object, at the places of the recording.
    """
    places = thing.intervals.poses[0].value[:, :2]
    axis = int(np.argmin(np.ptp(places, axis=0)))
    where = np.asarray(thing.middle, dtype=float).copy()
    where[axis] += _BEYOND * max(float(np.ptp(places[:, axis])), thing.size)
    return {
        "heading_deg": 90.0 * axis,
        "speed": _SPEEDS[1],
        "place": [float(v) for v in where],
        "turn_deg": 0.0,
        "description": "push over more of the table, "
        f"as towards and beyond ({where[0]:.2f}, {where[1]:.2f}) m: a slope goes on there",
        "differs_by_n": None,
        "separates_from": ["friction_variation"],
    }


def _prediction(pushes: Sequence[tuple[Any, ...]], thing: Steady) -> Predict:
    """What the sensor would read, (R, 3) N, in pushes without turning, for numbers and effects."""
    heading = np.radians([p[0] for p in pushes])
    speed = np.array([p[1] for p in pushes])
    way = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    yaw = float(np.median(thing.intervals.poses[0].value[:, 2]))
    yaws = yaw + np.radians([p[3] for p in pushes])
    none = np.zeros((len(pushes), 3))
    velocity = np.column_stack([speed[:, None] * way, none[:, 0]])
    centre = thing.middle + np.array([p[2] for p in pushes])
    place = centre - turned(np.broadcast_to(thing.centroid, centre.shape), yaws)
    pose = np.column_stack([place, yaws])

    def predict(common: Array, effects: tuple[PushEffect, ...]) -> Array:
        com = np.broadcast_to(common[2:4], centre.shape)
        point = np.column_stack([centre + turned(com, yaws), np.full(len(yaws), _height(thing))])
        force = none
        for _ in range(2):
            cut = _intervals(thing, force, point, heading)
            lack = thing.lacking(cut, pose, velocity, common, effects)
            force = force + np.column_stack([lack[:, :2], none[:, 0]])
        return np.column_stack([force[:, :2], lack[:, 2] / thing.size])

    return predict


def _height(thing: Steady) -> float:
    cut = thing.intervals
    return float(np.median(cut.point[cut.touching, 2]))


def _intervals(thing: Steady, force: Array, point: Array, facing: Array) -> Intervals:
    count = len(force)
    none, yes = np.zeros(count), np.ones(count, dtype=bool)
    return Intervals(
        step=thing.intervals.step,
        time=np.full(count, float(thing.intervals.time[-1])),
        inner=np.zeros(count, dtype=bool),
        force=force,
        force_std=np.zeros((count, 2)),
        expected=force,
        facing=facing,
        point=point,
        point_std=none,
        torque=none,
        touching=yes,
        measured=yes,
        first_node=np.zeros(1, dtype=np.intp),
        poses=(),
    )
