"""Optima at several variations of friction, and what fits of one part and of two have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.bordered import Factor, Solution
from tactile_dynamics_ros.core.planar.properties.balance import around
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.streams import PushedStreams

STAGES = ((2e-2, 30.0), (5e-3, 10.0), (2e-3, 3.0), (5e-4, 1.0))
"""Slip speed, m/s, and floor over its final value of each stage. Of one part slip is slower in
proportion below 50 mm/s. Straight at the last one fits stick at signs that noise decides."""
VARIATIONS = (0.003, 0.03, 0.1)
"""Relative variation of friction from place to place that is tried; real tables have 0.08 to
0.13. The least is not tried where forces are coarse: one even table in eight was none there, its
product 15 std off."""
FIRST_VARIATION = 0.03
"""The one with which fits begin, the middle."""
HOPELESS = 60.0
"""Log evidence by which a variation may promise less than the best and still be refitted: refits of
four recordings turned differences of up to 31 round, none of more than 50. Smaller passes over the
right one (at 25 the friction of a joint was 2.8 std off instead of 1.1), larger costs refits that
have no weight."""
_WIDTH = 2.0
"""By how much std of mass and inertia are widened: on twelve recordings made for tuning their
errors were up to twice as large as the curvature of the optimum says, as noise of accelerations is
no Gaussian of small width. At 1 one in five intervals of 90 % misses."""
_FREE = 5.0
"""Accelerations allowed around touches whose friction is not modelled, m/s^2: a coefficient of 0.5.
Without a limit the motion takes paths there that no object takes; at 2 masses come out too low."""
_AROUND = 3
"""Intervals around touches in which that is so: an arm that stops within 20 ms."""
_LEAST_SPREAD = (0.5, 10.0)
"""Accelerations allowed where nothing is modelled and nothing touches, m/s^2 and rad/s^2: what
turns out during a slide to a stop. A tenth holds the object back while it still slides."""
LEAST_INTERVALS = 10
"""Intervals of sliding below which nothing is said: a tenth of a second at 100 Hz."""
_PENDING = 0.5
"""Step that the optimiser would still take, in std of the common numbers taken together, up to
which its result is an answer; the step is in the interval."""
SINGULAR = (
    "the motion that was found is singular: the model may lack something, or footprints, units or "
    "clocks are wrong"
)
"""What is said where no fit exists; words for people, no number."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """Best nodes and numbers at one variation of friction.

    Attributes:
        solution: of the fit. covariance: (p, p) of the common numbers, with the step still to go.
        evidence: log probability of the data. pending: that step, in standard deviations.
        variation: relative, of friction from place to place.
    """

    solution: Solution
    covariance: Array
    evidence: float
    pending: float
    variation: float

    @classmethod
    def of(cls, found: Solution, factor: Factor, evidence: float, variation: float) -> Optimum:
        """Take the covariance from a factor of the solution's equations."""
        covariance = factor.covariance
        _, step = factor.step()
        pending = float(np.sqrt(step @ np.linalg.solve(covariance, step)))
        return cls(found, covariance + np.outer(step, step), evidence, pending, variation)

    @property
    def is_answer(self) -> bool:
        """Whether the iteration ended itself, or next to where it would."""
        return self.solution.settled or self.pending < _PENDING

    @property
    def misfit(self) -> float:
        """Error of one-step predictions over its std, of the solution."""
        return self.solution.misfit


def average(trials: Sequence[Optimum], wide: Sequence[int]) -> tuple[Optimum, Array, Array]:
    """Mean over variations by their evidence: the likeliest, numbers (p,) and covariance (p, p).

    Covariances are widened by the misfit, by how the optima differ, and by `_WIDTH`.

    Args:
        trials: optima of one model.
        wide: places of ln masses and inertias among the numbers.
    """
    evidence = np.array([trial.evidence for trial in trials])
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    common = np.sum([w * t.solution.common for w, t in zip(weight, trials, strict=True)], axis=0)
    covariance = np.zeros((len(common), len(common)))
    for w, trial in zip(weight, trials, strict=True):
        away = trial.solution.common - common
        covariance += w * (max(1.0, trial.misfit**2) * trial.covariance + np.outer(away, away))
    width = np.ones(len(common))
    width[list(wide)] = _WIDTH
    return trials[int(np.argmax(weight))], np.asarray(common), covariance * np.outer(width, width)


def allowed(cut: Intervals, spread: Array, size: float) -> Array:
    """Accelerations (N, D) that a motion may have where its equations do not count.

    Args:
        cut: intervals.
        spread: (N, D) of the smoothed motion, m/s^2 and rad/s^2, two places first, then angles.
        size: m, by which free accelerations are turned into angular ones.
    """
    angles = spread.shape[1] - 2
    near = around(cut.touching, _AROUND)[:, None]
    free = np.array([_FREE, _FREE] + [_FREE / size] * angles)
    least = np.array([_LEAST_SPREAD[0]] * 2 + [_LEAST_SPREAD[1]] * angles)
    return np.where(near, free, np.maximum(3.0 * spread, least))


def heights(streams: PushedStreams, cut: Intervals) -> tuple[Array, Array]:
    """Height of each part's centre of mass (n,) before the data, m, and its std.

    Where it is not stated: that of the push, to three tenths.
    """
    height = float(np.median(cut.point[cut.touching, 2]))
    usual = np.full(len(streams.links), 0.3 * height + 1e-3)
    if streams.com_height is None:
        return np.full(len(streams.links), height), usual
    std = streams.com_height_std
    return np.array(streams.com_height), usual if std is None else np.array(std)
