"""Two outlines beside each other: where they meet, what room they leave, which is touched."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.mechanics.linkage import turned

Array = NDArray[np.float64]

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
