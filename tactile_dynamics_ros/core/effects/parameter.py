"""What every parameter of every effect states, whatever the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class EffectParameter:
    """One scalar parameter of an effect.

    Attributes:
        name: short symbol, as in the formula of the effect.
        unit: SI.
        prior_std: scale of plausible values about zero; weak, for conditioning.
        description: one phrase.
        typical: a value at which the effect is plainly present; for checks and pictures.
        least: value below which the effect cannot exist, such as a spring that pushes.
        most: value above which it cannot, or is another, such as damping without any ringing.
    """

    name: str
    unit: str
    prior_std: float
    description: str
    typical: float = 0.0
    least: float = -math.inf
    most: float = math.inf

    def __post_init__(self) -> None:
        """Fill the typical value."""
        if self.typical == 0.0:
            object.__setattr__(self, "typical", 0.2 * self.prior_std)

    def allows(self, value: float) -> bool:
        """Whether the effect can exist with a value."""
        return self.least <= value <= self.most


@dataclass(frozen=True)
class ParameterSum:
    """A sum of parameters that data may tell although they do not tell the summands.

    Attributes:
        name: symbol.
        unit: SI.
        members: names of the parameters that are added up.
    """

    name: str
    unit: str
    members: tuple[str, ...]

    def entry(
        self, names: Sequence[str], theta: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Value and standard deviation.

        Args:
            names: of the k parameters.
            theta: (k,) their values.
            covariance: (k, k) of them.
        """
        row = np.array([float(name in self.members) for name in names])
        return float(row @ theta), float(np.sqrt(max(row @ covariance @ row, 0.0)))
