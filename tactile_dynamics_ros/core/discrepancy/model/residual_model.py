"""What the diagnosis needs to know of a model: white residuals, Jacobians, effects to try.

Nothing here knows what is modelled: a held object, a sliding probe and a pushed block all qualify.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array

ParameterTable = dict[str, dict[str, dict[str, Any]]]

_LOUDER = 0.2
"""Growth of the mean log standard deviation from which an effect makes noise larger: by 22 %. Those
that do it honestly, as a lag or an offset of clocks that moves noise elsewhere, stay below. Lower
passes over these, higher lets effects win that call an error noise."""
_TAKEN_BACK = 0.5
"""Share of the fall of the squares that larger noise must take back for an effect to be passed
over: half, so that one whose fall is mostly real stays (a spinning rotor makes noise somewhat
larger and the error far smaller). Lower passes over such ones, higher keeps what mostly buys
noise."""


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
        rings: whether the effect can oscillate at a frequency of its own.
        lasting: whether it is an error that the sensors themselves report, such as a wrong gain.
        symbols: of the columns, where they can stand in a formula.
        frame: in which the columns are constant or turn with what they depend on.
        effect: name of the effect of the catalogue that a term of the library is; empty for none.
        regional: whether the effect may act in a regime only: the model then knows its families
            under the names ``name[regime]``.
        event: whether it is something that changes at one time, and so acts from a time on only.
        contains: name of a simpler effect that it has in it; empty for none.
    """

    name: str
    label: str
    reading: str
    columns: Array
    kept: tuple[int, ...]
    choices: int = 1
    source: Any = None
    rings: bool = False
    lasting: bool = False
    symbols: tuple[str, ...] = ()
    frame: str = ""
    effect: str = ""
    regional: bool = False
    event: bool = False
    contains: str = ""


@dataclass(frozen=True)
class Condition:
    """A scalar that says what was going on at each instant.

    Attributes:
        name: for example ``speed``.
        unit: SI.
        values: (N,).
        below_most: what it means that the value is below its largest, where nothing else is worth
            saying of it; empty for a quantity that is divided into thirds.
        symbol: that regimes name it by; empty where none can.
        cosine_of: angle whose cosine the values are, as people name it; empty for other quantities.
    """

    name: str
    unit: str
    values: Array
    below_most: str = ""
    symbol: str = ""
    cosine_of: str = ""


@dataclass(frozen=True)
class Residuals:
    """Residuals of N instants with D channels in their own units, and white.

    Attributes:
        time: (N,) s.
        white: (N, D) residual, N(0, 1) where the model is right.
        physical: (N, D) measured minus predicted in the units of the channels.
        channels: D names.
        units: D units.
        frames: matrices (N, D, D) that turn channels into other frames, by name of the frame.
        conditions: what was going on.
        drivers: (N, k) motion that may drive the residual, or None.
        factors: e and C^-1 e, (N, D) each, of the residual e with covariance C: their products add
            up to the squares of ``white``, and say of each channel what it contributes. None where
            channels are independent.
        frame: name of the frame that the channels are in; empty where they have none.
        alone: what the model without effects is called.
        about: what the model predicts from what, in a sentence.
    """

    time: Array
    white: Array
    physical: Array
    channels: tuple[str, ...]
    units: tuple[str, ...]
    frames: dict[str, Array] = field(default_factory=dict)
    conditions: tuple[Condition, ...] = ()
    drivers: Array | None = None
    factors: tuple[Array, Array] | None = None
    frame: str = ""
    alone: str = "the model alone"
    about: str = ""


@dataclass(frozen=True)
class Convention:
    """Another reading of a recording, under which the numbers fit.

    Attributes:
        name: of the convention that was mistaken.
        change: what is done to read the recording right, in a few words.
        model: of the recording read right.
        error_after: its held-out white RMS.
        others: names of conventions that fit this recording as well.
    """

    name: str
    change: str
    model: ResidualModel
    error_after: float
    others: tuple[str, ...] = ()


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

    @property
    def noise_level(self) -> float:
        """Mean logarithm of the standard deviations by which residuals are made white."""

    @property
    def lasting_freedom(self) -> float:
        """Number of independent errors that last and that the sensors report of themselves."""

    def convention(self) -> Convention | None:
        """Another reading of the recording that fits where this one does not, or None."""

    @property
    def unreadable(self) -> str:
        """Why a misfit of this recording says nothing of the model, in a sentence; empty mostly."""

    @property
    def too_short(self) -> str:
        """Why the recording cannot show that nothing is missing; empty if it can."""

    @property
    def remark(self) -> str:
        """What a model should be known by beside its verdict; a sentence, or empty."""

    @property
    def known_event(self) -> dict[str, Any] | None:
        """Part `event` of the documents for what the model has already; None without one."""

    def imitators(self, name: str) -> Sequence[str]:
        """What is no effect of the catalogue and may do here what an effect does, by name."""

    def is_possible(self, name: str) -> bool:
        """Whether the parameters of an effect that the model has are such as can exist."""

    def moved_by(self, other: ResidualModel) -> float:
        """Largest change of an estimate if this fit is exchanged for another with more effects.

        In standard deviations of this fit.
        """

    def families(self, names: Sequence[str] | None = None) -> Sequence[Family]:
        """Families of the effects that the model could have."""

    def conditions(self) -> Sequence[Condition]:
        """Scalars by which a regime may be reported, one value for each instant."""

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
        """Residuals for people, with what was going on."""

    def library(self) -> Sequence[Family]:
        """Families of named quantities, for a residual that no effect explains."""

    def separating_motion(self, rivals: Sequence[ResidualModel]) -> dict[str, Any] | None:
        """Plan of what would tell this model from others, or None if nothing would.

        Its `description` says what to do; `separates_from` names the rivals that it tells, all of
        them where it is missing.
        """


@dataclass(frozen=True)
class Misfit:
    """Size of a residual, and of the noise by which it is made white.

    Attributes:
        rms: white RMS.
        noise_level: mean logarithm of the standard deviations by which the residual is made white.
    """

    rms: float
    noise_level: float

    @classmethod
    def of(cls, model: ResidualModel) -> Misfit:
        """Misfit of a fitted model."""
        return cls(float(np.sqrt(np.mean(model.residual**2))), model.noise_level)

    def is_drowned(self, after: Misfit) -> bool:
        """Whether what an effect explains is explained by noise that it makes larger.

        -2 log likelihood is rms^2 + 2 noise_level per row: the growth of the latter takes back at
        least half of the fall of the former.

        Args:
            after: with the effect.
        """
        growth = after.noise_level - self.noise_level
        return growth > _LOUDER and 2.0 * growth > _TAKEN_BACK * (self.rms**2 - after.rms**2)


def instants(model: ResidualModel) -> tuple[Array, Array]:
    """Times (N,) and white residuals (N, D) of a model."""
    new = np.flatnonzero(np.diff(model.time) > 0)
    channels = int(new[0]) + 1 if len(new) else len(model.time)
    return model.time[::channels], model.residual.reshape(-1, channels)
