"""First guess of the motion of a pushed link, from its poses alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.properties.balance import NAMES
from tactile_dynamics_ros.core.planar.properties.bordered import NormalEquations
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.properties.push_model import add_poses, add_smoothness

Array = NDArray[np.float64]

_STEADY = (0.05, 0.05, 1.0)
"""Accelerations that the first guess of the motion takes for steady, m/s^2 and rad/s^2: a fifth of
what an arm needs to reach 30 mm/s in 0.1 s. Larger ones leave noise in the velocities, of which
friction then has the wrong direction."""
_MOTION_ROUNDS = 8
"""Rounds of reweighting of the first guess; after six the velocities change by less than 1 %."""


def first_motion(cut: Intervals) -> tuple[Array, Array]:
    """Return nodes of a motion through the poses whose velocity changes little but for moments.

    Also returns the spread (N, 3) of its accelerations, m/s^2 and rad/s^2.
    """
    poses = cut.poses[0]
    nodes = np.zeros((len(cut), 6))
    for axis in range(3):
        nodes[:, axis] = np.interp(cut.time, poses.time, poses.value[:, axis])
    middle = np.flatnonzero(cut.inner)
    spread = np.tile(_STEADY, (len(cut), 1)) * 10.0
    loose = np.broadcast_to(np.repeat([1e-3, 1.0], 3), nodes.shape)
    for _ in range(_MOTION_ROUNDS):
        equations = NormalEquations(len(nodes), 6, len(NAMES))
        add_poses(equations, cut, nodes, np.zeros(len(NAMES)))
        add_smoothness(equations, nodes, middle, spread[middle] * cut.step**2)
        step, _ = equations.factor(loose, np.ones(len(NAMES))).step()
        nodes = nodes + step
        curve = nodes[middle - 1, :3] - 2.0 * nodes[middle, :3] + nodes[middle + 1, :3]
        spread[middle] = np.sqrt(0.5 * (np.square(curve / cut.step**2) + np.square(_STEADY)))
    return nodes, spread
