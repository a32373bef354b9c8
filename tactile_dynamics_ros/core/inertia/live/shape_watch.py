"""The live estimate held against the shape of the body, a little at each update."""

from __future__ import annotations

from dataclasses import replace

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.live.accumulation import Accumulation
from tactile_dynamics_ros.core.inertia.live.live_estimate import LiveEstimate
from tactile_dynamics_ros.core.inertia.shape_prior import ShapePrior
from tactile_dynamics_ros.core.inertia.shape_weighing import (
    Belief,
    Seen,
    Weighed,
    require_fit,
)


class ShapeWatch:
    """Weighs densities one after the other, so that no update is late.

    All beliefs of a round are of the data at its begin; a round of a mesh takes 14 updates, and
    until the next has ended its result is published.
    """

    def __init__(self, prior: ShapePrior) -> None:
        """Start without data.

        Args:
            prior: of the shape.
        """
        self._prior = prior
        _ = prior.gaussians, prior.masses  # drawn now, not while measurements wait
        self.reset()

    def reset(self) -> None:
        """Forget what was weighed."""
        self._seen: Seen | None = None
        self._beliefs: list[Belief] = []
        self._weighed: Weighed | None = None
        self._refused = ""

    def hold(self, estimate: LiveEstimate, model: Accumulation, errors: Array) -> LiveEstimate:
        """Go on weighing; return the estimate with what is known of the shape.

        It is as it was until a first round has ended, where no body in the shape explains the data,
        and while the load changes.

        Args:
            estimate: the newest, without the shape.
            model: from which it is.
            errors: (q,) lasting ones by which it is corrected.
        """
        if estimate.recent.change or estimate.samples < len(self._prior.gaussians):
            self.reset()
            return estimate
        self._advance(estimate, model, errors)
        if self._refused:
            return replace(estimate, shape=self._refused, shape_doubtful=True)
        if self._weighed is None:
            return estimate
        parts = self._weighed.parts(estimate.not_excited)
        said, doubtful = self._weighed.line, self._weighed.contradicts
        return replace(estimate, **parts, shape=said, shape_doubtful=doubtful)

    def _advance(self, estimate: LiveEstimate, model: Accumulation, errors: Array) -> None:
        """Take one step of a round: the data, whether they fit, beliefs, what follows of them."""
        gaussians = self._prior.gaussians
        if self._seen is None:
            self._seen, self._beliefs = model.seen(estimate.covariance, errors), []
            self._refused = self._refusal(self._seen)
        elif len(self._beliefs) < len(gaussians):
            self._beliefs.append(Belief.of(gaussians[len(self._beliefs)], self._seen))
        else:
            self._weighed, self._seen = Weighed(self._prior, tuple(self._beliefs)), None

    def _refusal(self, seen: Seen) -> str:
        try:
            require_fit(seen, self._prior)
        except BadInputError as error:
            return str(error)
        return ""
