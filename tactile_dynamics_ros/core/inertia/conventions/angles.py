"""Readings of angles: degrees that were taken as radians, and radians taken as degrees."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.inertia.conventions.reading import Reading, rotation_at, with_pose
from tactile_dynamics_ros.core.streams.streams import Streams

Array = NDArray[np.float64]

_ORDERS = {"xyz": "roll, pitch, yaw", "XYZ": "angles about x, y, z"}
"""Orders of three angles that people use: about fixed axes, about the axes of the body."""
_TURN = 2.0 * np.pi
"""A full turn, rad."""
_MOST_TURNS = 29
"""Full turns by which a degree that was taken as a radian may be off: 180 over 2 pi."""
_SPARSE = 24
"""Instants at which the turns of roll and pitch are tried against the direction of the forces."""
_CANDIDATES = 6
"""Pairs of turns of roll and pitch that are tried with all turns of the yaw."""


def angle_readings(carried: bool) -> list[Reading]:
    """Readings of the angles behind the rotations of the object.

    Args:
        carried: whether contacts were put into the world by these rotations.
    """
    found = []
    where = "of contacts too" if carried else "contacts are right as they are"
    for order, words in _ORDERS.items():
        text = f"{words} are in radians, and were taken as degrees ({where})"
        small = partial(_read, carried=carried, order=order, degrees=False)
        found.append(Reading("angle_unit", text, small))
    text = f"rotation vectors are in radians, and were taken as degrees ({where})"
    found.append(Reading("angle_unit", text, partial(_larger_vectors, carried=carried)))
    if carried:
        for order, words in _ORDERS.items():
            text = f"{words} are in degrees, and were taken as radians ({where})"
            large = partial(_read, carried=carried, order=order, degrees=True)
            found.append(Reading("angle_unit", text, large))
        text = f"rotation vectors are in degrees, and were taken as radians ({where})"
        found.append(Reading("angle_unit", text, _smaller_vectors))
    return found


def _read(streams: Streams, carried: bool, order: str, degrees: bool) -> Streams:
    pose = streams.pose
    assert pose is not None
    if degrees:
        angles = np.radians(_with_turns(streams, continuous(pose.rotation, order), order))
    else:
        angles = np.degrees(Rotation.from_matrix(pose.rotation).as_euler(order))
    rotation = Rotation.from_euler(order, angles).as_matrix()
    return with_pose(streams, replace(pose, rotation=rotation), carried)


def _larger_vectors(streams: Streams, carried: bool) -> Streams:
    pose = streams.pose
    assert pose is not None
    vectors = np.degrees(Rotation.from_matrix(pose.rotation).as_rotvec())
    rotation = Rotation.from_rotvec(vectors).as_matrix()
    return with_pose(streams, replace(pose, rotation=rotation), carried)


def continuous(rotation: Array, order: str) -> Array:
    """Angles (N, 3) of rotations (N, 3, 3), each the nearest to the path of the two before.

    Every rotation has two triples of angles in (-pi, pi], and whole turns are free.
    """
    first: Array = Rotation.from_matrix(rotation).as_euler(order)
    other = first * np.array([1.0, -1.0, 1.0]) + np.pi
    angles = first.copy()
    for k in range(1, len(angles)):
        ahead = 2.0 * angles[k - 1] - angles[k - 2] if k > 1 else angles[0]
        nearest = [
            triple + _TURN * np.round((ahead - triple) / _TURN) for triple in (first[k], other[k])
        ]
        angles[k] = min(nearest, key=lambda triple: float(np.sum((triple - ahead) ** 2)))
    return angles


def _with_turns(streams: Streams, angles: Array, order: str) -> Array:
    """Angles (N, 3) in degrees plus the whole turns, taken as radians, that the forces ask for.

    Roll and pitch decide where gravity points in the body, the yaw which way the world's
    acceleration does: the turns of the first two are those whose gravity is most like the sum of
    the forces, that of the third is the one with the least rotation on the whole.
    """
    pose = streams.pose
    assert pose is not None
    force, time = net_body_force(streams)
    at = np.linspace(0, len(time) - 1, _SPARSE).astype(int)
    rows = np.clip(np.searchsorted(pose.time, time[at]), 0, len(pose.time) - 1)
    wanted = force[at] / max(float(np.linalg.norm(force[at])), 1e-12)
    turns = np.arange(-_MOST_TURNS, _MOST_TURNS + 1)
    middle = np.median(angles, axis=0)
    first = [k for k in turns if abs(middle[0] + _TURN * k) < 200.0]
    second = [k for k in turns if abs(middle[1] + _TURN * k) < 100.0]
    grid = np.array(list(product(first, second)), dtype=float)
    shifted = np.radians(angles[rows][None] + _TURN * np.pad(grid, ((0, 0), (0, 1)))[:, None])
    turned = Rotation.from_euler(order, shifted.reshape(-1, 3)).as_matrix()
    up = turned.reshape(len(grid), len(rows), 3, 3)[..., 2, :]
    centred = up - up.mean(axis=1, keepdims=True)
    aim = wanted - wanted.mean(axis=0)
    slope = np.einsum("gnk,nk->g", centred, aim) / np.sum(centred**2, axis=(1, 2))
    left = np.sum((aim - slope[:, None, None] * centred) ** 2, axis=(1, 2))
    left = np.where(slope > 0.0, left, np.inf)
    best = grid[int(np.argmin(left))]
    yaw = -np.round(middle[2] / _TURN)
    return np.asarray(angles + _TURN * np.array([*best, yaw]))


def net_body_force(streams: Streams) -> tuple[Array, Array]:
    """Sum of the forces (N, 3) in body axes, as they were carried, and its stamps (N,)."""
    time = max((c.time for c in streams.contacts.values()), key=len)
    rotation = rotation_at(streams, time)
    total = np.zeros((len(time), 3))
    for contact in streams.contacts.values():
        world = np.stack([np.interp(time, contact.time, f) for f in contact.force.T], axis=1)
        total += np.einsum("nji,nj->ni", rotation, world)
    return total, time


def _smaller_vectors(streams: Streams) -> Streams:
    """Rotation vectors in degrees that were taken as radians.

    The vector of a sample is an axis times an angle plus whole turns: the nearest to the path of
    the two before; the turns of the first are those whose gravity is most like the forces.
    """
    pose = streams.pose
    assert pose is not None
    path = _continuous_vectors(Rotation.from_matrix(pose.rotation).as_rotvec())
    force, time = net_body_force(streams)
    at = np.linspace(0, len(time) - 1, _SPARSE).astype(int)
    rows = np.clip(np.searchsorted(pose.time, time[at]), 0, len(pose.time) - 1)
    aim = force[at] - force[at].mean(axis=0)
    best, least = path, np.inf
    for turns in range(-_MOST_TURNS, _MOST_TURNS + 1):
        moved = _continuous_vectors(Rotation.from_matrix(pose.rotation).as_rotvec(), turns)
        up = Rotation.from_rotvec(np.radians(moved[rows])).as_matrix()[:, 2, :]
        centred = up - up.mean(axis=0)
        slope = float(np.sum(centred * aim) / max(np.sum(centred**2), 1e-12))
        left = float(np.sum((aim - slope * centred) ** 2)) if slope > 0.0 else np.inf
        if left < least:
            best, least = moved, left
    rotation = Rotation.from_rotvec(np.radians(best)).as_matrix()
    return with_pose(streams, replace(pose, rotation=rotation), True)


def _continuous_vectors(vectors: Array, turns: int = 0) -> Array:
    """Rotation vectors (N, 3) that follow each other; the first with whole turns more."""
    length = np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)
    axes = vectors / length[:, None]
    found = vectors.copy()
    found[0] += _TURN * turns * axes[0]
    for k in range(1, len(found)):
        ahead = 2.0 * found[k - 1] - found[k - 2] if k > 1 else found[0]
        along = float(ahead @ axes[k])
        found[k] = axes[k] * (length[k] + _TURN * np.round((along - length[k]) / _TURN))
    return found
