"""Readings of angles: degrees that were taken as radians, and radians taken as degrees."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.conventions.reading import Reading, rotation_at, with_pose
from tactile_dynamics_ros.core.streams.streams import Streams, nearest_samples, on_lines

_ORDERS = {"xyz": "roll, pitch, yaw", "XYZ": "angles about x, y, z"}
"""Orders of three angles that people use: about fixed axes, about the axes of the body. Tait-Bryan
angles in other orders are not found; each order more costs a reading to be weighed."""
_TURN = 2.0 * np.pi
"""A full turn, rad: angles behind a rotation are known but for multiples of it. A constant of
nature; no other value continues angles from sample to sample."""
_MOST_TURNS = 29
"""Full turns by which a degree that was taken as a radian may be off, either way: 180 degrees over
2 pi. Fewer miss recordings that are turned far; more cost time in proportion and try angles that no
tracker reports."""
_HEADINGS = (0, 1, -1, 2, -2, 3, -3)
"""Turns of the heading, 6.3 deg each, that are tried about the one that forces and accelerations
show: their angle is known to some 10 deg, since the centre of mass is accelerated otherwise. Three
on either side reach 19 deg; fewer miss the right heading of a recording whose accelerations are
noisy, more cost a reading each to be weighed."""
_SPARSE = 24
"""Instants at which the turns of roll and pitch are tried against the direction of the forces: two
angles of 24 directions are overdetermined ten times. Fewer let noise or one finger's slip choose
the turn; more cost time in proportion, for each of up to two thousand pairs of turns."""


def angle_readings(carried: bool) -> list[Reading]:
    """Readings of the angles behind the rotations of the object.

    Args:
        carried: whether contacts were put into the world by these rotations.
    """
    found = []
    where = "of contacts too" if carried else "contacts are right as they are"
    for order, words in _ORDERS.items():
        text = f"{words} are in radians, and were taken as degrees ({where})"
        small = partial(_larger, carried=carried, order=order)
        found.append(Reading("angle_unit", text, small))
    text = f"rotation vectors are in radians, and were taken as degrees ({where})"
    found.append(Reading("angle_unit", text, partial(_larger_vectors, carried=carried)))
    if carried:
        text = f"{_ORDERS['xyz']} are in degrees, and were taken as radians ({where})"
        paths = _Paths("xyz")
        found += [
            Reading("angle_unit", text, partial(_smaller, paths=paths, heading=heading))
            for heading in _HEADINGS
        ]
        text = f"rotation vectors are in degrees, and were taken as radians ({where})"
        found.append(Reading("angle_unit", text, _smaller_vectors))
    return found


def _larger(streams: Streams, carried: bool, order: str) -> Streams:
    pose = streams.pose
    assert pose is not None
    angles = np.degrees(Rotation.from_matrix(pose.rotation).as_euler(order))
    rotation = Rotation.from_euler(order, angles).as_matrix()
    return with_pose(streams, replace(pose, rotation=rotation), carried)


class _Paths:
    """Angles in degrees behind rotations that took them as radians, found once per pose."""

    def __init__(self, order: str) -> None:
        self._order = order
        self._known: tuple[object, Array, float] | None = None

    def rotation(self, streams: Streams, heading: int) -> Array:
        """Rotations (N, 3, 3), the heading off by so many turns from that of the acceleration."""
        if self._known is None or self._known[0] is not streams.pose:
            assert streams.pose is not None
            angles = continuous(streams.pose.rotation, self._order)
            angles = _with_turns(streams, angles, self._order)
            upright = Rotation.from_euler(self._order, np.radians(angles)).as_matrix()
            self._known = streams.pose, upright, _heading(streams, upright)
        _, upright, found = self._known
        turn = np.radians(_TURN) * (np.round(found / np.radians(_TURN)) + heading)
        return np.asarray(Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix() @ upright)


def _smaller(streams: Streams, paths: _Paths, heading: int) -> Streams:
    pose = streams.pose
    assert pose is not None
    return with_pose(streams, replace(pose, rotation=paths.rotation(streams, heading)), True)


def _heading(streams: Streams, rotation: Array) -> float:
    """Angle, rad, about the vertical by which horizontal forces lag behind the accelerations."""
    pose = streams.pose
    assert pose is not None
    force, time = net_body_force(streams)
    turned = Rotation.from_matrix(rotation)[nearest_samples(pose.time, time)].apply(force)
    position = on_lines(pose.time, pose.position, time)
    rate = np.gradient(position, time, axis=0)
    change = np.gradient(rate, time, axis=0)
    pushed, moved = (v[:, 0] + 1j * v[:, 1] for v in (turned, change))
    return float(np.angle(np.sum((moved - moved.mean()) * np.conj(pushed - pushed.mean()))))


def _larger_vectors(streams: Streams, carried: bool) -> Streams:
    pose = streams.pose
    assert pose is not None
    vectors = np.degrees(Rotation.from_matrix(pose.rotation).as_rotvec())
    rotation = Rotation.from_rotvec(vectors).as_matrix()
    return with_pose(streams, replace(pose, rotation=rotation), carried)


def continuous(rotation: Array, order: str) -> Array:
    """Angles (N, 3) of rotations (N, 3, 3), each the nearest to the path of the two before.

    Every rotation has two triples of angles in (-pi, pi], and whole turns are free. Turns by more
    than half of one from sample to sample would show as a turn of the other sense each time: on
    the whole angles go as far as they come, so that the drift that this makes is taken out.
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
    steps = np.arange(len(angles))[:, None]
    per_step = np.round((angles[-1] - angles[0]) / (_TURN * max(len(angles) - 1, 1)))
    return np.asarray(angles - _TURN * per_step * steps)


def _with_turns(streams: Streams, angles: Array, order: str) -> Array:
    """Angles (N, 3) in degrees plus the whole turns, taken as radians, that the forces ask for.

    Roll and pitch decide where gravity points in the body: their turns, and which of the two
    triples of angles it was, are those whose gravity is most like the sum of the forces. The turn
    of the yaw, of which gravity says nothing, is the one nearest to none.

    Raises:
        BadInputError: no turns bring the angles to where degrees are.
    """
    other = angles * np.array([1.0, -1.0, 1.0]) + np.pi
    found = [_turns_of_gravity(streams, path, order) for path in (angles, other)]
    return min(found, key=lambda pair: pair[1])[0]


def _turns_of_gravity(streams: Streams, angles: Array, order: str) -> tuple[Array, float]:
    """Angles (N, 3) with the best turns, and what of the forces their gravity leaves."""
    pose = streams.pose
    assert pose is not None
    aim, rows = _sparse_forces(streams, pose.time)
    turns = np.arange(-_MOST_TURNS, _MOST_TURNS + 1)
    middle = np.median(angles, axis=0)
    first = [k for k in turns if abs(middle[0] + _TURN * k) < 200.0]
    second = [k for k in turns if abs(middle[1] + _TURN * k) < 100.0]
    if not first or not second:
        raise BadInputError("angles do not follow each other as degrees would")
    grid = np.array(list(product(first, second)), dtype=float)
    shifted = np.radians(angles[rows][None] + _TURN * np.pad(grid, ((0, 0), (0, 1)))[:, None])
    turned = Rotation.from_euler(order, shifted.reshape(-1, 3)).as_matrix()
    left = _unlike(turned.reshape(len(grid), len(rows), 3, 3)[..., 2, :], aim)
    best = int(np.argmin(left))
    yaw = -np.round(middle[2] / _TURN)
    return np.asarray(angles + _TURN * np.array([*grid[best], yaw])), float(left[best])


def _sparse_forces(streams: Streams, stamps: Array) -> tuple[Array, NDArray[np.intp]]:
    """Changes (n, 3) of the sum of the forces in body axes at a few instants, and their poses."""
    force, time = net_body_force(streams)
    at = np.linspace(0, len(time) - 1, _SPARSE).astype(int)
    rows = np.clip(np.searchsorted(stamps, time[at]), 0, len(stamps) - 1)
    return force[at] - force[at].mean(axis=0), rows


def _unlike(up: Array, aim: Array) -> Array:
    """Square (g,) that a positive multiple of directions (g, n, 3) leaves of forces (n, 3)."""
    centred = up - up.mean(axis=1, keepdims=True)
    size = np.maximum(np.sum(centred**2, axis=(1, 2)), 1e-12)
    slope = np.einsum("gnk,nk->g", centred, aim) / size
    left = np.sum((aim - slope[:, None, None] * centred) ** 2, axis=(1, 2))
    return np.asarray(np.where(slope > 0.0, left, np.inf))


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
    aim, rows = _sparse_forces(streams, pose.time)
    vectors = Rotation.from_matrix(pose.rotation).as_rotvec()
    paths = _continuous_vectors(vectors, np.arange(-_MOST_TURNS, _MOST_TURNS + 1))
    turned = [Rotation.from_rotvec(np.radians(path[rows])).as_matrix() for path in paths]
    best = paths[int(np.argmin(_unlike(np.array(turned)[..., 2, :], aim)))]
    rotation = Rotation.from_rotvec(np.radians(best)).as_matrix()
    return with_pose(streams, replace(pose, rotation=rotation), True)


def _continuous_vectors(vectors: Array, turns: NDArray[np.intp]) -> Array:
    """Rotation vectors (g, N, 3) that follow each other; the first with g whole turns more."""
    length = np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)
    axes = vectors / length[:, None]
    found = np.tile(vectors, (len(turns), 1, 1))
    found[:, 0] += _TURN * turns[:, None] * axes[0]
    for k in range(1, len(vectors)):
        ahead = 2.0 * found[:, k - 1] - found[:, k - 2] if k > 1 else found[:, 0]
        turned = np.round((ahead @ axes[k] - length[k]) / _TURN)
        found[:, k] = (length[k] + _TURN * turned)[:, None] * axes[k]
    return found
