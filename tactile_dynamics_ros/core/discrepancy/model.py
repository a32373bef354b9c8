"""What the diagnosis needs to know of a model: white residuals, Jacobians, effects to try.

Nothing here knows what is modelled: a held object, a sliding probe and a pushed block all qualify.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ParameterTable = dict[str, dict[str, dict[str, Any]]]


@dataclass(frozen=True)
class Family:
    """A linear family that may explain a residual, r = columns c + noise.

    Attributes:
        name: the effect.
        label: the reading of the effect that the family belongs to, with its restriction.
        reading: the reading alone.
        columns: (M, m) white columns; families that share an array are projected once.
        kept: the columns that belong to this family.
        choices: number of families searched for the same effect, for its penalty.
        source: what the model needs to fit the effect itself.
    """

    name: str
    label: str
    reading: str
    columns: Array
    kept: tuple[int, ...]
    choices: int = 1
    source: Any = None


@dataclass(frozen=True)
class Quantity:
    """A named measured quantity at each instant, for correlations and formulas.

    Attributes:
        name: what it is, for example ``velocity``.
        symbol: for formulas, for example ``v``.
        unit: SI.
        values: (N, 3) or (N, 1).
        frame: in which the values are given, empty for scalars.
    """

    name: str
    symbol: str
    unit: str
    values: Array
    frame: str = ""


@dataclass(frozen=True)
class Residuals:
    """Residuals of N instants with D channels in their own units, and white.

    Attributes:
        time: (N,) s.
        white: (N, D) residual, N(0, 1) where the model is right.
        physical: (N, D) measured minus predicted in the units of the channels.
        channels: D names; channels of one vector are named ``<vector>_<axis>``.
        units: D units.
        frames: `physical` in other frames by name, (N, D) each.
        quantities: named quantities.
    """

    time: Array
    white: Array
    physical: Array
    channels: tuple[str, ...]
    units: tuple[str, ...]
    frames: dict[str, Array] = field(default_factory=dict)
    quantities: tuple[Quantity, ...] = ()


class ResidualModel(Protocol):
    """A fitted model with the effects that it has and could have."""

    @property
    def residual(self) -> Array:
        """(M,) white residual, ordered in time, channel fastest."""

    @property
    def jacobian(self) -> Array:
        """(M, p) derivative of the residual by all parameters of the model."""

    @property
    def time(self) -> Array:
        """(M,) s."""

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects that the model has."""

    @property
    def freedom(self) -> float:
        """Number of effect parameters that the data determine."""

    def families(self, names: Sequence[str] | None = None) -> Sequence[Family]:
        """Families of the effects that the model could have."""

    def with_effect(self, family: Family, coefficients: Array) -> ResidualModel:
        """Fit quickly with one more effect, starting at coefficients of the family."""

    def without_effect(self, name: str) -> ResidualModel:
        """Fit quickly with one effect less."""

    def refined(self) -> ResidualModel:
        """Fit thoroughly."""

    def parameters(self) -> ParameterTable:
        """{effect: {parameter: {"value", "std", "unit"}}}."""

    def sentence(self, name: str) -> str:
        """What an effect does to the system, as a clause without a full stop."""

    def residuals(self) -> Residuals:
        """Residuals for people, with named quantities."""
