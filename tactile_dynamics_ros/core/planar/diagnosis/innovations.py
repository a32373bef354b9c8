"""One-step innovations of poses, and what was going on beside them.

A latent motion absorbs the noise of its poses, so that residuals of its fit are neither white nor
of unit variance. The innovations of a Kalman filter along it are both, if the model is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Residuals
from tactile_dynamics_ros.core.planar.diagnosis.rows import PushRows
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion

_CHANNELS = ("position_x", "position_y", "yaw")
"""What is seen of each part, in the order of the filter's rows."""


def push_conditions(motion: PlanarMotion, force: Array, at: NDArray[np.intp]) -> list[Condition]:
    """Speed, force, place and time at some intervals.

    Args:
        motion: of all intervals that count.
        force: (R,) N, horizontal.
        at: (J,) which of them.
    """
    speed = np.maximum(np.linalg.norm(motion.velocity, axis=1), 1e-9)
    heading = motion.velocity / speed[:, None]
    return [
        Condition("speed", "m/s", motion.speed[at], symbol="v"),
        Condition("force", "N", force[at]),
        Condition("place x", "m", motion.place[at, 0], symbol="x"),
        Condition("place y", "m", motion.place[at, 1], symbol="y"),
        Condition("heading cosine", "", heading[at, 0], cosine_of="the heading from x"),
        Condition("heading sine", "", heading[at, 1], cosine_of="the heading from y"),
        Condition("time", "s", motion.time[at] - motion.time[0], symbol="t"),
    ]


def push_residuals(
    time: Array, white: Array, pose_std: Array, conditions: Sequence[Condition]
) -> Residuals:
    """Residuals for people.

    Args:
        time: (J,) s.
        white: (J, 3 B) innovations of x, y and yaw of B parts.
        pose_std: (J, 3 B) m, m, rad.
        conditions: as of `push_conditions`.
    """
    parts = [""] if white.shape[1] == 3 else ["link_1_", "link_2_"]
    return Residuals(
        time=time,
        white=white,
        physical=white * pose_std,
        channels=tuple(before + channel for before in parts for channel in _CHANNELS),
        units=("m", "m", "rad") * len(parts),
        conditions=tuple(conditions),
        drivers=np.column_stack([c.values for c in (conditions[0], *conditions[4:6])]),
        alone="mass, friction and centre alone",
        about="The model predicts every pose of the object from those before it and from the "
        "forces of the pusher; the residual is what it is off by, over the noise.",
    )


Index = NDArray[np.intp]

_DIFFUSE = 30.0
"""Standard deviation of the first two nodes of a segment, in those of a pose: as good as unknown,
and small enough for double precision. The first poses of a segment are not judged."""
_UNJUDGED = 3
"""Nodes of a segment whose poses only say where the motion begins; with fewer the first innovations
are too small, more lose samples."""


@dataclass(frozen=True, eq=False)
class _Step:
    """One step of all segments that reach it.

    Attributes:
        live: segments. node: (b,) middle nodes.
        ahead: (b, D, D) inverse derivative of the row by the next node.
        carry: (b, 3 D + l, 3 D + l) from state to state.
        by_local: (b, D, l) derivative of the next node by local friction.
        measured: poses of each round, with what the filter does about them.
    """

    live: Index
    node: Index
    ahead: Array
    carry: Array
    by_local: Array
    measured: tuple[_Measured, ...]


@dataclass(frozen=True, eq=False)
class _Measured:
    which: Index
    pose: Index
    looks: Array
    gain: Array
    root: Array


@dataclass(frozen=True, eq=False)
class Innovations:
    """A filter at one linearisation, ready to be applied to residuals and their derivatives.

    Attributes:
        rows: of the model there.
        order: (J, B) poses while the object slides, which are judged, in the order of time: those
            of B parts at one node. What has no fellow there is used and not judged.
        log_volume: sum of ln det of the square roots of their covariances.
    """

    rows: PushRows
    order: Index
    log_volume: float
    _steps: tuple[_Step, ...]
    _segments: int

    @classmethod
    def of(cls, rows: PushRows) -> Innovations:
        """Run the covariances of the filter along all segments at once."""
        return _Builder(rows).built()

    def white(self, motion: Array, local: Array, poses: Array) -> Array:
        """Innovations (J, 3 B, c), white.

        Args:
            motion: (N, D, c) residuals of dynamics or smoothness around each node, white.
            local: (N, l, c) what local friction at a node differs from what the one before leaves.
            poses: (M, 3, c) residuals of poses, white.
        """
        size, more = motion.shape[1], local.shape[1]
        state = np.zeros((self._segments, 3 * size + more, motion.shape[2]))
        first = self.rows.first_node
        state[:, 3 * size :] = -local[first]
        found = np.zeros(poses.shape)
        for step in self._steps:
            at = step.live
            moved = step.carry @ state[at]
            moved[:, 2 * size : 3 * size] -= step.ahead @ motion[step.node]
            moved[:, 2 * size : 3 * size] -= step.by_local @ local[step.node]
            moved[:, 3 * size :] -= local[step.node]
            for seen in step.measured:
                error = poses[seen.pose] + seen.looks @ moved[seen.which]
                found[seen.pose] = seen.root @ error
                moved[seen.which] -= seen.gain @ error
            state[at] = moved
        return found[self.order].reshape(len(self.order), -1, motion.shape[2])


class _Builder:
    """Covariances of the filter."""

    def __init__(self, rows: PushRows) -> None:
        self._rows = rows
        count = len(rows.motion_by_nodes)
        self._ends = np.append(rows.first_node[1:], count)
        self._length = self._ends - rows.first_node
        self._poses_of = _group(rows.poses.middle, count)
        self._size, self._more = len(rows.unsure), rows.local.shape[1]

    def built(self) -> Innovations:
        rows, size = self._rows, self._size
        segments = len(rows.first_node)
        wide = np.square(_DIFFUSE * rows.unsure)
        known = np.full(self._more, rows.variation**2)
        covariance = np.tile(
            np.diag(np.concatenate([np.zeros(size), wide, wide, known])), (segments, 1, 1)
        )
        steps: list[_Step] = []
        volumes, judged = np.zeros(len(rows.poses.time)), [np.zeros(0, dtype=np.intp)]
        for k in range(1, int(self._length.max()) - 1):
            live = np.flatnonzero(self._length - 1 > k)
            node = rows.first_node[live] + k
            step, covariance[live] = self._predicted(live, node, covariance[live])
            measured, covariance[live] = self._corrected(node, covariance[live])
            if k > _UNJUDGED:
                judged += [seen.pose[rows.judged[node[seen.which]]] for seen in measured]
            for seen in measured:
                volumes[seen.pose] = -_logs(seen.root)
            steps.append(_Step(live, node, *step, measured))
        order = _fellows(rows, np.sort(np.concatenate(judged)))
        volume = float(np.sum(volumes[order]))
        return Innovations(rows, order, volume, tuple(steps), segments)

    def _predicted(
        self, live: Index, node: Index, covariance: Array
    ) -> tuple[tuple[Array, Array, Array], Array]:
        """From (before, here, next, local) at one node to the same at the following one.

        The state holds nodes k-2, k-1, k and the local friction of k-1 before, and k-1, k, k+1 and
        that of k after.
        """
        rows, size, states = self._rows, self._size, covariance.shape[1]
        first, second, third = (slice(k * size, (k + 1) * size) for k in range(3))
        last = slice(3 * size, states)
        by = rows.motion_by_nodes[node]
        ahead: Array = np.linalg.inv(by[:, :, 2, :size]).astype(np.float64)
        keep, std = rows.keep[node], rows.local_std[node]
        carry = np.zeros((len(live), states, states))
        carry[:, first, second] = carry[:, second, third] = np.eye(size)
        carry[:, last, last] = keep[:, None, None] * np.eye(self._more)
        carry[:, third, second] = -ahead @ by[:, :, 0, :size]
        carry[:, third, third] = -ahead @ by[:, :, 1, :size]
        by_local: Array = np.asarray(-ahead @ by[:, :, 1, size:])
        carry[:, third, last] = keep[:, None, None] * by_local
        noise = np.zeros_like(carry)
        spread = np.square(std)[:, None, None]
        noise[:, last, last] = spread * np.eye(self._more)
        noise[:, third, last] = spread * by_local
        noise[:, last, third] = spread * by_local.swapaxes(1, 2)
        noise[:, third, third] = ahead @ ahead.swapaxes(1, 2)
        noise[:, third, third] += spread * by_local @ by_local.swapaxes(1, 2)
        after = carry @ covariance @ carry.swapaxes(1, 2) + noise
        return (ahead, carry, by_local), after

    def _corrected(self, node: Index, covariance: Array) -> tuple[tuple[_Measured, ...], Array]:
        size, poses = self._size, self._rows.poses
        measured = []
        rounds = max((len(self._poses_of[n]) for n in node), default=0)
        for turn in range(rounds):
            which = np.array([i for i, n in enumerate(node) if len(self._poses_of[n]) > turn])
            pose = np.array([self._poses_of[node[i]][turn] for i in which], dtype=np.intp)
            looks = np.zeros((len(which), 3, covariance.shape[1]))
            looks[:, :, : 3 * size] = poses.by_nodes[pose].reshape(len(which), 3, 3 * size)
            there = covariance[which]
            across = there @ looks.swapaxes(1, 2)
            root = np.linalg.cholesky(looks @ across + np.eye(3))
            inverse = np.linalg.inv(root)
            half = across @ inverse.swapaxes(1, 2)
            left = there - half @ half.swapaxes(1, 2)
            covariance[which] = 0.5 * (left + left.swapaxes(1, 2))
            measured.append(_Measured(which, pose, looks, half @ inverse, inverse))
        return tuple(measured), covariance


def _fellows(rows: PushRows, judged: Index) -> Index:
    """(J, B) poses of all parts at one node, of poses that are judged; one of each part."""
    middle, parts = rows.poses.middle, rows.poses.part[judged]
    if not np.any(rows.poses.part):
        return judged[:, None]
    seen = [judged[parts == part] for part in (0, 1)]
    nodes = np.intersect1d(middle[seen[0]], middle[seen[1]])
    return np.stack([poses[np.searchsorted(middle[poses], nodes)] for poses in seen], axis=1)


def _logs(root: Array) -> Array:
    """(b,) sum of ln det of triangular matrices (b, 3, 3)."""
    return np.asarray(np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1))


def _group(middle: Index, count: int) -> list[Index]:
    """Poses of each node."""
    order = np.argsort(middle, kind="stable")
    edges = np.searchsorted(middle[order], np.arange(count + 1))
    return [order[edges[n] : edges[n + 1]] for n in range(count)]
