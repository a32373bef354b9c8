"""The push that would tell two models of a pushed object apart."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals

Predict = Callable[[Array, tuple[PushEffect, ...]], Array]
Lacking = Callable[[Intervals, Array, Array, Array, tuple[PushEffect, ...]], Array]
"""Force and torque about the contact (R, 3) that are lacking, N and N m, from intervals, poses
(R, 3) of the frame, velocities (R, 3), common numbers and effects, in steady pushes."""

_HEADINGS_DEG = tuple(45.0 * k for k in range(8))
"""Ways to push that are compared, axes of the table: finer ones name other pushes and part the same
models."""
SPEEDS = (0.03, 0.1, 0.3)
"""Speeds that are compared, m/s, from slow to as fast as arms push; laws of speed differ most at
the ends."""
PLACES = ((0.0, 0.0), (0.12, 0.0), (-0.12, 0.0), (0.0, 0.12), (0.0, -0.12))
"""Places from the middle of the recording, m: there and beside it by the length of a push. Farther
ones part springs and gradients better, but tables end."""
TURNS_DEG = (0.0, 90.0, 180.0)
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
_PUSHES = tuple(product(_HEADINGS_DEG, SPEEDS, PLACES, TURNS_DEG))
"""Heading, speed, place and turn of every push that is compared, of one body."""
SLIP = 5e-4
"""Speed below which friction falls, m/s, far below that of the pushes; smaller changes nothing."""


class Predicted(ABC):
    """An object in K pushes that were not made.

    Attributes:
        intervals: of the recording. typical_force: N.
        middle: (2,) m, mean place of the centroid. size: m, by which torques are forces.
    """

    intervals: Intervals
    typical_force: float
    middle: Array
    size: float

    @abstractmethod
    def predict(self, common: Array, effects: tuple[PushEffect, ...]) -> Array:
        """What the sensor would read, (K, c) N, torques over `size`."""

    @abstractmethod
    def describe(self, k: int) -> dict[str, Any]:
        """`heading_deg`, `speed`, `place`, `turn_deg` of a push, and `description` of how to do it.

        Of two parts `link` is pushed at `point`, m, in its frame.
        """


@dataclass(frozen=True, eq=False)
class Steady(Predicted):
    """An object in pushes without turning, at speeds that last.

    Attributes:
        centroid: (2,) m, in the frame. lacking: of pushes.
    """

    intervals: Intervals
    typical_force: float
    middle: Array
    centroid: Array
    size: float
    lacking: Lacking

    def predict(self, common: Array, effects: tuple[PushEffect, ...]) -> Array:
        """Force and torque."""
        pushes, yaws = _PUSHES, self.yaw + np.radians([p[3] for p in _PUSHES])
        heading = np.radians([p[0] for p in pushes])
        way = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        none = np.zeros((len(pushes), 3))
        velocity = np.column_stack([np.array([p[1] for p in pushes])[:, None] * way, none[:, 0]])
        centre = self.middle + np.array([p[2] for p in pushes])
        place = centre - turned(np.broadcast_to(self.centroid, centre.shape), yaws)
        pose = np.column_stack([place, yaws])
        com = np.broadcast_to(common[2:4], centre.shape)
        point = with_height(self.intervals, centre + turned(com, yaws))

        def lack(cut: Intervals) -> Array:
            return self.lacking(cut, pose, velocity, common, effects)

        return sensor_reading(self.intervals, point, heading, lack) / [1.0, 1.0, self.size]

    def describe(self, k: int) -> dict[str, Any]:
        """Through the centre of mass, so that the object does not turn."""
        heading, speed, place, turn = _PUSHES[k]
        where = np.asarray(self.middle) + place
        turning = f", with the object turned by {turn:.0f} deg" if turn else ""
        return {
            "heading_deg": heading,
            "speed": speed,
            "place": [float(v) for v in where],
            "turn_deg": turn,
            "description": f"push it towards {heading:.0f} deg (axes of the table) at {speed:g} "
            f"m/s near ({where[0]:.2f}, {where[1]:.2f}) m{turning}",
        }

    @property
    def yaw(self) -> float:
        """How the object lay, rad."""
        return float(np.median(self.intervals.poses[0].value[:, 2]))


def plan_push(
    best: Callable[[Predict], Array],
    rivals: Mapping[str, Callable[[Predict], Array]],
    thing: Predicted,
    variation: float,
) -> dict[str, Any] | None:
    """Choose the push in which the rivals' forces differ most from the best model's.

    Args:
        best: gives what a prediction makes of its numbers and effects.
        rivals: likewise, by name.
        thing: the object in such pushes.
        variation: relative standard deviation of friction from place to place.

    Returns:
        What `Predicted.describe` says, `differs_by_n` and `separates_from`, the names of the rivals
        that it parts; None if it parts none.
    """
    if not rivals:
        return None
    mine = best(thing.predict)
    noise = float(np.median(thing.intervals.force_std)) / np.sqrt(_SAMPLES)
    noise = float(np.hypot(noise, variation * thing.typical_force / _PATCHES))
    away = np.stack([np.abs(rival(thing.predict) - mine).max(axis=1) for rival in rivals.values()])
    chosen = int(np.argmax(away.min(axis=0)))
    parted = away[:, chosen] > _PARTED * noise
    if not parted.any():
        return None
    difference, told = float(away[parted, chosen].min()), thing.describe(chosen)
    return told | {
        "differs_by_n": difference,
        "separates_from": [name for name, p in zip(rivals, parted, strict=True) if p],
        "description": f"{told['description']}: the forces differ there by {difference:.2f} N",
    }


def plan_wider(thing: Predicted) -> dict[str, Any]:
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
        "speed": SPEEDS[1],
        "place": [float(v) for v in where],
        "turn_deg": 0.0,
        "description": "push over more of the table, "
        f"as towards and beyond ({where[0]:.2f}, {where[1]:.2f}) m: a slope goes on there",
        "differs_by_n": None,
        "separates_from": ["friction_variation"],
    }


def sensor_reading(
    seen: Intervals, point: Array, facing: Array, lack: Callable[[Intervals], Array]
) -> Array:
    """Force (K, 2), N, that the sensor reads where none is lacking, and what else is, (K, D - 2).

    Args:
        seen: intervals of the recording.
        point: (K, 3) m, that is touched.
        facing: (K,) rad, of the pusher's axes.
        lack: (K, D) of intervals; the force tips the object, so that it is asked twice.
    """
    force, short = np.zeros((len(point), 3)), np.zeros(0)
    for _ in range(2):
        short = lack(made_intervals(seen, force, point, facing))
        force[:, :2] += short[:, :2]
    return np.column_stack([force[:, :2], short[:, 2:]])


def with_height(seen: Intervals, place: Array) -> Array:
    """Places (K, 3) at the height at which pushes were made."""
    height = float(np.median(seen.point[seen.touching, 2]))
    return np.column_stack([place, np.full(len(place), height)])


def made_intervals(seen: Intervals, force: Array, point: Array, facing: Array) -> Intervals:
    """Intervals of pushes that were not made.

    Args:
        seen: of the recording.
        force: (K, 3) N.
        point: (K, 3) m.
        facing: (K,) rad, of the pusher's axes.
    """
    count = len(force)
    none, yes = np.zeros(count), np.ones(count, dtype=bool)
    return Intervals(
        step=seen.step,
        time=np.full(count, float(seen.time[-1])),
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
