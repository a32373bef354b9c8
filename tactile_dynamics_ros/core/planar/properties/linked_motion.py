"""Where poses lie on the spline of a latent motion, and a first guess of that motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.properties.bordered import NormalEquations
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals, Poses
from tactile_dynamics_ros.core.planar.properties.push_model import add_smoothness

Array = NDArray[np.float64]

_STEADY = (0.05, 0.05, 1.0)
"""Accelerations that the smoothed motion takes for steady, m/s^2 and rad/s^2, as for one part."""
_ROUNDS = 8
"""Rounds of reweighting; after six the velocities change by less than 1 %."""


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
    inside: NDArray[np.bool_]

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
