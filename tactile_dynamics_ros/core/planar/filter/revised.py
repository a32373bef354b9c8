"""A dual filter that goes through its steps once more, from where they led."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.belief import Belief
from tactile_dynamics_ros.core.planar.filter.dual import FADING, DualConfig, DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import Observation
from tactile_dynamics_ros.core.planar.filter.process import Process, PusherMotion

_MOVED = 0.5
"""Way of a parameter, in standard deviations of what was known at first, from which the steps are
gone through once more. Forces go with the exponential of a product: half a standard deviation (0.3)
changes by a third what a newton tells of its logarithm, and by half the variance that is left."""
_LONGEST = 600
"""Steps that are kept, also of rest: 40 s at 15 Hz, which two parts are gone through in about 12 s
of a core. In longer recordings estimates no longer move."""


class RevisedFilter(DualFilter):
    """After each push it begins anew around what it found, if that is far from what it thought.

    What a step tells is taken to be linear around the hypotheses of that step, and what was learnt
    is never looked at again. Of two parts mainly the sum of their frictions and its centre act:
    where the second part is thought three times too large, a newton of the sum tells three times
    too much of its logarithm, and what later pushes say meets a belief that is too narrow.

    Gone through once more, hypotheses begin with the covariance p(phi) = N(m_0, P_0) of what was
    known, but around m_1, where the first pass led. What N(m_1, P_0) said of phi is then replaced
    by N(m_0, P_0): with the joint N(mu, S) of parameters and motion after all steps,
    mu <- mu + S[:, phi] P_0^-1 (m_0 - m_1), S <- S. No measurement counts twice.

    Source: posterior linearisation (Garcia-Fernandez et al. 2015), over all steps at once.
    """

    _around: Array

    def __init__(
        self,
        process: Process,
        pose: Array,
        pose_std: Array,
        config: DualConfig | None = None,
        prior: tuple[Array, Array] | None = None,
    ) -> None:
        super().__init__(process, pose, pose_std, config, prior)
        self._begin_here()

    def step(self, motion: PusherMotion | None, seen: Observation) -> None:
        """Advance by a step; where a push has ended, revise what was learnt of it."""
        super().step(motion, seen)
        if motion is None and not self._steps:
            self._begin_here()
            return
        ended = motion is None and self._steps[-1][0] is not None
        if len(self._steps) <= _LONGEST:
            self._steps.append((motion, seen))
        if ended:
            self.revise()

    def inform(self, mean: Array, covariance: Array) -> None:
        """Replace what is believed of the first parameters (k,); earlier steps count no more."""
        super().inform(mean, covariance)
        self._begin_here()

    def revise(self) -> bool:
        """Go through all steps once more if the parameters moved far, and say whether it did."""
        found = self.belief.mean[: self._own].copy()
        known, covariance = self._known
        for k, name in enumerate(self.process.names):
            if name in FADING:
                found[k] = known[k]
        std = np.sqrt(np.diag(covariance))
        far = float(np.abs((found - self._around) / std).max()) > _MOVED
        if not far or len(self._steps) > _LONGEST:
            return False
        before = self.belief, self._velocity
        try:
            self.belief = self._gone_through(found)
        except np.linalg.LinAlgError:
            self.belief, self._velocity = before
            return False
        self._around = found
        return True

    def _begin_here(self) -> None:
        """Take what is believed now for what is known before any step."""
        self._steps: list[tuple[PusherMotion | None, Observation]] = []
        self._begun, self._begun_at = self.belief, self._velocity
        self._known = self.parameters
        self._around = self._known[0]

    def _gone_through(self, around: Array) -> Belief:
        """Belief after all steps, with hypotheses that begin around parameters (p,)."""
        own, (known, covariance) = self._own, self._known
        mean = self._begun.mean.copy()
        mean[:own] = around
        self.belief, self._velocity = replace(self._begun, mean=mean), self._begun_at
        for motion, seen in self._steps:
            super().step(motion, seen)
        after = self.belief
        back = np.linalg.solve(covariance, known - around)
        return replace(after, mean=after.mean + after.covariance[:, :own] @ back)


def filter_of(
    process: Process,
    pose: Array,
    pose_std: Array,
    config: DualConfig | None = None,
    prior: tuple[Array, Array] | None = None,
) -> DualFilter:
    """Make the filter that suits a process: of two parts, one that revises what it learnt."""
    make = RevisedFilter if process.links > 1 else DualFilter
    return make(process, pose, pose_std, config, prior)
