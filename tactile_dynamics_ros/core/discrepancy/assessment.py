"""Is the model adequate? Effects of the catalogue and structure of any kind, with one p-value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.discrepancy.model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.screening import Score, adjusted_p_value, screen
from tactile_dynamics_ros.core.discrepancy.structure import Structure, examine, periodogram
from tactile_dynamics_ros.core.discrepancy.structure import noise_floor as spectral_floor

Array = NDArray[np.float64]

_NOISE_TOLERANCE = 0.25


@dataclass(frozen=True)
class Assessment:
    """What distinguishes a model's residual from the noise that was stated.

    Attributes:
        rms: white RMS of the residual.
        scores: of every effect that could be added.
        structure: of the residual itself.
        significance: p-values below it count.
    """

    rms: float
    scores: tuple[Score, ...]
    structure: Structure
    significance: float

    @cached_property
    def p_value(self) -> float:
        """That an adequate model leaves such a residual; corrected for everything tested."""
        return min(1.0, 2.0 * adjusted_p_value(self.scores), 2.0 * self.structure.p_value)

    @property
    def noise_stated_well(self) -> bool:
        """Whether the noise is within 25 % of what was stated (or below it)."""
        return self.structure.floor <= 1.0 + _NOISE_TOLERANCE

    @property
    def adequate(self) -> bool:
        """Whether nothing is seen to be missing."""
        return self.p_value >= self.significance and self.noise_stated_well


def assess(
    model: ResidualModel,
    significance: float = 0.01,
    names: Sequence[str] | None = None,
) -> Assessment:
    """Test a fitted model.

    Args:
        model: to be tested.
        significance: family-wise level.
        names: effects to be scored; all that the model lacks by default.
    """
    time, white = instants(model)
    structure = examine(time, white)
    scores = screen(model, model.families(names), structure.floor)
    rms = float(np.sqrt(np.mean(model.residual**2)))
    return Assessment(rms, tuple(scores), structure, significance)


def instants(model: ResidualModel) -> tuple[Array, Array]:
    """Times (N,) and white residuals (N, D) of a model."""
    new = np.flatnonzero(np.diff(model.time) > 0)
    channels = int(new[0]) + 1 if len(new) else len(model.time)
    return model.time[::channels], model.residual.reshape(-1, channels)


def noise_floor(model: ResidualModel) -> float:
    """White RMS of the noise alone, by the spectrum of the residual."""
    return spectral_floor(periodogram(*instants(model)))
