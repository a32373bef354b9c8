"""Rows of a model of pushing at one motion: what the filter of innovations runs on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.properties.balance import NAMES
from tactile_dynamics_ros.core.planar.properties.push_model import (
    PushModel,
    Sharpness,
    see_poses,
)

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class PushRows:
    """White residuals and derivatives of N nodes and M poses.

    Attributes:
        motion: (N, 3) residuals of dynamics, or of smoothness where nothing slides; 0 at the ends.
        motion_by_nodes: (N, 3, 3, 6) derivative by the node before, here and after.
        motion_by_common: (N, 3, p).
        keep: (N,) share of local friction that lasts from the node before.
        local: (N, 3) what local friction differs from that. local_std: (N,) of the difference.
        pose: (M, 3) residuals. pose_by_delay: (M, 3). pose_weights: (M, 3) of three nodes.
        pose_middle: (M,) nodes. pose_time: (M,) s. pose_std: (3,) m, m, rad.
        first_node: (S,) of each segment.
        judged: (N,) whether the dynamics of the node count.
        variation: relative standard deviation of friction from place to place.
    """

    motion: Array
    motion_by_nodes: Array
    motion_by_common: Array
    keep: Array
    local: Array
    local_std: Array
    pose: Array
    pose_by_delay: Array
    pose_weights: Array
    pose_middle: Index
    pose_time: Array
    pose_std: Array
    first_node: Index
    judged: NDArray[np.bool_]
    variation: float


def linear_rows(model: PushModel, nodes: Array, common: Array, sharp: Sharpness) -> PushRows:
    """Rows at a motion and common numbers."""
    cut, count = model.intervals, len(nodes)
    motion, by_nodes = np.zeros((count, 3)), np.zeros((count, 3, 3, 6))
    by_common = np.zeros((count, 3, len(common)))
    inner = np.flatnonzero(~model.mask & cut.inner)
    _smooth(motion, by_nodes, nodes, inner, model.spread[inner] * cut.step**2)
    at = model.middle
    motion[at], by_nodes[at], by_common[at] = model.dynamics(nodes, common, sharp)
    keep, std = model.memory(sharp)
    keep, std = np.append(0.0, keep), np.append(sharp.variation, std)
    keep[cut.first_node], std[cut.first_node] = 0.0, sharp.variation
    local = nodes[:, 3:].copy()
    local[1:] -= keep[1:, None] * nodes[:-1, 3:]
    delaying = [NAMES.index("delay"), *model.delayers]
    seen = see_poses(cut, nodes, float(np.sum(common[delaying])))
    poses = cut.poses[0]
    return PushRows(
        motion=motion,
        motion_by_nodes=by_nodes,
        motion_by_common=by_common,
        keep=keep,
        local=local,
        local_std=std,
        pose=seen.residual,
        pose_by_delay=seen.slope,
        pose_weights=seen.weights,
        pose_middle=seen.middle,
        pose_time=poses.time[seen.index],
        pose_std=poses.std,
        first_node=cut.first_node,
        judged=model.mask & cut.inner,
        variation=sharp.variation,
    )


def _smooth(motion: Array, by_nodes: Array, nodes: Array, middle: Index, spread: Array) -> None:
    """Set rows of second differences of the motion, with their std (R, 3)."""
    for axis in range(3):
        weights = np.array([1.0, -2.0, 1.0]) / spread[:, axis, None]
        by_nodes[middle, axis, :, axis] = weights
        near = np.stack([nodes[middle + k, axis] for k in (-1, 0, 1)], axis=1)
        motion[middle, axis] = np.sum(weights * near, axis=1)
