"""Short intervals of a recording, each with its mean force and the place where it acts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.numerics.bordered import Cost, NormalEquations
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

Mask = NDArray[np.bool_]

COARSE = 0.03
"""Time between forces, s, from which accelerations are not resolved: friction turns a slow object
within 10 ms. Mass and friction are then known only as a product; at 15 Hz masses of five steady
recordings came out a quarter too low at a stated tenth, and a filter on `graph` missed those of
six objects by 0.16 instead of 0.12 of their range."""
_SHORTEST = 0.01
"""Shortest interval, s. Poses of 0.5 mm say nothing on accelerations that change faster; half of it
doubles the time of an estimate and changes masses by less than a tenth of their std."""
_TOUCH = 4.0
"""Force from which something is touched, in standard deviations of the force. At 3 one sample in
three hundred of a silent sensor would begin a push."""
_SILENCE = 0.1
"""Time without a touch that parts two pushes, s: an arm needs as long to come back; shorter ones
are bounces."""
_BEND = 24.0
"""The mean of a parabola over an interval differs from its middle by its second difference over 24:
by so much a force that is sampled once may be off. At 1 hard stops tell nothing of the mass."""
_BEFORE, _AFTER = 0.15, 0.4
"""How long before a touch and after a release intervals are kept, s: what slides on at 0.3 m/s with
a coefficient of 0.1 stops after 0.3 s. Longer only costs time."""
_STEADY = (0.05, 0.05, 1.0)
"""Accelerations that the smoothed motion takes for steady, m/s^2 and rad/s^2: a fifth of what an
arm needs to reach 30 mm/s in 0.1 s. Larger ones leave noise in the velocities, of which friction
then has the wrong direction."""
_ROUNDS = 8
"""Rounds of reweighting of the smoothed motion; after six velocities change by less than 1 %."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """N intervals in segments, each around a node of the latent motion.

    Attributes:
        step: s between nodes of a segment. time: (N,) s of the nodes.
        inner: (N,) whether the nodes before and after belong to the same segment.
        force: (N, 3) N, mean over the interval, sum of all contacts.
        force_std: (N, 2) N of its horizontal components.
        expected: (N, 3) N what the force is without its noise, where a model has told it, or the
            force itself.
        facing: (N,) rad, direction of the pusher's axes, or of the contact's normal where those are
            not known.
        point: (N, 3) m where it acts. point_std: (N,) m.
        torque: (N,) N m of all contacts about that point.
        touching: (N,) whether anything is touched.
        measured: (N,) whether the force is known.
        first_node: (S,) first node of each segment.
        poses: per link, what was seen of it.
    """

    step: float
    time: Array
    inner: Mask
    force: Array
    force_std: Array
    expected: Array
    facing: Array
    point: Array
    point_std: Array
    torque: Array
    touching: Mask
    measured: Mask
    first_node: NDArray[np.intp]
    poses: tuple[Poses, ...]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def push_starts(self) -> Array:
        """Times (K,) s at which something is touched after a silence, the first touch included."""
        starts, last = [], -np.inf
        for time in self.time[self.touching]:
            if time - last > _SILENCE:
                starts.append(time)
            last = time
        return np.array(starts)

    @property
    def expected_rate(self) -> Array:
        """Derivative (N, 3) of the expected force, N/s; 0 at the ends of segments."""
        rate = np.zeros_like(self.expected)
        at = np.flatnonzero(self.inner)
        rate[at] = (self.expected[at + 1] - self.expected[at - 1]) / (2.0 * self.step)
        return rate


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses (M, 3) of one link within the segments.

    Attributes:
        time: (M,) s. segment: (M,). value: (M, 3). std: (3,).
    """

    time: Array
    segment: NDArray[np.intp]
    value: Array
    std: Array


@dataclass(frozen=True, eq=False)
class _Gathered:
    force: Array
    variance: Array
    point: Array
    normal: Array
    point_std: float
    torque: Array
    touching: Mask
    measured: Mask


def cut_intervals(streams: PushedStreams) -> Intervals:
    """Return the intervals in which something is touched, or may still slide.

    Contacts without a force or a place are left out: pads that touch nothing have no place.

    Raises:
        BadInputError: there is no contact or link, or never a touch while poses are known.
    """
    kept = {n: c for n, c in streams.contacts.items() if len(c.time) and len(c.pose_time)}
    streams = replace(streams, contacts=kept)
    if not streams.contacts or not streams.links:
        raise BadInputError(
            "a pushed object needs /object/pose, /object/footprint and at least one contact "
            f"with force and pose, found {len(streams.links)} links and {len(kept)} contacts"
        )
    step = _step(streams)
    spans = _spans(streams, step)
    grids: list[Array] = [np.asarray(start + step * np.arange(n), float) for start, n in spans]
    time = np.concatenate(grids)
    inner = np.concatenate([_inner(len(grid)) for grid in grids])
    first = np.cumsum([0, *(len(grid) for grid in grids)])[:-1]
    gathered = [_gather(contact, time, step) for contact in streams.contacts.values()]
    poses = tuple(_poses(link, grids, step) for link in streams.links)
    joined = _joined(gathered, step, time, inner, first.astype(np.intp), poses)
    if streams.pusher_time is None or streams.pusher_yaw is None or not len(streams.pusher_time):
        return joined
    parts = (np.sin(streams.pusher_yaw), np.cos(streams.pusher_yaw))
    sine, cosine = (np.interp(time, streams.pusher_time, part) for part in parts)
    return replace(joined, facing=np.arctan2(sine, cosine))


def _step(streams: PushedStreams) -> float:
    steps = [
        float(np.median(np.diff(contact.time)))
        for contact in streams.contacts.values()
        if len(contact.time) > 1
    ]
    return max(_SHORTEST, *steps) if steps else _SHORTEST


def _touches(contact: PushContact) -> Mask:
    size = np.linalg.norm(contact.force, axis=1)
    return np.asarray(size > _TOUCH * float(np.max(contact.presumed_force_std)))


def _spans(streams: PushedStreams, step: float) -> list[tuple[float, int]]:
    """Start, s, and number of nodes of each segment."""
    touched = np.sort(np.concatenate([c.time[_touches(c)] for c in streams.contacts.values()]))
    seen = [link.time for link in streams.links]
    low, high = max(t[0] for t in seen), min(t[-1] for t in seen)
    touched = touched[(touched >= low) & (touched <= high)]
    if len(touched) == 0:
        raise BadInputError(
            "nothing is touched while poses are known: the forces never exceed "
            f"{_TOUCH:g} standard deviations of their noise; check names and units of the forces"
        )
    gaps = np.flatnonzero(np.diff(touched) > _BEFORE + _AFTER)
    starts, ends = touched[np.append(0, gaps + 1)], touched[np.append(gaps, len(touched) - 1)]
    spans = []
    for start, end in zip(starts, ends, strict=True):
        first, last = max(start - _BEFORE, low), min(end + _AFTER, high)
        count = int(np.floor((last - first) / step)) + 1
        if count >= 5:
            spans.append((float(first), count))
    if not spans:
        raise BadInputError(f"touches are shorter than 5 samples of {step:g} s; push longer")
    return spans


def _inner(count: int) -> Mask:
    inside = np.ones(count, dtype=bool)
    inside[[0, -1]] = False
    return inside


def _gather(contact: PushContact, time: Array, step: float) -> _Gathered:
    """Means of the force in the intervals around nodes, or lines between samples where few are."""
    std = contact.presumed_force_std
    left = np.searchsorted(contact.time, time - 0.5 * step, side="left")
    right = np.searchsorted(contact.time, time + 0.5 * step, side="left")
    count = right - left
    both = (
        contact.force
        if contact.torque is None
        else np.column_stack([contact.force, contact.torque])
    )
    sums = np.concatenate([np.zeros((1, both.shape[1])), np.cumsum(both, axis=0)])
    mean = (sums[right] - sums[left]) / np.maximum(count, 1)[:, None]
    between = np.stack([np.interp(time, contact.time, column) for column in both.T], axis=1)
    value = np.where((count > 1)[:, None], mean, between)
    after = np.clip(np.searchsorted(contact.time, time), 1, len(contact.time) - 1)
    gap = contact.time[after] - contact.time[after - 1]
    known = gap <= 3.0 * max(step, float(np.median(np.diff(contact.time))))
    known &= (time >= contact.time[0] - step) & (time <= contact.time[-1] + step)
    size = np.linalg.norm(value[:, :3], axis=1)
    point, normal = (
        np.stack([np.interp(time, contact.pose_time, column) for column in values.T], axis=1)
        for values in (contact.point, contact.normal[:, :2])
    )
    return _Gathered(
        value[:, :3] * known[:, None],
        std[None, :2] ** 2 / np.maximum(count, 1)[:, None],
        point,
        normal,
        contact.presumed_point_std,
        value[:, 5] * known if contact.torque is not None else np.zeros(len(time)),
        known & (size > _TOUCH * float(np.max(std))),
        known,
    )


def _poses(link: LinkStream, grids: list[Array], step: float) -> Poses:
    parts = [np.flatnonzero((link.time >= grid[0]) & (link.time <= grid[-1])) for grid in grids]
    index = np.concatenate(parts)
    segment = np.repeat(np.arange(len(grids)), [len(part) for part in parts])
    std = link.presumed_pose_std
    return Poses(link.time[index], segment.astype(np.intp), link.pose[index], std)


def _joined(
    gathered: list[_Gathered],
    step: float,
    time: Array,
    inner: Mask,
    first: NDArray[np.intp],
    poses: tuple[Poses, ...],
) -> Intervals:
    """One force at one point; forces of several contacts at their mean, with their torque."""
    size = np.stack([np.linalg.norm(g.force, axis=1) * g.touching for g in gathered])
    total = size.sum(axis=0)
    share = np.where(total > 0.0, size / np.maximum(total, 1e-12), 1.0 / len(gathered))
    point = np.einsum("cn,cni->ni", share, np.stack([g.point for g in gathered]))
    arm = np.stack([g.point - point for g in gathered])
    force = np.stack([g.force for g in gathered])
    torque = np.sum(arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0], axis=0)
    torque += np.sum([g.torque for g in gathered], axis=0)
    total_force = force.sum(axis=0)
    variance = np.sum([g.variance for g in gathered], axis=0)
    spread = np.einsum("cn,c->n", share, [g.point_std for g in gathered])
    normal = np.einsum("cn,cni->ni", share, np.stack([g.normal for g in gathered]))
    return Intervals(
        step=step,
        time=time,
        inner=inner,
        force=total_force,
        force_std=np.sqrt(variance + np.square(_bend(total_force, inner))),
        expected=total_force,
        facing=np.arctan2(normal[:, 1], normal[:, 0]),
        point=point,
        point_std=spread,
        torque=torque,
        touching=np.any([g.touching for g in gathered], axis=0),
        measured=np.all([g.measured for g in gathered], axis=0),
        first_node=first,
        poses=poses,
    )


def _bend(force: Array, inner: Mask) -> Array:
    """By how much (N, 2) a force may differ from its mean over the interval."""
    bend = np.zeros((len(force), 2))
    at = np.flatnonzero(inner)
    bend[at] = force[at - 1, :2] - 2.0 * force[at, :2] + force[at + 1, :2]
    return np.abs(bend) / _BEND


def add_smoothness(equations: Cost, nodes: Array, middle: NDArray[np.intp], spread: Array) -> None:
    """Add second differences of the motion (N, D) around some nodes, with their std (R, D)."""
    weights = np.array([1.0, -2.0, 1.0]) / spread[:, :, None]
    curve = nodes[middle - 1] - 2.0 * nodes[middle] + nodes[middle + 1]
    equations.add_separate(middle, curve / spread, weights)


@dataclass(frozen=True, eq=False)
class Sightings:
    """Where on the spline of a motion each pose was seen.

    Attributes:
        middle: (M,) node nearest to it. weights: (M, 3) of the nodes around. slopes: (M, 3) their
        derivatives by time. inside: (P,) which poses have nodes on both sides.
    """

    middle: NDArray[np.intp]
    weights: Array
    slopes: Array
    inside: Mask

    @classmethod
    def of_poses(cls, cut: Intervals, poses: Poses, delay: float = 0.0) -> Sightings:
        """At the stamps of the poses plus the delay of the forces, s."""
        counts = np.diff(np.append(cut.first_node, len(cut)))
        start = cut.first_node[poses.segment]
        place = (poses.time + delay - cut.time[start]) / cut.step
        nearest = np.clip(np.round(place), 1, counts[poses.segment] - 2).astype(np.intp)
        share = place - nearest
        inside = np.abs(share) <= 1.0
        share = share[inside]
        before, after = 0.5 * (0.5 - share) ** 2, 0.5 * (0.5 + share) ** 2
        weights = np.stack([before, 0.75 - share**2, after], axis=1)
        slopes = np.stack([share - 0.5, -2.0 * share, share + 0.5], axis=1) / cut.step
        return cls((start + nearest)[inside], weights, slopes, inside)

    def near(self, nodes: Array) -> Array:
        """(M, 3, b) of the nodes around."""
        return np.stack([nodes[self.middle + k] for k in (-1, 0, 1)], axis=1)

    def seen(self, nodes: Array) -> Array:
        """(M, b) of the spline."""
        return np.asarray(np.einsum("mk,mki->mi", self.weights, self.near(nodes)))


def smoothed(cut: Intervals, poses: Poses) -> tuple[Array, Array]:
    """Nodes (N, 3) of a motion whose velocity changes little, but for a few moments.

    Also returns the spread (N, 3) of its accelerations, m/s^2 and rad/s^2.
    """
    nodes = np.stack([np.interp(cut.time, poses.time, p) for p in poses.value.T], axis=1)
    middle = np.flatnonzero(cut.inner)
    at = Sightings.of_poses(cut, poses)
    by_nodes = np.zeros((len(at.middle), 3, 3, 3))
    for axis in range(3):
        by_nodes[:, axis, :, axis] = at.weights / poses.std[axis]
    spread = np.tile(_STEADY, (len(cut), 1)) * 10.0
    for _ in range(_ROUNDS):
        equations = NormalEquations(len(nodes), 3, 1)
        residual = (at.seen(nodes) - poses.value[at.inside]) / poses.std
        equations.add(at.middle, residual, by_nodes)
        add_smoothness(equations, nodes, middle, spread[middle] * cut.step**2)
        nodes = nodes + equations.factor(np.full(nodes.shape, 1e-3), np.ones(1)).step()[0]
        curve = nodes[middle - 1] - 2.0 * nodes[middle] + nodes[middle + 1]
        spread[middle] = np.sqrt(0.5 * (np.square(curve / cut.step**2) + np.square(_STEADY)))
    return nodes, spread
