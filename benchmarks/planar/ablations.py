"""What single decisions of the filter are worth: each undone, on the same recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.planar.pixels import LASTING, NO_LASTING, Camera
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.belief import Belief
from tactile_dynamics_ros.core.planar.filter.dual import DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import Observation
from tactile_dynamics_ros.synthetic.pushed.sensed import SensedStep

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


@dataclass(frozen=True, eq=False)
class Way:
    """One way to filter.

    Attributes:
        make: the filter. learning: how it learns parameters.
        lasting: (3,) m and rad, error that pixels share, if they are seen instead of poses.
    """

    make: Callable[..., DualFilter] = DualFilter
    learning: str = "trend"
    lasting: Array | None = None

    def sense(self, scene: Any, seed: int) -> Callable[[DualFilter, SensedStep], Observation]:
        """What the filter is shown of each step."""
        if self.lasting is None:
            return lambda _, step: step.usual
        return Camera(scene, self.lasting, seed)


WAYS = {
    "as it is": Way(),
    "weighted hypotheses (Liu and West)": Way(learning="weights"),
    "printed Eq. 32-33": Way(learning="printed"),
    "clipped points": Way(Clipped),
    "kept cross-covariance": Way(KeptCross),
    "64 x 64 pixels, independent": Way(lasting=NO_LASTING),
    "64 x 64 pixels, lasting error": Way(lasting=LASTING),
}
"""By what is undone."""
