"""Base of models that are fitted by least squares: what the engine asks of all of them, once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contract import central_differences
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    Convention,
    Family,
    ParameterTable,
    ResidualModel,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.screening import orthonormal
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt

_STEP = 1e-5
"""Step of central differences in units of each parameter's scale: their error grows as its square,
that of rounding as its inverse; between 1e-6 and 1e-4 derivatives of smooth laws agree to 1e-8."""


class Parameter(Protocol):
    """One scalar parameter of an effect; zero is absent."""

    @property
    def name(self) -> str:
        """Symbol."""

    @property
    def unit(self) -> str:
        """SI."""

    @property
    def prior_std(self) -> float:
        """Scale of plausible values about zero."""

    @property
    def typical(self) -> float:
        """A value at which the effect is plainly present."""


class Sum(Protocol):
    """A sum of parameters of an effect."""

    @property
    def name(self) -> str:
        """Symbol."""

    @property
    def unit(self) -> str:
        """SI."""

    @property
    def members(self) -> tuple[str, ...]:
        """Names of the parameters that are added up."""

    def entry(self, names: Sequence[str], theta: Array, covariance: Array) -> tuple[float, float]:
        """Value and standard deviation, given those of the parameters of these names."""


class NamedEffect(Protocol):
    """What the engine tells people of an effect."""

    @property
    def name(self) -> str:
        """As in `--effects`."""

    @property
    def formula(self) -> str:
        """The law in one line."""

    @property
    def sentence(self) -> str:
        """What it does to the system, as a clause."""


EffectT = TypeVar("EffectT", bound=NamedEffect)


class LeastSquaresModel(ABC, Generic[EffectT]):
    """Residuals r(x) = L^-1 e(x) with e measured minus predicted, and x = [own, theta ...].

    A model states what it measures and predicts (or `lack`, where the equation cannot be solved for
    what is measured), how residuals are made white, the priors of its effects and their catalogue.
    Fits, derivatives, parameters and the rest that `ResidualModel` asks for follow from that; where
    a model has something better, such as derivatives in closed form, it overrides it.
    `check_residual_model` tests it all.

    Attributes:
        effects: of the model. theta: their parameters.
        catalogue: names of the effects that may be tried.
        iterations, tolerance: of fits, see `levenberg_marquardt`.
    """

    effects: tuple[EffectT, ...]
    theta: tuple[Array, ...]
    catalogue: tuple[str, ...]
    iterations: ClassVar[int] = 40
    tolerance: ClassVar[float] = 1e-9

    @property
    @abstractmethod
    def own(self) -> Array:
        """(q,) parameters that the model has without effects."""

    @property
    @abstractmethod
    def time(self) -> Array:
        """(M,) s of each row; rows are ordered in time, channel fastest."""

    @property
    @abstractmethod
    def measured(self) -> Array:
        """(M,) what is measured."""

    @abstractmethod
    def predict(self, x: Array, effects: Sequence[EffectT]) -> Array:
        """(M,) what is predicted for x = [own, theta ...] of these effects."""

    @abstractmethod
    def whiten(self, rows: Array) -> Array:
        """White form of rows (M, ...): unit variance where these are the noise."""

    @abstractmethod
    def draw_noise(self, random: np.random.Generator) -> Array:
        """(M,) one draw of the noise of `measured`, from what the sensors report."""

    @abstractmethod
    def parameters_of(self, effect: EffectT) -> Sequence[Parameter]:
        """Parameters of an effect, with their priors."""

    @abstractmethod
    def with_parameters(
        self, own: Array, effects: tuple[EffectT, ...], theta: tuple[Array, ...]
    ) -> Self:
        """The model at other parameters, at the same whitening."""

    @abstractmethod
    def refined(self) -> Self:
        """Fit thoroughly, with the whitening at what is found."""

    @abstractmethod
    def effect_named(self, name: str) -> EffectT:
        """An effect of the catalogue.

        Raises:
            BadInputError: there is none of that name.
        """

    @abstractmethod
    def families_of(self, name: str) -> list[Family]:
        """White linear families of all readings of an effect that the model lacks."""

    @abstractmethod
    def residuals(self) -> Residuals:
        """Residuals for people, with what was going on."""

    @abstractmethod
    def plan_against(self, rivals: Sequence[Self]) -> dict[str, Any] | None:
        """Plan of what would tell this model from others of its kind, or None."""

    @property
    def noise_level(self) -> float:
        """Mean log standard deviation of the noise; 0 where no effect changes the noise."""
        return 0.0

    def convention(self) -> Convention | None:
        """None: a model knows no other reading of its recording."""
        return None

    @property
    def unreadable(self) -> str:
        """Empty: a misfit says something of the model."""
        return ""

    @property
    def too_short(self) -> str:
        """Empty: any recording can show that nothing is missing."""
        return ""

    @property
    def remark(self) -> str:
        """Empty: nothing beside the numbers."""
        return ""

    @property
    def known_event(self) -> dict[str, Any] | None:
        """None: nothing that happens at one time is part of the model."""
        return None

    def imitators(self, name: str) -> Sequence[str]:
        """None: all that a model knows of is in its catalogue."""
        return ()

    @property
    def lasting_freedom(self) -> float:
        """Number of independent errors that last and that the sensors report; one by default."""
        return 1.0

    @property
    def own_scales(self) -> Array:
        """(q,) sizes of changes of the own parameters that are neither small nor large."""
        return np.ones(len(self.own))

    @property
    def own_names(self) -> Sequence[tuple[str, str, str]]:
        """(table, name, unit) of each own parameter that `parameters` lists; none by default."""
        return ()

    def conditions(self) -> Sequence[Condition]:
        """Conditions of the residuals that have a symbol."""
        return [one for one in self.residuals().conditions if one.symbol]

    def library(self) -> list[Family]:
        """Families of named quantities, for a residual that no effect explains; none by default."""
        return []

    def law_forms(self) -> Sequence[Any]:
        """Forms of laws that may be learnt, see `laws.search.LawForm`; none by default."""
        return ()

    def sums_of(self, effect: EffectT) -> Sequence[Sum]:
        """Sums of parameters that data may tell although not the summands; none by default."""
        return ()

    def guess(self, family: Family, coefficients: Array) -> Array:
        """Start (k,) of the fit of an effect from the coefficients of its family."""
        return coefficients[: len(self.parameters_of(family.source))]

    def lack(self, x: Array, effects: Sequence[EffectT]) -> Array:
        """(M,) residual before it is made white: measured minus predicted."""
        return np.asarray(self.measured - self.predict(x, effects))

    def evaluate(self, x: Array, effects: tuple[EffectT, ...]) -> tuple[Array, Array]:
        """White residual (M,) and its derivative (M, p); by central differences by default."""
        by_x = central_differences(
            lambda at: self.lack(at, effects), x, _STEP * self.scales(effects)
        )
        return self.whiten(self.lack(x, effects)), self.whiten(by_x)

    def prior_rows(self, effects: tuple[EffectT, ...]) -> tuple[Array, Array]:
        """Rows R (n, p) and values v (n,) with which the prior adds |R x + v|^2."""
        stds = self.prior_stds(effects)
        rows = np.zeros((len(stds), len(self.own) + len(stds)))
        rows[:, len(self.own) :] = np.diag(1.0 / stds)
        return rows, np.zeros(len(stds))

    def system(self, x: Array, effects: tuple[EffectT, ...]) -> tuple[Array, Array]:
        """Residual and derivative: rows of the data, then rows of the prior."""
        residual, jacobian = self.evaluate(x, effects)
        rows, values = self.prior_rows(effects)
        return np.append(residual, rows @ x + values), np.concatenate([jacobian, rows])

    def prior_stds(self, effects: Sequence[EffectT]) -> Array:
        """(k,) of all parameters of effects."""
        return np.array([p.prior_std for e in effects for p in self.parameters_of(e)], dtype=float)

    def scales(self, effects: Sequence[EffectT]) -> Array:
        """(p,) plausible size of each parameter."""
        return np.concatenate([self.own_scales, self.prior_stds(effects)])

    @property
    def x(self) -> Array:
        """(p,) all parameters, [own, theta ...]."""
        return np.concatenate([self.own, *self.theta])

    @cached_property
    def evaluated(self) -> tuple[Array, Array]:
        """White residual and Jacobian, rows of the data, then rows of the prior."""
        return self.system(self.x, self.effects)

    @property
    def residual(self) -> Array:
        """(M,) white residual."""
        return self.evaluated[0][: len(self.time)]

    @property
    def jacobian(self) -> Array:
        """(M, p) derivative by all parameters."""
        return self.evaluated[1][: len(self.time)]

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects that the model has."""
        return tuple(effect.name for effect in self.effects)

    @cached_property
    def freedom(self) -> float:
        """Number of effect parameters that the data determine better than their prior."""
        if not self.effects:
            return 0.0
        return effect_freedom(self.jacobian, self.prior_stds(self.effects), len(self.own))

    @property
    def covariance(self) -> Array:
        """(p, p) of all parameters, widened by the misfit."""
        jacobian, (rows, _) = self.jacobian, self.prior_rows(self.effects)
        misfit = max(1.0, float(np.mean(self.residual**2)))
        return np.asarray(misfit * np.linalg.pinv(jacobian.T @ jacobian + rows.T @ rows))

    def parameters(self) -> ParameterTable:
        """{effect: {parameter: {"value", "std", "unit"}}}; own parameters that have names first."""
        values, covariance = self.x, self.covariance
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        names = [(k, *name) for k, name in enumerate(self.own_names)]
        first = len(self.own)
        for effect in self.effects:
            own = self.parameters_of(effect)
            names += [(first + k, effect.name, p.name, p.unit) for k, p in enumerate(own)]
            first += len(own)
        table: ParameterTable = {}
        for k, group, name, unit in names:
            entry = {"value": float(values[k]), "std": float(spread[k]), "unit": unit}
            table.setdefault(group, {})[name] = entry
        first = len(self.own)
        for effect in self.effects:
            keys = [p.name for p in self.parameters_of(effect)]
            rows = slice(first, first + len(keys))
            first += len(keys)
            for total in self.sums_of(effect):
                value, std = total.entry(keys, values[rows], covariance[rows, rows])
                entry = {"value": value, "std": std, "unit": total.unit}
                table[effect.name][total.name] = entry | {"sum_of": list(total.members)}
        return table

    def is_possible(self, name: str) -> bool:
        """All parameters are possible by default."""
        return True

    def moved_by(self, other: ResidualModel) -> float:
        """Largest change of the parameters that both fits have, in standard deviations of this."""
        if not isinstance(other, type(self)):
            return np.inf
        spread = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return float(np.max(np.abs(other.x[: len(self.x)] - self.x) / spread, initial=0.0))

    def sentence(self, name: str) -> str:
        """What an effect does, as a clause."""
        effect = self.effect_named(name)
        return effect.sentence or effect.formula

    def families(self, names: Sequence[str] | None = None) -> list[Family]:
        """Families of the effects that the model lacks."""
        wanted = [name for name in (names or self.catalogue) if name not in self.effect_names]
        return [family for name in wanted for family in self.families_of(name)]

    def with_effect(self, family: Family, coefficients: Array) -> Self:
        """Fit with one more effect at fixed whitening."""
        start = self.guess(family, coefficients)
        return self.fitted_from((*self.effects, family.source), (*self.theta, start))

    def without_effect(self, name: str) -> Self:
        """Fit with one effect less at fixed whitening."""
        kept = [(e, t) for e, t in zip(self.effects, self.theta, strict=True) if e.name != name]
        return self.fitted_from(tuple(e for e, _ in kept), tuple(t for _, t in kept))

    def fitted_from(self, effects: tuple[EffectT, ...], theta: tuple[Array, ...]) -> Self:
        """Fit all parameters at fixed whitening, from the present own ones and these."""
        found, _ = levenberg_marquardt(
            lambda x: self.system(x, effects),
            np.concatenate([self.own, *theta]),
            self.iterations,
            self.tolerance,
        )
        own, found_theta = split_parameters(found, len(self.own), theta)
        return self.with_parameters(own, effects, found_theta)

    def separating_motion(self, rivals: Sequence[ResidualModel]) -> dict[str, Any] | None:
        """Plan of what would tell this model from others, or None if nothing would."""
        return self.plan_against([rival for rival in rivals if isinstance(rival, type(self))])


def split_parameters(x: Array, own: int, theta: Sequence[Array]) -> tuple[Array, tuple[Array, ...]]:
    """Take x = [own, theta ...] apart, with as many values for each effect as ``theta`` has."""
    first, *parts = np.split(x, np.cumsum([own, *(len(part) for part in theta)])[:-1])
    return first, tuple(parts)


def effect_freedom(jacobian: Array, prior_stds: Array, own: int) -> float:
    """Number of effect parameters that data determine better than their prior.

    The trace of J^T J (J^T J + S^-2)^-1 for the part of their columns J beside the own ones, with
    the standard deviations S of the prior.

    Args:
        jacobian: (M, own + k) white derivative by own parameters, then by those of effects.
        prior_stds: (k,) before the data.
        own: number of own parameters.
    """
    columns = jacobian[:, own:] * prior_stds
    shared = orthonormal(jacobian[:, :own]).T @ columns
    values = np.maximum(np.linalg.eigvalsh(columns.T @ columns - shared.T @ shared), 0.0)
    return float(np.sum(values / (1.0 + values)))
