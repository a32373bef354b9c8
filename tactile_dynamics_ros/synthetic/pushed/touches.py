"""Touches of simulated pushes: what was known of each, and by how much its force was unexpected."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.filter.dual import DualFilter
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.network.noise_features import Touched, TouchHistory
from tactile_dynamics_ros.synthetic.pushed.sensed import (
    POSE_STD,
    SensedStep,
    giving_way,
    sensed_steps,
)
from tactile_dynamics_ros.synthetic.pushed.transitions import true_parameters

_KNOWN = 0.01
"""Standard deviation of ln product, ln mass, ln friction and, in units of 5 cm, of the centre, with
which the filter knows the truth: errors that only a wrong object causes are not the sensors'."""


@dataclass(frozen=True, eq=False)
class FeltErrors:
    """Touched steps of one recording.

    Attributes:
        touched: what was known of each, N.
        errors: (N, 2) N, measured less expected.
        granted: (N, 2, 2) N^2, covariance of what is expected by the filter's own belief.
    """

    touched: list[Touched]
    errors: np.ndarray
    granted: np.ndarray


def felt_errors(one: Any, period: float, seed: int) -> FeltErrors:
    """What a filter on mechanics that knows the object makes of all forces of a tip.

    It follows the poses and learns nothing from forces, so that each is judged by itself. Its
    belief about motion and local friction is what it is in use, unlike exact states: those make a
    tip that starts within a step an impact of hundreds of newtons.

    Args:
        one: recording of one link under a tip.
        period: s of each step.
        seed: of the noise.
    """
    link, truth = one.scene.thing.links[0], true_parameters(one.scene)
    process = PatchProcess(link.corners, 0.5 * link.height)
    scale = np.array([1.0, 1.0, 0.05, 0.05, 1.0])
    steps = sensed_steps(one, period, seed)
    known = truth, np.diag(np.square(_KNOWN * scale))
    belief = DualFilter(process, steps[0].seen.poses[0].value, POSE_STD, prior=known)
    history = TouchHistory()
    rows: list[tuple[Touched, np.ndarray, np.ndarray]] = []
    for k, step in enumerate(steps):
        if step.motion is None:
            history.end()
        else:
            step = giving_way(steps[max(k - 1, 0) : k + 2], step)
            rows += _judged(belief, history, step)
        belief.step(step.motion, replace(step.seen, wrench=None))
    errors = np.array([row[1] for row in rows]).reshape(-1, 2)
    granted = np.array([row[2] for row in rows]).reshape(-1, 2, 2)
    return FeltErrors([row[0] for row in rows], errors, granted)


def _judged(
    belief: DualFilter, history: TouchHistory, step: SensedStep
) -> list[tuple[Touched, np.ndarray, np.ndarray]]:
    motion, seen = step.motion, step.seen
    assert motion is not None and seen.wrench is not None
    touched = history.next(motion, seen.wrench, step.share, belief.state[0])
    if touched is None:
        return []
    mean, covariance = belief.expected(motion, seen)
    return [(touched, seen.wrench.value[:2] - mean[-2:], covariance[-2:, -2:])]
