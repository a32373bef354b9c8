"""Held-out error on interleaved blocks of time that the fit has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.structure import window_index

_BLOCK = 1.5
"""Length of held-out blocks, s: longer than the windows of the motion (±70 ms), so that a block
has not been seen through its neighbours, and twenty of them in 30 s. 0.75 and 3 changed no verdict
of 16 examples (7 synthetic probes, 9 slides of a block), and errors by their third digit."""
_FEWEST_BLOCKS = 6
"""Blocks of a short recording at least, three to fit and three to test. 3 changed nothing."""


@dataclass(frozen=True)
class HeldOut:
    """Held-out error of one model.

    Attributes:
        losses: (B,) sum of squared white residuals of each block, from a fit to the other half.
        rows: number of rows.
    """

    losses: Array
    rows: int

    @property
    def rms(self) -> float:
        """White RMS over all blocks."""
        return float(np.sqrt(self.losses.sum() / self.rows))


def held_out(model: ResidualModel) -> HeldOut:
    """Fit on even blocks, test on odd ones, and the other way round.

    The refit on half of the data is one Gauss-Newton step from the full solution, with a ridge
    that is small against the information of the full data.

    Args:
        model: fitted to all data.
    """
    residual, jacobian = model.residual, model.jacobian
    length = min(_BLOCK, (model.time[-1] - model.time[0]) / _FEWEST_BLOCKS)
    block = window_index(model.time, max(length, 1e-9))
    scale = np.linalg.norm(jacobian, axis=0) + 1e-300
    unit = jacobian / scale
    losses = np.zeros(int(block.max()) + 1)
    for parity in (0, 1):
        fit = block % 2 == parity
        test = ~fit
        normal = unit[fit].T @ unit[fit] + 1e-6 * np.eye(unit.shape[1])
        step = np.linalg.solve(normal, unit[fit].T @ residual[fit])
        errors = residual[test] - unit[test] @ step
        losses += np.bincount(block[test], errors**2, minlength=len(losses))
    return HeldOut(losses, len(residual))


def fits_equally(best: HeldOut, other: HeldOut, tolerance: float = 2.0) -> bool:
    """Whether another model predicts held-out blocks as well, within the scatter of the blocks.

    The mean difference of the block losses must lie within `tolerance` standard errors, or below
    what a few parameters cost.
    """
    difference = other.losses - best.losses
    total = float(difference.sum())
    spread = float(difference.std(ddof=1) * np.sqrt(len(difference)))
    return total <= max(tolerance * spread, 4.0)
