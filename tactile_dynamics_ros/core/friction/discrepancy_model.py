"""Coulomb friction of a probed surface as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    Family,
    ParameterTable,
    ResidualModel,
    Residuals,
)
from tactile_dynamics_ros.core.friction.effects import CATALOGUE, FrictionEffect, friction_effect
from tactile_dynamics_ros.core.friction.separating_slips import plan_slips
from tactile_dynamics_ros.core.friction.slip_table import SlipTable

Array = NDArray[np.float64]

_ITERATIONS = 15
_STEP = 1e-5
_REFINEMENTS = 3


@dataclass(frozen=True)
class FrictionNoise:
    """What the forces of a slip are worth."""

    force_std: float = parameter(0.01, "of a tangential force at slip", "N", 1e-4, 1.0)
    relative_std: float = parameter(0.025, "scatter of single slips", "", 1e-4, 0.5)
    tilt_std_deg: float = parameter(5.0, "constant error of the force's direction", "deg", 0, 20)
    reading_std: float = parameter(
        0.004,
        "constant error of the force at slip, since the greatest ratio is taken",
        "N",
        0.0,
        1.0,
    )

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class FrictionModel:
    """T = mu N with static and kinetic coefficient, and effects; residual measured - predicted.

    The covariance of the residuals holds the scatter of single slips and what all slips share: one
    constant error of the force's direction, and one of the force that is read as that of the slip;
    its Cholesky factor makes them white.

    Attributes:
        slips: what was measured.
        mu: (2,) static and kinetic coefficient.
        effects: of the model. theta: their parameters.
        noise: what the forces are worth.
        whitening_mu: (2,) coefficients at which the covariance was taken.
        catalogue: names of the effects that may be tried.
    """

    slips: SlipTable
    mu: Array
    effects: tuple[FrictionEffect, ...]
    theta: tuple[Array, ...]
    noise: FrictionNoise
    whitening_mu: Array
    catalogue: tuple[str, ...]

    @classmethod
    def fit(
        cls,
        slips: SlipTable,
        effects: Sequence[str] = (),
        noise: FrictionNoise | None = None,
    ) -> FrictionModel:
        """Fit coefficients and named effects to the slips of a probe."""
        mu = np.median(slips.tangential / slips.normal, axis=0)
        chosen = tuple(friction_effect(name) for name in effects)
        theta = tuple(np.zeros(len(effect.parameters)) for effect in chosen)
        model = cls(slips, mu, chosen, theta, noise or FrictionNoise(), mu, tuple(CATALOGUE))
        return model.refined()

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects that the model has."""
        return tuple(effect.name for effect in self.effects)

    @cached_property
    def time(self) -> Array:
        """(2 N,) s, from the first slip."""
        return np.repeat(self.slips.time - self.slips.time[0], 2)

    @cached_property
    def _factor(self) -> Array:
        """Lower Cholesky factor (2 N, 2 N) of the residuals' covariance."""
        slips, noise, mu = self.slips, self.noise, self.whitening_mu
        own = noise.force_std**2 + (noise.relative_std * mu * slips.normal) ** 2
        steep = ((1.0 + mu**2) * slips.normal).reshape(-1)
        angle = np.repeat(slips.angle, 2)
        waves = steep[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        tilt = np.deg2rad(noise.tilt_std_deg) ** 2
        static = noise.reading_std * np.tile([1.0, 0.0], len(slips.time))
        shared = tilt * waves @ waves.T + np.outer(static, static)
        return np.linalg.cholesky(np.diag(own.reshape(-1)) + shared)

    def whiten(self, values: Array) -> Array:
        """White form of rows (2 N, ...)."""
        return np.asarray(np.linalg.solve(self._factor, values))

    def predict(self, x: Array, effects: Sequence[FrictionEffect], slips: SlipTable) -> Array:
        """Tangential force (N, 2) for parameters [mu_s, mu_k, theta ...]."""
        mu = x[:2]
        force, added = mu * slips.normal, np.zeros_like(slips.normal)
        first = 2
        for effect in effects:
            theta = x[first : first + len(effect.parameters)]
            force = force * effect.factor(slips, theta)
            added = added + effect.term(slips, mu, theta)
            first += len(theta)
        return np.asarray(force + added)

    @property
    def x(self) -> Array:
        """All parameters [mu_s, mu_k, theta ...]."""
        return np.concatenate([self.mu, *self.theta])

    def _evaluate(self, x: Array, effects: Sequence[FrictionEffect]) -> tuple[Array, Array]:
        """White residual (2 N,) and its derivative (2 N, p), by central differences."""
        measured = self.slips.tangential
        residual = self.whiten((measured - self.predict(x, effects, self.slips)).reshape(-1))
        columns = []
        for k in range(len(x)):
            step = np.zeros_like(x)
            step[k] = _STEP
            ahead = self.predict(x + step, effects, self.slips)
            behind = self.predict(x - step, effects, self.slips)
            columns.append(-(ahead - behind).reshape(-1) / (2.0 * _STEP))
        return residual, self.whiten(np.column_stack(columns))

    @cached_property
    def _evaluated(self) -> tuple[Array, Array]:
        return self._evaluate(self.x, self.effects)

    @property
    def residual(self) -> Array:
        """(2 N,) white residual."""
        return self._evaluated[0]

    @property
    def jacobian(self) -> Array:
        """(2 N, p) derivative by all parameters."""
        return self._evaluated[1]

    def _prior_information(self, effects: Sequence[FrictionEffect]) -> Array:
        stds = [p.prior_std for effect in effects for p in effect.parameters]
        return np.concatenate([np.zeros(2), np.array(stds, dtype=float) ** -2.0])

    def _solved(self, x: Array, effects: tuple[FrictionEffect, ...]) -> FrictionModel:
        """Gauss-Newton from ``x`` with the prior of the effects; steps that harm are halved."""
        prior = self._prior_information(effects)

        def cost(at: Array, residual: Array) -> float:
            return float(residual @ residual + prior @ at**2)

        residual, jacobian = self._evaluate(x, effects)
        for _ in range(_ITERATIONS):
            information = jacobian.T @ jacobian + np.diag(prior + 1e-9)
            step = -np.linalg.solve(information, jacobian.T @ residual + prior * x)
            for _ in range(6):
                ahead = self._evaluate(x + step, effects)
                if cost(x + step, ahead[0]) <= cost(x, residual):
                    break
                step = 0.5 * step
            else:
                break
            x, (residual, jacobian) = x + step, ahead
            if float(np.max(np.abs(step))) < 1e-7:
                break
        sizes = np.cumsum([2, *[len(effect.parameters) for effect in effects]])
        parts = np.split(x, sizes[:-1])
        return replace(self, mu=parts[0], effects=effects, theta=tuple(parts[1:]))

    def refined(self) -> FrictionModel:
        """Fit again with the covariance at the fitted coefficients."""
        model = self
        for _ in range(_REFINEMENTS):
            model = replace(model._solved(model.x, model.effects), whitening_mu=model.mu)
        return model

    @cached_property
    def freedom(self) -> float:
        """Number of effect parameters that the data determine better than their prior."""
        if not self.effects:
            return 0.0
        own = self.jacobian[:, 2:] / np.sqrt(self._prior_information(self.effects)[2:])
        basis, _ = np.linalg.qr(self.jacobian[:, :2])
        own = own - basis @ (basis.T @ own)
        values = np.maximum(np.linalg.eigvalsh(own.T @ own), 0.0)
        return float(np.sum(values / (1.0 + values)))

    @property
    def noise_level(self) -> float:
        """The same for all: no effect of friction is one by the noise that it makes."""
        return 0.0

    def families(self, names: Sequence[str] | None = None) -> list[Family]:
        """The linear form of every effect that the model lacks."""
        wanted = [n for n in (names or self.catalogue) if n not in self.effect_names]
        return [self._family(friction_effect(name)) for name in wanted]

    def _family(self, effect: FrictionEffect) -> Family:
        count = len(effect.parameters)
        start = np.concatenate([self.x, np.zeros(count)])
        linear = -self._evaluate(start, (*self.effects, effect))[1][:, -count:]
        curved = effect.curvature(self.slips, self.mu)
        columns = np.hstack([linear, self.whiten(curved.reshape(len(linear), -1))])
        return Family(
            effect.name,
            effect.name,
            effect.name,
            columns,
            tuple(range(columns.shape[1])),
            source=effect,
        )

    def with_effect(self, family: Family, coefficients: Array) -> FrictionModel:
        """Fit with one more effect at fixed whitening."""
        effect: FrictionEffect = family.source
        guess = np.clip(coefficients[: len(effect.parameters)], -0.4, 0.4)
        return self._solved(np.concatenate([self.x, guess]), (*self.effects, effect))

    def without_effect(self, name: str) -> FrictionModel:
        """Fit with one effect less at fixed whitening."""
        kept = [(e, t) for e, t in zip(self.effects, self.theta, strict=True) if e.name != name]
        start = np.concatenate([self.mu, *[t for _, t in kept]])
        return self._solved(start, tuple(e for e, _ in kept))

    def parameters(self) -> ParameterTable:
        """{effect: {parameter: {"value", "std", "unit"}}}; ``coulomb`` has the coefficients."""
        information = self.jacobian.T @ self.jacobian
        information += np.diag(self._prior_information(self.effects))
        rms = max(1.0, float(np.sqrt(np.mean(self.residual**2))))
        spread = rms * np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)), 0.0))
        names = [("coulomb", "mu_static", ""), ("coulomb", "mu_kinetic", "")]
        names += [(e.name, p.name, p.unit) for e in self.effects for p in e.parameters]
        table: ParameterTable = {}
        for (effect, name, unit), value, std in zip(names, self.x, spread, strict=True):
            entry = {"value": float(value), "std": float(std), "unit": unit}
            table.setdefault(effect, {})[name] = entry
        return table

    def sentence(self, name: str) -> str:
        """What an effect does, as a clause."""
        return friction_effect(name).sentence

    def residuals(self) -> Residuals:
        """Residuals of the force at slip and while sliding, with what was going on."""
        slips = self.slips
        error = slips.tangential - self.predict(self.x, self.effects, slips)
        direction = [np.cos(slips.angle), np.sin(slips.angle)]
        twice = [np.cos(2.0 * slips.angle), np.sin(2.0 * slips.angle)]
        return Residuals(
            time=slips.time - slips.time[0],
            white=self.residual.reshape(-1, 2),
            physical=error,
            channels=("static", "kinetic"),
            units=("N", "N"),
            conditions=(
                Condition("normal force", "N", slips.normal[:, 0]),
                Condition("sliding speed", "m/s", slips.speed),
                Condition("direction cosine", "", direction[0]),
                Condition("direction sine", "", direction[1]),
                Condition("time", "s", slips.time - slips.time[0]),
            ),
            drivers=np.column_stack([*direction, *twice, slips.normal[:, 0], slips.speed]),
        )

    def library(self) -> list[Family]:
        """Simple functions of named quantities, for a residual that no effect explains."""
        slips = self.slips
        quantities = {
            "time": (slips.time - slips.time.mean())[:, None] * slips.normal,
            "normal_force_squared": slips.normal**2,
            "sliding_speed": slips.speed[:, None] * slips.normal,
        }
        symbols = {"time": "N t", "normal_force_squared": "N^2", "sliding_speed": "N v"}
        return [
            Family(n, n, n, self.whiten(c.reshape(-1, 1)), (0,), symbols=(symbols[n],))
            for n, c in quantities.items()
        ]

    def separating_motion(self, rivals: Sequence[ResidualModel]) -> dict[str, Any] | None:
        """The slip that would tell this model from others."""
        others = [rival for rival in rivals if isinstance(rival, FrictionModel)]
        return plan_slips(self._of_slips, [rival._of_slips for rival in others], self._scatter)

    def _of_slips(self, slips: SlipTable) -> Array:
        return self.predict(self.x, self.effects, slips)

    def _scatter(self, slips: SlipTable) -> Array:
        """Standard deviation (N, 2) of measured forces of single slips, N."""
        noise = self.noise
        return np.hypot(noise.force_std, noise.relative_std * self.mu * slips.normal)
