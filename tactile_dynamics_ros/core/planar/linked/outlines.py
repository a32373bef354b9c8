"""Two outlines beside each other, and how one moves in the frame of the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.streams import LinkStream

_SPACING = 2e-3
"""Distance between points of an outline, m: as fine as outlines are known."""
_NEAR = 2e-3
"""By how much more than the least distance outlines may be apart where they meet, m: what outlines
are off by. Larger takes round parts for flat ones."""
_TURN = np.radians(10.0)
"""Turn that a joint must leave room for, rad: less than pushes turn joints by; at 2 degrees flat
faces of 4 cm would pass within the outlines' errors."""
_OVERLAP = 1e-3
"""Overlap that outlines may have after the turn, m, beyond that before: what they are off by."""


def dense_outline(outline: Array) -> Array:
    """(P, 2) m, points along the edges."""
    parts = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / _SPACING)))
        parts.append(start + (end - start) * (np.arange(count) / count)[:, None])
    return np.concatenate(parts)


def distance_outside(outline: Array, points: Array) -> Array:
    """Distance (N,) m of points (N, 2) from an outline, negative inside."""
    edge = np.roll(outline, -1, axis=0) - outline
    away = points[:, None] - outline
    share = np.einsum("nvi,vi->nv", away, edge) / np.maximum(np.sum(edge * edge, axis=1), 1e-18)
    near = away - np.clip(share, 0.0, 1.0)[..., None] * edge
    distance = np.linalg.norm(near, axis=2).min(axis=1)
    after = np.roll(outline, -1, axis=0)
    above = outline[:, 1] > points[:, 1:]
    crosses = above != (after[:, 1] > points[:, 1:])
    rise = np.where(np.abs(edge[:, 1]) > 1e-15, edge[:, 1], 1e-15)
    x = outline[:, 0] + (points[:, 1:] - outline[:, 1]) / rise * edge[:, 0]
    inside = np.sum(crosses & (points[:, :1] < x), axis=1) % 2 == 1
    return np.asarray(np.where(inside, -distance, distance))


def meeting_points(first: Array, second: Array, offset: Array) -> Array:
    """Points (K, 2) between two outlines where they are nearest, in the first one's frame.

    Args:
        first: (V, 2) m, in its own frame.
        second: (V, 2) m, likewise.
        offset: (3,) pose of the second one in the first one's frame.
    """
    placed = offset[:2] + turned(second, np.full(len(second), offset[2]))
    points = dense_outline(placed)
    gap = np.linalg.norm(points[:, None] - dense_outline(first), axis=2)
    nearest = gap.argmin(axis=1)
    distance = gap.min(axis=1)
    close = distance <= distance.min() + _NEAR
    return np.asarray(0.5 * (points[close] + dense_outline(first)[nearest[close]]))


def room_to_turn(first: Array, second: Array, offset: Array) -> float:
    """Share of the places where outlines meet, and of both senses, in which one can turn."""
    placed = offset[:2] + turned(second, np.full(len(second), offset[2]))
    points = dense_outline(placed)
    before = max(0.0, -float(distance_outside(first, points).min()))
    places = meeting_points(first, second, offset)
    places = places[:: max(1, len(places) // 12)]
    free = []
    for place in places:
        for angle in (-_TURN, _TURN):
            moved = place + turned(points - place, np.full(len(points), angle))
            overlap = max(0.0, -float(distance_outside(first, moved).min()))
            free.append(overlap <= before + _OVERLAP)
    return float(np.mean(free))


def touched_part(outlines: tuple[Array, Array], poses: tuple[Array, Array], point: Array) -> Array:
    """Which part (N,) a point is nearest to, 0 or 1.

    Args:
        outlines: (V, 2) m, each in its own frame.
        poses: (N, 3) of each.
        point: (N, 2) m on the support.
    """
    away = [
        distance_outside(outline, turned(point - pose[:, :2], -pose[:, 2]))
        for outline, pose in zip(outlines, poses, strict=True)
    ]
    return np.asarray((away[1] < away[0]).astype(np.float64))


def in_second(place: Array, offset: Array) -> Array:
    """A place (2,) of the first part's frame in the second one's."""
    return np.asarray(turned((place - offset[:2])[None], -offset[2:])[0])


_BIN, _MOST_BINS = 0.05, 160
"""Shortest time, s, over which relative poses are averaged, and how many bins there are at most: a
joint that pushes turn moves for a second. Longer bins blur a turn, more bins only cost time."""
_LASTING = (1e-4, 1e-4, 1e-3)
"""What relative poses are off by for a while, m, m, rad: a fifth of a tracker's white noise. With
none, a drift of a tenth of a millimetre in a tracker would count as a loose part."""
_CREEP = 1e-4
"""Travel that is counted for every bin, m, as noise hides it: parts move beside each other where
they are pushed, seldom where they rest. A tenth of it makes a slip at rest incredible."""


@dataclass(frozen=True, eq=False)
class RelativePoses:
    """Mean poses (B, 3) of the second part in the first one's frame: m, m, rad.

    Attributes:
        time: (B,) s. value: (B, 3). covariance: (B, 3, 3). noise: measured over stated noise.
        travel: (B - 1,) share of all travel of both parts from each to the next.
    """

    time: Array
    value: Array
    covariance: Array
    noise: float
    travel: Array

    @classmethod
    def of_links(cls, first: LinkStream, second: LinkStream) -> RelativePoses:
        """From poses of both parts, the first one's interpolated to the times of the second."""
        inside = (second.time >= first.time[0]) & (second.time <= first.time[-1])
        time, seen = second.time[inside], second.pose[inside]
        base = np.stack([np.interp(time, first.time, column) for column in first.pose.T], axis=1)
        apart = turned(seen[:, :2] - base[:, :2], -base[:, 2])
        value = np.column_stack([apart, seen[:, 2] - base[:, 2]])
        covariance = _covariance(apart, first.presumed_pose_std, second.presumed_pose_std)
        noise = _noise(value, covariance)
        step = max(_BIN, float(time[-1] - time[0]) / _MOST_BINS)
        index = np.floor((time - time[0]) / step).astype(np.intp)
        _, index, count = np.unique(index, return_inverse=True, return_counts=True)
        share = 1.0 / count[:, None]

        def mean(values: Array) -> Array:
            columns = values.reshape(len(values), -1).T
            sums = np.stack([np.bincount(index, column) for column in columns], axis=1)
            return np.asarray((sums * share).reshape(-1, *values.shape[1:]))

        lasting = np.diag(np.square(_LASTING))
        spread = mean(covariance) * (noise**2 * share)[:, :, None] + lasting
        moved = np.diff(mean(np.column_stack([base[:, :2], seen[:, :2]])), axis=0)
        travel = np.linalg.norm(moved, axis=1) + _CREEP
        return cls(mean(time[:, None])[:, 0], mean(value), spread, noise, travel / travel.sum())


def _covariance(apart: Array, first: Array, second: Array) -> Array:
    """(N, 3, 3) of relative poses; the first one's yaw moves the second one across."""
    across = np.stack([-apart[:, 1], apart[:, 0], np.ones(len(apart))], axis=1)
    linear = np.mean(np.square(first[:2])) + np.mean(np.square(second[:2]))
    own = np.diag([linear, linear, float(second[2]) ** 2])
    return np.asarray(own + first[2] ** 2 * across[:, :, None] * across[:, None, :])


def _noise(value: Array, covariance: Array) -> float:
    """Noise of second differences over the stated one, at least 1."""
    if len(value) < 20:
        return 1.0
    curve = np.abs(value[:-2] - 2.0 * value[1:-1] + value[2:])
    stated = np.sqrt(6.0 * np.diagonal(covariance, axis1=1, axis2=2)[1:-1])
    return max(1.0, float(np.median(1.4826 * np.median(curve / stated, axis=0))))
