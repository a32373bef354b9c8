"""Rows of a model of pushing at one motion: what the filter of innovations runs on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.properties.latent_model import LatentModel, Sharpness
from tactile_dynamics_ros.core.planar.properties.linked_model import PairModel
from tactile_dynamics_ros.core.planar.properties.push_model import PushModel, see_poses

Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class PushRows:
    """White residuals and derivatives of N nodes and M poses.

    The motion has D coordinates; beside them each node has l numbers of local friction.

    Attributes:
        motion: (N, D) residuals of dynamics, or of smoothness where nothing slides; 0 at the ends.
        motion_by_nodes: (N, D, 3, D + l) derivative by the node before, here and after.
        motion_by_common: (N, D, p).
        keep: (N,) share of local friction that lasts from the node before.
        local: (N, l) what local friction differs from that. local_std: (N,) of the difference.
        unsure: (D,) size of the noise of the coordinates, m and rad.
        first_node: (S,) of each segment.
        judged: (N,) whether the dynamics of the node count.
        variation: relative standard deviation of friction from place to place.
        poses: what was seen.
    """

    motion: Array
    motion_by_nodes: Array
    motion_by_common: Array
    keep: Array
    local: Array
    local_std: Array
    unsure: Array
    first_node: Index
    judged: NDArray[np.bool_]
    variation: float
    poses: PoseRows


@dataclass(frozen=True, eq=False)
class PoseRows:
    """Poses (M,) of all parts, the first part's first, each in the order of time.

    Attributes:
        residual: (M, 3) white. by_nodes: (M, 3, 3, D) derivative by three nodes.
        by_common: (M, 3, p).
        middle: (M,) nodes. time: (M,) s. std: (M, 3) m, m, rad. part: (M,) 0 or 1.
    """

    residual: Array
    by_nodes: Array
    by_common: Array
    middle: Index
    time: Array
    std: Array
    part: Index

    @classmethod
    def joined(cls, parts: list[PoseRows]) -> PoseRows:
        """Poses of one part after those of another."""
        columns = {name: [getattr(p, name) for p in parts] for name in cls.__dataclass_fields__}
        return cls(**{name: np.concatenate(values) for name, values in columns.items()})


def rows_of_one(model: PushModel, nodes: Array, common: Array, sharp: Sharpness) -> PushRows:
    """Rows of one part at a motion and common numbers."""
    seen = see_poses(model.intervals, nodes, float(np.sum(common[model.delayers])))
    poses, count = model.intervals.poses[0], len(seen.residual)
    by_nodes, by_common = np.zeros((count, 3, 3, 3)), np.zeros((count, 3, len(common)))
    for axis in range(3):
        by_nodes[:, axis, :, axis] = seen.at.weights / poses.std[axis]
    by_common[:, :, model.delayers] = seen.slope[..., None]
    rows = PoseRows(
        residual=seen.residual,
        by_nodes=by_nodes,
        by_common=by_common,
        middle=seen.at.middle,
        time=poses.time[seen.at.inside],
        std=np.tile(poses.std, (count, 1)),
        part=np.zeros(count, dtype=np.intp),
    )
    return _rows(model, nodes, common, sharp, rows)


def rows_of_two(model: PairModel, nodes: Array, common: Array, sharp: Sharpness) -> PushRows:
    """Rows of two parts at a motion and common numbers."""
    parts = []
    for part, poses in enumerate(model.intervals.poses):
        seen = model.seen(nodes, common, part)
        parts.append(
            PoseRows(
                residual=seen.residual,
                by_nodes=seen.by_nodes,
                by_common=seen.by_common,
                middle=seen.at.middle,
                time=poses.time[seen.at.inside],
                std=np.tile(model.pose_std(part), (len(seen.residual), 1)),
                part=np.full(len(seen.residual), part, dtype=np.intp),
            )
        )
    return _rows(model, nodes, common, sharp, PoseRows.joined(parts))


def _rows(
    model: LatentModel, nodes: Array, common: Array, sharp: Sharpness, poses: PoseRows
) -> PushRows:
    """Add motion and local friction to poses."""
    cut, size, mask = model.intervals, model.freedoms, model.data.mask
    motion, by_nodes = _smooth(cut, nodes, ~mask & cut.inner, model.data.spread, size)
    by_common = np.zeros((len(nodes), size, len(common)))
    at = model.middle
    motion[at], by_nodes[at], by_common[at] = model.dynamics(nodes, common, sharp)
    keep, std = model.memory(sharp)
    keep, std = np.append(0.0, keep), np.append(sharp.variation, std)
    keep[cut.first_node], std[cut.first_node] = 0.0, sharp.variation
    local = nodes[:, size:].copy()
    local[1:] -= keep[1:, None] * nodes[:-1, size:]
    return PushRows(
        motion=motion,
        motion_by_nodes=by_nodes,
        motion_by_common=by_common,
        keep=keep,
        local=local,
        local_std=std,
        unsure=model.node_scale[:size],
        first_node=cut.first_node,
        judged=mask & cut.inner,
        variation=sharp.variation,
        poses=poses,
    )


def _smooth(
    cut: Intervals, nodes: Array, where: NDArray[np.bool_], spread: Array, size: int
) -> tuple[Array, Array]:
    """Rows (N, D) of second differences of the motion over their std, and (N, D, 3, D + l)."""
    motion, by_nodes = np.zeros((len(nodes), size)), np.zeros((len(nodes), size, 3, nodes.shape[1]))
    middle = np.flatnonzero(where)
    for axis in range(size):
        weights = np.array([1.0, -2.0, 1.0]) / (spread[middle, axis, None] * cut.step**2)
        by_nodes[middle, axis, :, axis] = weights
        near = np.stack([nodes[middle + k, axis] for k in (-1, 0, 1)], axis=1)
        motion[middle, axis] = np.sum(weights * near, axis=1)
    return motion, by_nodes
