"""What single decisions of the filter are worth: each undone, on the same recordings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.filter.belief import Belief
from tactile_dynamics_ros.core.planar.filter.dual import DualFilter

Array = NDArray[np.float64]

_HALVINGS = 12
"""Of the way from a hypothesis back to the mean, to find where it becomes possible: to 1/4000."""


class Clipped(DualFilter):
    """Impossible hypotheses are drawn back to the edge of what is possible."""

    def _hypotheses(self) -> tuple[Array, NDArray[np.intp]]:
        values, split = super()._hypotheses()
        own, middle = values[:, : self._own].copy(), values[0, : self._own]
        outside = ~self.process.feasible(own)
        low, high = np.zeros(len(own)), np.ones(len(own))
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            inside = self.process.feasible(middle + share[:, None] * (own - middle))
            low, high = np.where(inside, share, low), np.where(inside, high, share)
        back = middle + low[:, None] * (own - middle)
        values[:, : self._own] = np.where(outside[:, None], back, own)
        return values, split


class KeptCross(DualFilter):
    """The joint keeps the cross-covariance and the motion's own covariance of before the step.

    Attributes:
        refused: steps after which it was not positive definite, and was made so.
    """

    refused = 0

    def _rebuilt(
        self, marginal: tuple[Array, Array], slope: Array, conditional: tuple[Array, Array]
    ) -> Belief:
        before = self.parameters[1]
        cross, inner = slope @ before, conditional[1]
        moving = inner @ inner.T + slope @ before @ slope.T
        joint = np.block([[marginal[1] @ marginal[1].T, cross.T], [cross, moving]])
        size, axes = np.linalg.eigh(joint)
        least = 1e-9 * size.max()
        self.refused += int(size.min() < -least)
        if size.min() < least:
            joint = axes @ np.diag(np.maximum(size, least)) @ axes.T
        mean = np.concatenate([marginal[0], conditional[0]])
        return Belief(mean, np.asarray(np.linalg.cholesky(joint)), len(marginal[0]))


FILTERS: dict[str, tuple[Any, str]] = {
    "as it is": (DualFilter, "trend"),
    "weighted hypotheses (Liu and West)": (DualFilter, "weights"),
    "printed Eq. 32-33": (DualFilter, "printed"),
    "clipped points": (Clipped, "trend"),
    "kept cross-covariance": (KeptCross, "trend"),
}
"""By what is undone: the filter, and how it learns parameters."""
