"""Where straight pushes take an object: many candidates at once, quasi-static."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.linked.outlines import distance_outside
from tactile_dynamics_ros.core.planar.mechanics.limit_surface import pushed_twist
from tactile_dynamics_ros.core.planar.mechanics.linkage import in_frame, placed, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

_MOST_CORNERS = 48
"""Vertices of an outline that are used: a circle of 6 cm is then met 0.13 mm inside at most, and
each distance costs a comparison per vertex. Fewer would make round objects angular."""
_FEW_CORNERS = 24
"""Vertices of each of two parts on a joint: a circle of 6 cm is met 0.5 mm inside, as poses are off
by anyway; with twice as many the search takes 0.8 s instead of 0.4."""
_CLEAR = 0.003
"""Least gap between tip and what it does not push, m: outlines and poses are right to 3 mm."""


class Pushable(Protocol):
    """What a planner has to know of an object; states are (N, 3) x, y, yaw and what else moves."""

    @property
    def tip_radius(self) -> float:
        """Radius of the pusher, m."""

    @property
    def words(self) -> str:
        """What the object is taken for."""

    def states(self, pose: Array, count: int) -> Array:
        """States (N, D) of an object whose first part is at a pose (3,)."""

    def place(self, share: Array, state: Array) -> tuple[Array, Array]:
        """Point (N, 2) and inward normal (N, 2), world, at shares (N,) of the perimeter."""

    def touch(self, tip: Array, state: Array) -> tuple[Array, Array]:
        """Distance (N,) m of tips (N, 2) from what may be pushed, and normal (N, 2) into it."""

    def away(self, tip: Array, state: Array) -> Array:
        """Directions (N, 2) in which tips (N, 2) come free."""

    def crowded(self, tip: Array, state: Array) -> Array:
        """By how much (N,) m tips (N, 2) are too near to a part when they come down."""

    def struck(self, tip: Array, state: Array) -> Array:
        """By how much (N,) m tips (N, 2) run into what they do not push."""

    def folded(self, state: Array) -> Array:
        """How far (N,) m parts have to turn back to lie side by side in states (N, D)."""

    def pushed_along(self, state: Array, tip: Array, ways: Sequence[Array]) -> tuple[Array, Array]:
        """States and tips after a push along short ways (N, 2) each."""


@dataclass(frozen=True, eq=False)
class PushedBody:
    """What has to be known of an object to predict its motion under slow pushes.

    Only the centre of friction and the friction radius count; mass and friction do not.

    Attributes:
        outline: (V, 2) m, object frame, anticlockwise.
        com: (2,) m, object frame; the centre of friction lies below it.
        tip_radius: m, of the pusher.
        tip_friction: coefficient between tip and object.
        second: (V, 2) m, outline of another part where it lies now, object frame, which is only in
            the way; None: one part.
    """

    outline: Array
    com: Array
    tip_radius: float = 0.006
    tip_friction: float = 0.35
    second: Array | None = None

    @classmethod
    def from_footprint(
        cls, footprint: Array, com: Array | None, tip_radius: float, tip_friction: float
    ) -> PushedBody:
        """Make one from an outline as cameras tell it; without a centre of mass its middle.

        Raises:
            BadInputError: the footprint encloses no area.
        """
        outline = np.asarray(footprint, dtype=float)
        area, middle = area_and_centroid(outline) if len(outline) >= 3 else (0.0, np.zeros(2))
        if not np.isfinite(area) or abs(area) < 1e-6:
            raise BadInputError(f"footprint: {len(outline)} vertices enclose {area:.2g} m^2")
        outline = outline if area > 0.0 else outline[::-1]
        outline = _simplified(outline)
        return cls(outline, middle if com is None else com, tip_radius, tip_friction)

    def beside(self, second: Array) -> PushedBody:
        """Return it with another part (V, 2) m, object frame, in the way."""
        second = second if area_and_centroid(second)[0] > 0.0 else second[::-1]
        return replace(self, second=_simplified(second))

    @property
    def words(self) -> str:
        """What the object is taken for."""
        if self.second is None:
            return "one part"
        return "the first of two parts; the second, moved by no joint that is known, is in the way"

    def states(self, pose: Array, count: int) -> Array:
        """Poses (N, 3), all alike, of an object at a pose (3,)."""
        return np.tile(pose, (count, 1))

    def place(self, share: Array, state: Array) -> tuple[Array, Array]:
        """Point (N, 2) and inward normal (N, 2), world, at shares (N,) of the perimeter."""
        point, normal = self.at(share)
        return placed(point, state), turned(normal, state[:, 2])

    def touch(self, tip: Array, state: Array) -> tuple[Array, Array]:
        """Distance (N,) m of tips (N, 2) from what may be pushed, and normal (N, 2) into it."""
        _, distance, normal = self.nearest(in_frame(tip, state))
        return distance, turned(normal, state[:, 2])

    def away(self, tip: Array, state: Array) -> Array:
        """Directions (N, 2) away from what is pushed."""
        return -self.touch(tip, state)[1]

    def crowded(self, tip: Array, state: Array) -> Array:
        """By how much (N,) m tips (N, 2) are too near to a part when they come down.

        All of them stand beside what they will push.
        """
        if self.second is None:
            return np.zeros(len(tip))
        own = in_frame(tip, state)
        far = [distance_outside(each, own) for each in (self.outline, self.second)]
        return self.lacking(np.minimum(*far))

    def struck(self, tip: Array, state: Array) -> Array:
        """By how much (N,) m tips (N, 2) run into what is not to be pushed."""
        if self.second is None:
            return np.zeros(len(tip))
        return self.lacking(distance_outside(self.second, in_frame(tip, state)))

    def folded(self, state: Array) -> Array:
        """Return nothing (N,): one body does not fold."""
        return np.zeros(len(state))

    def lacking(self, distance: Array) -> Array:
        """By how much (N,) m tips at distances (N,) m from an outline are too near to it."""
        return np.maximum(self.tip_radius + _CLEAR - distance, 0.0)

    def pushed_along(self, state: Array, tip: Array, ways: Sequence[Array]) -> tuple[Array, Array]:
        """Poses and tips after a push along short ways (N, 2) each."""
        for way in ways:
            state, tip = pushed(self, state, tip, way)
        return state, tip

    @cached_property
    def radius(self) -> float:
        """Friction radius, m: largest friction torque over largest force."""
        patch = SupportPatch(self.outline)
        centre = (self.com - patch.centroid)[None]
        return float(patch.friction_radius(centre, np.ones(1))[0])

    @cached_property
    def coarse(self) -> Array:
        """Outline (V, 2) with so few vertices that two parts at once are predicted in time, m."""
        return _simplified(self.outline, _FEW_CORNERS)

    @cached_property
    def edges(self) -> tuple[Array, Array, Array]:
        """Start (V, 2), way (V, 2) and length (V,) of each edge."""
        way = np.roll(self.outline, -1, axis=0) - self.outline
        return self.outline, way, np.linalg.norm(way, axis=1)

    def at(self, share: Array) -> tuple[Array, Array]:
        """Point (N, 2) and inward normal (N, 2) at shares (N,) of the perimeter, object frame."""
        start, way, length = self.edges
        ends = np.cumsum(length)
        along = np.mod(share, 1.0) * ends[-1]
        k = np.minimum(np.searchsorted(ends, along, side="right"), len(length) - 1)
        unit = way[k] / length[k, None]
        left = along - (ends[k] - length[k])
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        return start[k] + left[:, None] * unit, normal

    def nearest(self, point: Array) -> tuple[Array, Array, Array]:
        """Nearest point (N, 2) of the outline, distance (N,) and inward normal (N, 2) of points.

        Points are taken to lie outside, as the middle of a tip does.
        """
        start, way, length = self.edges
        arm = point[:, None] - start
        along = arm[..., 0] * way[:, 0] + arm[..., 1] * way[:, 1]
        share = np.clip(along / np.square(length), 0.0, 1.0)
        gap = arm - share[:, :, None] * way
        squared = gap[..., 0] ** 2 + gap[..., 1] ** 2
        k = squared.argmin(axis=1)
        rows = np.arange(len(point))
        distance = np.sqrt(squared[rows, k])
        inward = np.stack([-way[k, 1], way[k, 0]], axis=1) / length[k, None]
        outward = gap[rows, k]
        normal = np.where(
            distance[:, None] > 1e-6, -outward / np.maximum(distance, 1e-6)[:, None], inward
        )
        return point - outward, distance, normal


def _simplified(outline: Array, most: int = _MOST_CORNERS) -> Array:
    """Drop the vertices that matter least (Visvalingam and Whyatt 1993) until few are left."""
    while len(outline) > most:
        before, after = np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0)
        one, two = outline - before, after - before
        loss = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
        outline = np.delete(outline, loss.argmin(), axis=0)
    return outline


def pushed(body: PushedBody, pose: Array, tip: Array, way: Array) -> tuple[Array, Array]:
    """Poses (N, 3) and tips (N, 2) after the tips moved by short ways (N, 2).

    The tip's radius is kept free by the motion that the limit surface's ellipsoid allows; a tip
    that would only slide along moves nothing.

    Args:
        body: that is pushed.
        pose: (N, 3) x, y, yaw of the object's frame.
        tip: (N, 2) m, middle of the tip.
        way: (N, 2) m.
    """
    tip = tip + way
    local = in_frame(tip, pose)
    near, distance, normal = body.nearest(local)
    depth = body.tip_radius - distance
    inward = turned(normal, pose[:, 2])
    along = way - np.sum(way * inward, axis=1)[:, None] * inward
    wanted = along + np.maximum(depth, 0.0)[:, None] * inward
    count = len(pose)
    twist = pushed_twist(
        turned(near - body.com, pose[:, 2]),
        inward,
        wanted,
        np.full(count, body.radius),
        np.full(count, body.tip_friction),
    )
    twist = np.where((depth > 0.0)[:, None], twist, 0.0)
    return moved(body, pose, twist), tip


def moved(body: PushedBody, pose: Array, twist: Array) -> Array:
    """Poses (N, 3) after displacements (N, 3) of the centre of friction."""
    com = np.broadcast_to(body.com, (len(pose), 2))
    centre = placed(com, pose) + twist[:, :2]
    yaw = pose[:, 2] + twist[:, 2]
    return np.column_stack([centre - turned(com, yaw), yaw])
