"""One-step innovations of poses: what each pose says beyond those before and the forces.

A latent motion absorbs the noise of its poses, so that residuals of its fit are neither white nor
of unit variance. The innovations of a Kalman filter along it are both, if the model is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.diagnosis.rows import PushRows

Array = NDArray[np.float64]
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
        ahead: (b, 3, 3) inverse derivative of the row by the next node.
        carry: (b, 12, 12) from state to state.
        by_local: (b, 3, 3) derivative of the next node by local friction.
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
        order: (J,) poses while the object slides, which are judged, in the order of time.
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
        """Innovations (J, 3, c), white.

        Args:
            motion: (N, 3, c) residuals of dynamics or smoothness around each node, white.
            local: (N, 3, c) what local friction at a node differs from what the one before leaves.
            poses: (M, 3, c) residuals of poses, white.
        """
        state = np.zeros((self._segments, 12, motion.shape[2]))
        first = self.rows.first_node
        state[:, 9:] = -local[first]
        found = np.zeros(poses.shape)
        for step in self._steps:
            at = step.live
            moved = step.carry @ state[at]
            moved[:, 6:9] -= step.ahead @ motion[step.node]
            moved[:, 6:9] -= step.by_local @ local[step.node]
            moved[:, 9:] -= local[step.node]
            for seen in step.measured:
                error = poses[seen.pose] + seen.looks @ moved[seen.which]
                found[seen.pose] = seen.root @ error
                moved[seen.which] -= seen.gain @ error
            state[at] = moved
        return found[self.order]


class _Builder:
    """Covariances of the filter."""

    def __init__(self, rows: PushRows) -> None:
        self._rows = rows
        count = len(rows.motion_by_nodes)
        self._ends = np.append(rows.first_node[1:], count)
        self._length = self._ends - rows.first_node
        self._poses_of = _group(rows.pose_middle, count)

    def built(self) -> Innovations:
        rows = self._rows
        segments = len(rows.first_node)
        covariance = np.zeros((segments, 12, 12))
        wide = np.square(_DIFFUSE * rows.pose_std)
        diffuse = np.concatenate([np.zeros(3), wide, wide, np.full(3, rows.variation**2)])
        covariance[:] = np.diag(diffuse)
        steps, volume, judged = [], 0.0, []
        for k in range(1, int(self._length.max()) - 1):
            live = np.flatnonzero(self._length - 1 > k)
            node = rows.first_node[live] + k
            step, covariance[live] = self._predicted(live, node, covariance[live])
            measured, covariance[live] = self._corrected(node, covariance[live])
            if k > _UNJUDGED:
                counts = [rows.judged[node[seen.which]] for seen in measured]
                judged += [seen.pose[c] for seen, c in zip(measured, counts, strict=True)]
                volume -= sum(_log(seen.root[c]) for seen, c in zip(measured, counts, strict=True))
            steps.append(_Step(live, node, *step, measured))
        order = np.sort(np.concatenate(judged)) if judged else np.zeros(0, dtype=np.intp)
        return Innovations(rows, order, volume, tuple(steps), segments)

    def _predicted(
        self, live: Index, node: Index, covariance: Array
    ) -> tuple[tuple[Array, Array, Array], Array]:
        """From (before, here, next, local) at one node to the same at the following one.

        The state holds nodes k-2, k-1, k and the local friction of k-1 before, and k-1, k, k+1 and
        that of k after.
        """
        rows = self._rows
        by = rows.motion_by_nodes[node]
        ahead: Array = np.linalg.inv(by[:, :, 2, :3]).astype(np.float64)
        keep, std = rows.keep[node], rows.local_std[node]
        carry = np.zeros((len(live), 12, 12))
        carry[:, :3, 3:6] = carry[:, 3:6, 6:9] = np.eye(3)
        carry[:, 9:, 9:] = keep[:, None, None] * np.eye(3)
        carry[:, 6:9, 3:6] = -ahead @ by[:, :, 0, :3]
        carry[:, 6:9, 6:9] = -ahead @ by[:, :, 1, :3]
        by_local: Array = np.asarray(-ahead @ by[:, :, 1, 3:])
        carry[:, 6:9, 9:] = keep[:, None, None] * by_local
        noise = np.zeros((len(live), 12, 12))
        noise[:, 6:9, 6:9] = ahead @ ahead.swapaxes(1, 2)
        spread = np.square(std)[:, None, None]
        noise[:, 9:, 9:] = spread * np.eye(3)
        noise[:, 6:9, 9:] = spread * by_local
        noise[:, 9:, 6:9] = spread * by_local.swapaxes(1, 2)
        noise[:, 6:9, 6:9] += spread * by_local @ by_local.swapaxes(1, 2)
        after = carry @ covariance @ carry.swapaxes(1, 2) + noise
        return (ahead, carry, by_local), after

    def _corrected(self, node: Index, covariance: Array) -> tuple[tuple[_Measured, ...], Array]:
        rows = self._rows
        measured = []
        rounds = max((len(self._poses_of[n]) for n in node), default=0)
        for turn in range(rounds):
            which = np.array([i for i, n in enumerate(node) if len(self._poses_of[n]) > turn])
            pose = np.array([self._poses_of[node[i]][turn] for i in which], dtype=np.intp)
            looks = np.zeros((len(which), 3, 12))
            for axis in range(3):
                looks[:, axis, [axis, axis + 3, axis + 6]] = (
                    rows.pose_weights[pose] / rows.pose_std[axis]
                )
            there = covariance[which]
            across = there @ looks.swapaxes(1, 2)
            root = np.linalg.cholesky(looks @ across + np.eye(3))
            inverse = np.linalg.inv(root)
            half = across @ inverse.swapaxes(1, 2)
            left = there - half @ half.swapaxes(1, 2)
            covariance[which] = 0.5 * (left + left.swapaxes(1, 2))
            measured.append(_Measured(which, pose, looks, half @ inverse, inverse))
        return tuple(measured), covariance


def _log(root: Array) -> float:
    """Sum of ln det of triangular matrices (b, 3, 3)."""
    return float(np.sum(np.log(np.diagonal(root, axis1=1, axis2=2))))


def _group(middle: Index, count: int) -> list[Index]:
    """Poses of each node."""
    order = np.argsort(middle, kind="stable")
    edges = np.searchsorted(middle[order], np.arange(count + 1))
    return [order[edges[n] : edges[n + 1]] for n in range(count)]
