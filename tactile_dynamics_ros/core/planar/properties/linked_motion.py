"""Latent motion of two parts, where poses lie on it, and a first guess of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.numerics.bordered import NormalEquations
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals, Poses
from tactile_dynamics_ros.core.planar.properties.push_model import add_smoothness

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEPS = {"pose": 1e-6, "velocity": 1e-5, "acceleration": 1e-3, "local": 1e-5}
"""Changes for difference quotients, m, m/s, m/s^2 and 1; ten times as large changes no digit that
matters."""
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


@dataclass(frozen=True)
class Motion:
    """Coordinates (R, D), their velocities and accelerations, and how friction differs (R, l)."""

    pose: Array
    velocity: Array
    acceleration: Array
    local: Array

    @classmethod
    def of_nodes(cls, nodes: Array, middle: NDArray[np.intp], step: float, size: int) -> Motion:
        """At the middle of intervals, from nodes (N, D + l) of control points and friction."""
        before, here, after = (nodes[middle + k, :size] for k in (-1, 0, 1))
        return cls(
            (before + 6.0 * here + after) / 8.0,
            (after - before) / (2.0 * step),
            (before - 2.0 * here + after) / step**2,
            nodes[middle, size:],
        )

    def shifted(self, name: str, axis: int) -> Motion:
        """With one column changed by `STEPS`."""
        columns = {n: getattr(self, n) for n in STEPS}
        columns[name] = columns[name].copy()
        columns[name][:, axis] += STEPS[name]
        return Motion(**columns)


@dataclass(frozen=True, eq=False)
class PairData:
    """What a model of two parts is made from.

    Attributes:
        intervals: forces and poses. patches: footprints. gravity: (3,) m/s^2.
        com_height, com_height_std: m, of both before the data.
        mask: (N,) intervals whose equations count. spread: (N, D) accelerations allowed elsewhere.
        travelled: (N - 1,) m between nodes.
        touched: (N,) 0 or 1, the part that is touched.
        turning: (N,) whether the parts turn beside each other.
    """

    intervals: Intervals
    patches: tuple[SupportPatch, SupportPatch]
    gravity: Array
    com_height: Array
    com_height_std: Array
    mask: Mask
    spread: Array
    travelled: Array
    touched: Array
    turning: Mask


@dataclass(frozen=True, eq=False)
class SeenPart:
    """Poses (M,) of one part beside the motion at their stamps.

    Attributes:
        at: where they lie on the spline. residual: (M, 3) white.
        by_nodes: (M, 3, 3, D) derivative by three nodes. by_common: (M, 3, p).
    """

    at: Sightings
    residual: Array
    by_nodes: Array
    by_common: Array
