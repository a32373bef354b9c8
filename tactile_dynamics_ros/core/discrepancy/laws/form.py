"""What the search for a law asks of each form that a law can have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel

Array = NDArray[np.float64]


class LawForm(Protocol):
    """A family of laws with the same formula and free parameters, of one kind of model."""

    @property
    def name(self) -> str:
        """Name of the form."""

    @property
    def effect(self) -> Any:
        """The law as an effect that the model can be fitted with."""

    def starts(self, model: Any, frequencies: Sequence[float]) -> list[Array]:
        """Parameters (k,) from which fits may start.

        Args:
            model: without the law.
            frequencies: of the strongest line of each spectrum that is searched, Hz.
        """

    def columns(self, model: Any, start: Array) -> Array:
        """(M, m) white columns whose coefficients complete a start."""

    def completed(self, start: Array, coefficients: Array) -> Array:
        """Parameters (k,) of a start with the coefficients (m,) of its columns."""


class FittableModel(ResidualModel, Protocol):
    """A model that fits effects from parameters that are handed over, and can draw its noise."""

    effects: tuple[Any, ...]
    theta: tuple[Array, ...]

    def fitted_from(self, effects: tuple[Any, ...], theta: tuple[Array, ...]) -> FittableModel:
        """Fit all parameters at fixed whitening."""

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(M,) noise before whitening."""

    def whiten(self, rows: Array) -> Array:
        """White form of rows (M, ...)."""
