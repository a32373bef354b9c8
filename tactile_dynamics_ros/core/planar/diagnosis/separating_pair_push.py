"""The push of two parts that would tell models apart: which part, where, which way, how fast."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.diagnosis.separating_push import (
    PLACES,
    SPEEDS,
    TURNS_DEG,
    Predicted,
    Steady,
    sensor_reading,
    with_height,
)
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.linked.pushes import (
    TIP_FRICTION,
    BegunMotion,
    KnownPair,
    PairPushes,
    begun_motion,
    possible_pushes,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import in_frame, placed, turned
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals

LackOfMotion = Callable[[Intervals, PairPushes, Array, Array, tuple[PushEffect, ...]], Array]
"""Two forces and torques about contact and joint (K, 4) that are lacking, N and N m, of cuts,
pushes, velocities (K, 4) of the coordinates, common numbers and effects."""


def described_push(link: int, point: Array, heading_deg: float, speed: float, where: Array) -> str:
    """What to do, in words: a place of one part, a direction and a speed."""
    x, y = 1e3 * point
    return (
        f"push link_{link} at ({x:.0f}, {y:.0f}) mm in its frame towards {heading_deg:.0f} deg "
        f"(axes of the table) at {speed:g} m/s, from ({where[0]:.2f}, {where[1]:.2f}) m"
    )


@dataclass(frozen=True, eq=False)
class JointedPushes(Predicted):
    """Two parts on a joint, pushed all around both of them.

    Attributes:
        pair: friction and joint, as they were found.
        outlines: (V, 2) m of both, each in its frame.
        lacking: of motions.
    """

    intervals: Intervals
    typical_force: float
    middle: Array
    size: float
    pair: KnownPair
    outlines: tuple[Array, Array]
    lacking: LackOfMotion

    @cached_property
    def pushes(self) -> PairPushes:
        """Those in which the tip does not slip, from where the parts lay last and beside it."""
        begun = begun_motion(self._possible, self.pair)
        return self._possible.taken(begun.holds(self._possible, TIP_FRICTION))

    @cached_property
    def _possible(self) -> PairPushes:
        first, second = (poses.value[-1] for poses in self.intervals.poses)
        bend, poses = second[2] - first[2], []
        for turn in np.radians(TURNS_DEG):
            about = self.middle + turned((first[:2] - self.middle)[None], np.array([turn]))[0]
            yaw = first[2] + turn
            poses += [np.array([*(about + place), yaw, yaw + bend]) for place in PLACES]
        return possible_pushes(self.outlines, self.pair.joint, np.array(poses), SPEEDS)

    @cached_property
    def _motion(self) -> BegunMotion:
        return begun_motion(self.pushes, self.pair)

    def predict(self, common: Array, effects: tuple[PushEffect, ...]) -> Array:
        """Force and torques about contact and joint, of the motion that was found likeliest."""
        pushes = self.pushes
        x, y = pushes.way.T
        point = with_height(self.intervals, pushes.place(self.pair))

        def lack(cut: Intervals) -> Array:
            return self.lacking(cut, pushes, self._motion.velocity, common, effects)

        read = sensor_reading(self.intervals, point, np.arctan2(y, x), lack)
        return read / [1.0, 1.0, self.size, self.size]

    def describe(self, k: int) -> dict[str, Any]:
        """Which part, where on its outline, which way, how fast."""
        push = self.pushes.taken(np.array([k]))
        x, y = push.way[0]
        heading, speed = float(np.degrees(np.arctan2(y, x))), float(push.speed[0])
        where, link = push.place(self.pair)[0], int(push.part[0]) + 1
        turn = float(np.degrees(push.pose[0, 2] - self._possible.pose[0, 2])) + 0.0
        turning = f", with both parts turned by {turn:.0f} deg" if abs(turn) > 1.0 else ""
        return {
            "heading_deg": heading,
            "speed": speed,
            "place": [float(v) for v in where],
            "turn_deg": turn,
            "link": f"link_{link}",
            "point": [float(v) for v in push.point[0]],
            "description": described_push(link, push.point[0], heading, speed, where) + turning,
        }


@dataclass(frozen=True, eq=False)
class RigidPushes(Steady):
    """A rigid pair in pushes without turning, and where on which part a tip touches for them.

    Attributes:
        outlines: (V, 2) m of both parts, each in its frame.
        offset: (3,) m, m, rad, of the second part in the first one's frame.
        com: (2,) m, centre of mass in the first one's frame, as it was found.
    """

    outlines: tuple[Array, Array]
    offset: Array
    com: Array

    def describe(self, k: int) -> dict[str, Any]:
        """The tip touches where the line through the centre of mass enters a part."""
        said = super().describe(k)
        turn = self.yaw + np.radians(said["turn_deg"])
        heading = np.radians(said["heading_deg"]) - turn
        ray = -np.array([np.cos(heading), np.sin(heading)])
        reach = [last_crossing(outline, self.com, ray) for outline in self._placed]
        part = int(np.argmax(reach))
        if reach[part] <= 0.0:
            return said
        point = self.com + reach[part] * ray
        centre = np.asarray(said["place"]) - turned(self.centroid[None], np.array([turn]))[0]
        where = centre + turned(point[None], np.array([turn]))[0]
        if part == 1:
            point = in_frame(point[None], self.offset)[0]
        turned_by = said["turn_deg"]
        turning = f", with both parts turned by {turned_by:.0f} deg" if turned_by else ""
        words = described_push(part + 1, point, said["heading_deg"], said["speed"], where)
        return said | {
            "link": f"link_{part + 1}",
            "point": [float(v) for v in point],
            "place": [float(v) for v in where],
            "description": words + turning,
        }

    @property
    def _placed(self) -> tuple[Array, Array]:
        """Both outlines in the first one's frame."""
        first, second = self.outlines
        return first, placed(second, self.offset)


def last_crossing(outline: Array, start: Array, ray: Array) -> float:
    """Distance, m, at which a ray (2,) from a start (2,) crosses an outline last; else 0."""
    edge = np.roll(outline, -1, axis=0) - outline
    to = outline - start
    size = ray[0] * edge[:, 1] - ray[1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (to[:, 0] * edge[:, 1] - to[:, 1] * edge[:, 0]) / size
        share = (to[:, 0] * ray[1] - to[:, 1] * ray[0]) / size
    hit = (np.abs(size) > 1e-12) & (share >= 0.0) & (share <= 1.0) & (along > 0.0)
    return float(np.max(np.where(hit, along, 0.0)))
