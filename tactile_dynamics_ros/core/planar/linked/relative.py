"""Motion of two parts beside each other, as poses of one in the frame of the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.streams import LinkStream

Array = NDArray[np.float64]

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
