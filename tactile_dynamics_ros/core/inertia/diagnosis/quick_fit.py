"""Quick fits of a held object: effects at the denoised signals and whitening of one full fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel, whiten_stretches
from tactile_dynamics_ros.core.inertia.batch.uncertainty import HOLD
from tactile_dynamics_ros.core.inertia.residuals.repeated_whitening import RepeatedWhitening
from tactile_dynamics_ros.core.numerics.least_squares import rotated
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import log_cholesky_jacobian


@dataclass(frozen=True)
class Whitening:
    """The fitted model that whitens, and the white columns computed on it so far.

    Attributes:
        model: thoroughly fitted.
        columns: white screening bases by what they are screened as, with what they depend on.
    """

    model: FittedModel
    columns: dict[str, tuple[tuple[object, ...], Array]] = field(default_factory=dict)

    @cached_property
    def regressor(self) -> Array:
        """(M, 10) white regressor of the load alone."""
        return self.whiten([s.problem.regressor for s in self.model.stretches])

    @cached_property
    def start(self) -> Array:
        """(M,) white residual of the model plus its effects at the denoised samples."""
        model = self.model
        present = PresentEffects(model.effects, model.theta)
        total = [present.wrench(samples, model.phi) for samples in model.samples]
        return model.white_residual + self.whiten(total)

    @cached_property
    def repeated(self) -> RepeatedWhitening:
        """White columns that fits at this whitening have in common."""
        # not of self.whiten: in a cycle a hundred megabytes stay until the collector finds them
        return RepeatedWhitening(partial(whiten_stretches, self.model.stretches))

    def whiten(self, values: Sequence[Array]) -> Array:
        """White form of values (N, 6, ...) per stretch."""
        return whiten_stretches(self.model.stretches, values)

    def family_columns(self, effect: Effect, present: PresentEffects) -> Array:
        """White screening basis of one reading beside effects of a model.

        In single precision: of three minutes it takes 250 MB, and noise is 1e7 times its rounding.
        """
        name, key = effect.screened_as, present.influence_on(effect)
        if name not in self.columns or self.columns[name][0] != key:
            phi, basis = self.model.phi, []
            for samples in self.model.samples:
                found = effect.screening_basis(present.seen_by(effect, samples, phi), phi)
                basis.append(present.as_shown(effect, samples, found))
            self.columns[name] = (key, self.whiten(basis).astype(np.float32))
        return self.columns[name][1]


@dataclass(frozen=True)
class EffectBeside:
    """An effect beside others.

    Attributes:
        effect: that is evaluated.
        present: the others; the effect may be one of them.
        seen: samples of each stretch as the effect sees them.
    """

    effect: Effect
    present: PresentEffects
    seen: tuple[WrenchSamples, ...]

    @classmethod
    def of(
        cls,
        effect: Effect,
        present: PresentEffects,
        samples: Sequence[WrenchSamples],
        phi: Array,
    ) -> EffectBeside:
        """See the samples of each stretch at dynamic parameters (10,)."""
        return cls(effect, present, tuple(present.seen_by(effect, s, phi) for s in samples))

    def shown(
        self, law: Callable[[WrenchSamples, Array, Array], Array], phi: Array, theta: Array
    ) -> list[Array]:
        """Values of a law of the effect per stretch, as late as the others make sensors."""
        return [self.present.as_shown(self.effect, s, law(s, phi, theta)) for s in self.seen]


class FrozenSystem:
    """Residual and Jacobian by [phi, theta] at fixed denoised signals and whitening, with prior.

    The prior of phi is that of the fitted model, linear about it.
    """

    def __init__(self, whitening: Whitening, effects: tuple[Effect, ...]) -> None:
        self._whitening, self._effects = whitening, effects
        self._model, self._repeated = whitening.model, whitening.repeated
        samples = self._model.stretches[0].problem.samples
        self._counts = [len(effect.parameters(samples)) for effect in effects]
        stds = [p.prior_std for effect in effects for p in effect.parameters(samples)]
        self._prior_rows, self._prior_values = self._prior(np.array(stds, dtype=float))

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Rows of the data, then rows of the prior."""
        whitening, phi = self._whitening, x[:10]
        residual = whitening.start + whitening.regressor @ (phi - self._model.phi)
        jacobian = np.empty((len(residual), len(x)))
        jacobian[:, :10] = whitening.regressor
        theta = np.split(x[10:], np.cumsum(self._counts)[:-1])
        present = PresentEffects(self._effects, theta if self._effects else ())
        total = [present.wrench(samples, phi) for samples in self._model.samples]
        residual = residual - whitening.whiten(total)
        first = 10
        for effect, value in zip(present.effects, present.theta, strict=True):
            beside = EffectBeside.of(effect, present, self._model.samples, phi)
            by_phi, by_theta = self.white_derivatives(beside, phi, value)
            jacobian[:, first : first + len(value)] = -by_theta
            if by_phi is not None:
                jacobian[:, :10] -= by_phi
            first += len(value)
        prior = self._prior_rows @ x + self._prior_values
        return np.concatenate([residual, prior]), np.concatenate([jacobian, self._prior_rows])

    def white_wrench(self, beside: EffectBeside, phi: Array, theta: Array) -> Array:
        """White Delta of an effect beside others."""
        return self._whitening.whiten(beside.shown(beside.effect.wrench, phi, theta))

    def white_derivatives(
        self, beside: EffectBeside, phi: Array, theta: Array
    ) -> tuple[Array | None, Array]:
        """White derivatives of that Delta by phi (None if zero) and theta."""
        effect, repeated = beside.effect, self._repeated
        by_phi = beside.shown(effect.inertia_jacobian, phi, theta)
        return (
            repeated((effect.label, "phi"), by_phi) if any(map(np.any, by_phi)) else None,
            repeated.jacobian(effect, beside.present, beside.seen, phi, theta),
        )

    def _prior(self, stds: Array) -> tuple[Array, Array]:
        model = self._model
        to_xi = np.linalg.inv(log_cholesky_jacobian(model.xi)) / model.prior.std[:, None]
        keep = np.concatenate([np.eye(10), HOLD * model.unexcited.T])
        rows = np.zeros((len(keep) + len(stds), 10 + len(stds)))
        rows[: len(keep), :10] = keep @ to_xi
        rows[len(keep) :, 10:] = np.diag(1.0 / stds)
        centre = (model.xi - model.prior.mean) / model.prior.std
        values = np.concatenate([keep @ (centre - to_xi @ model.phi), np.zeros(len(stds))])
        return rows, values


class WhitenedModel(Protocol):
    """A held object with effects at a fixed whitening, as quick fits and plans need it."""

    @property
    def whitening(self) -> Whitening:
        """The thoroughly fitted model at which signals are denoised and whitened."""

    @property
    def phi(self) -> Array:
        """(10,) dynamic parameters."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the model."""

    @property
    def theta(self) -> tuple[Array, ...]:
        """Their parameters."""

    @property
    def fitted(self) -> FittedModel:
        """The thorough fit behind it."""

    @property
    def samples(self) -> WrenchSamples:
        """Denoised samples of the first stretch."""

    @property
    def evaluated(self) -> tuple[Array, Array]:
        """White residual and Jacobian, rows of the data, then rows of the prior."""

    @property
    def time(self) -> Array:
        """(M,) s."""


class ExtendedSystem:
    """Residual and Jacobian by the change of a model's parameters, linear, and a new effect's."""

    def __init__(self, model: WhitenedModel, effect: Effect) -> None:
        self._model = model
        present = PresentEffects(model.effects, model.theta)
        self._beside = EffectBeside.of(effect, present, model.fitted.samples, model.phi)
        self._frozen = FrozenSystem(model.whitening, model.effects)
        self._residual, self._jacobian = model.evaluated
        stds = [p.prior_std for p in effect.parameters(model.samples)]
        self._prior = np.diag(1.0 / np.array(stds, dtype=float))
        self.present = self._jacobian.shape[1]

    def square(self, x: Array) -> float:
        """Squared white residual of the data."""
        residual = self._moved(x)[: len(self._model.time)]
        return float(residual @ residual)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Rows of the data, then rows of the priors."""
        change, theta = x[: self.present], x[self.present :]
        phi, residual = self._model.phi + change[:10], self._moved(x)
        by_phi, by_theta = self._frozen.white_derivatives(self._beside, phi, theta)
        rows, count = len(by_theta), len(theta)
        jacobian = np.zeros((len(residual) + count, len(x)))
        jacobian[: len(residual), : self.present] = self._jacobian
        jacobian[:rows, self.present :] = -by_theta
        if by_phi is not None:
            jacobian[:rows, :10] -= by_phi
        jacobian[len(residual) :, self.present :] = self._prior
        return np.concatenate([residual, self._prior @ theta]), jacobian

    def _moved(self, x: Array) -> Array:
        """Rows of the data, then rows of the prior of the model."""
        change, theta = x[: self.present], x[self.present :]
        delta = self._frozen.white_wrench(self._beside, self._model.phi + change[:10], theta)
        residual = self._residual + self._jacobian @ change
        residual[: len(delta)] -= delta
        return np.asarray(residual)


class FactoredSystem:
    """`ExtendedSystem` of an effect with fixed columns: rotated to as many rows as columns."""

    def __init__(self, model: WhitenedModel, effect: Effect, columns: Array) -> None:
        residual, jacobian = model.evaluated
        rows, self.present = len(columns), jacobian.shape[1]
        self._effect, self._samples = effect, model.samples
        data = np.concatenate([jacobian[:rows], residual[:rows, None], -columns], axis=1)
        self._data = rotated(data)
        self._prior_rows, self._prior_values = jacobian[rows:], residual[rows:]
        stds = [p.prior_std for p in effect.parameters(model.samples)]
        self._prior = np.diag(1.0 / np.array(stds, dtype=float))

    def square(self, x: Array) -> float:
        """Squared white residual of the data."""
        residual = self._moved(x)
        return float(residual @ residual)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Rows of the data, then rows of the priors."""
        change, theta = x[: self.present], x[self.present :]
        factored = self._effect.factored(self._samples, theta)
        assert factored is not None
        by_theta = self._data[:, self.present + 1 :] @ factored[1]
        by_change = np.concatenate([self._data[:, : self.present], self._prior_rows])
        values = self._prior_values + self._prior_rows @ change
        residual = np.concatenate([self._moved(x), values, self._prior @ theta])
        jacobian = np.zeros((len(residual), len(x)))
        jacobian[: len(by_change), : self.present] = by_change
        jacobian[: len(by_theta), self.present :] = by_theta
        jacobian[len(by_change) :, self.present :] = self._prior
        return residual, jacobian

    def _moved(self, x: Array) -> Array:
        numbers = self._effect.coefficients(self._samples, x[self.present :])
        return np.asarray(self._data @ np.concatenate([x[: self.present], [1.0], numbers]))


def extended_system(model: WhitenedModel, effect: Effect) -> ExtendedSystem | FactoredSystem:
    """The system of a model with one effect more, as small as the effect allows."""
    zero = effect.zero(model.samples)
    if effect.coefficients(model.samples, zero) is None:
        return ExtendedSystem(model, effect)
    present = PresentEffects(model.effects, model.theta)
    beside = EffectBeside.of(effect, present, model.fitted.samples, model.phi)
    white = model.whitening.repeated.factored(effect, present, beside.seen, zero)
    return (
        ExtendedSystem(model, effect) if white is None else FactoredSystem(model, effect, white[0])
    )
