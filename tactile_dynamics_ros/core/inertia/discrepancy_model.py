"""The held object as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.model import (
    Family,
    ParameterTable,
    ResidualModel,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.screening import orthonormal
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.registry import create_effect, registered_names
from tactile_dynamics_ros.core.inertia.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.fitting import fit_model
from tactile_dynamics_ros.core.inertia.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.inertia.separating_motion import plan_separation
from tactile_dynamics_ros.core.inertia.term_library import wrench_terms
from tactile_dynamics_ros.core.inertia.uncertainty import HOLD
from tactile_dynamics_ros.core.inertia.wrench_residuals import wrench_residuals
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    log_cholesky,
    log_cholesky_jacobian,
    pseudo_inertia,
)

Array = NDArray[np.float64]

_MOST_REFINEMENTS = 8
_SETTLED = 0.995
_QUICK_ITERATIONS = 12
_QUICK_TOLERANCE = 2e-5
_JOINT_ITERATIONS = 40
_CURVED = 1.01
_FLATTEST = 0.1


@dataclass(frozen=True)
class _Whitening:
    """The fitted model that whitens, and the white columns computed on it so far."""

    model: FittedModel
    columns: dict[str, tuple[Effect, Array]] = field(default_factory=dict)

    @cached_property
    def regressor(self) -> Array:
        """(M, 10) white regressor of the load alone."""
        return self._whiten([b.problem.regressor for b in self.model.blocks])

    @cached_property
    def start(self) -> Array:
        """(M,) white residual of the model plus its effects at the denoised samples."""
        model = self.model
        total = [np.zeros((b.problem.count, 6)) for b in model.blocks]
        for effect, theta in zip(model.effects, model.theta, strict=True):
            for delta, block in zip(total, model.blocks, strict=True):
                delta += effect.wrench(block.problem.samples, model.phi, theta)
        return model.white_residual + self._whiten(total)

    def _whiten(self, values: Sequence[Array]) -> Array:
        parts = zip(self.model.blocks, values, strict=True)
        return np.concatenate([block.linearisation.whiten(value) for block, value in parts])

    def whiten(self, values: Sequence[Array]) -> Array:
        """White form of values (N, 6, ...) per block."""
        return self._whiten(values)

    def family_columns(self, effect: Effect) -> Array:
        """White screening basis of one reading."""
        if effect.label not in self.columns:
            phi = self.model.phi
            basis = [effect.screening_basis(b.problem.samples, phi) for b in self.model.blocks]
            self.columns[effect.label] = (effect, self._whiten(basis))
        return self.columns[effect.label][1]


@dataclass(frozen=True)
class HeldObjectModel:
    """Rigid body with effects: residuals at a fixed whitening, quick and thorough refits.

    Attributes:
        whitening: the thoroughly fitted model at which signals are denoised and whitened.
        phi: (10,) dynamic parameters; a quick fit may leave the bodies that can exist.
        effects: the effects of the model.
        theta: their parameters.
        catalogue: labels or names of the effects that may be tried.
    """

    whitening: _Whitening
    phi: Array
    effects: tuple[Effect, ...]
    theta: tuple[Array, ...]
    catalogue: tuple[str, ...]

    @classmethod
    def from_fit(
        cls, model: FittedModel, catalogue: Sequence[str] | None = None
    ) -> HeldObjectModel:
        """Wrap a fitted model.

        Args:
            model: of one recording.
            catalogue: effects that may be tried; all registered by default.
        """
        names = tuple(catalogue) if catalogue is not None else registered_names()
        return cls(_Whitening(model), model.phi, model.effects, model.theta, names)

    @property
    def fitted(self) -> FittedModel:
        """The thorough fit behind this model."""
        return self.whitening.model

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects that the model has."""
        return tuple(effect.name for effect in self.effects)

    @cached_property
    def time(self) -> Array:
        """(M,) s."""
        blocks = self.fitted.blocks
        times = [b.problem.grid[b.problem.valid] - b.problem.start for b in blocks]
        return np.repeat(np.concatenate(times), 6)

    @cached_property
    def _evaluated(self) -> tuple[Array, Array]:
        system = _FrozenSystem(self.whitening, self.effects)
        return system.evaluate(np.concatenate([self.phi, *self.theta]))

    @property
    def residual(self) -> Array:
        """(M,) white residual."""
        return self._evaluated[0][: len(self.time)]

    @property
    def jacobian(self) -> Array:
        """(M, 10 + k) derivative by phi and theta."""
        return self._evaluated[1][: len(self.time)]

    @cached_property
    def freedom(self) -> float:
        """Number of effect parameters that the data determine better than their prior."""
        if not self.effects:
            return 0.0
        load, own = self.jacobian[:, :10], self.jacobian[:, 10:] * self._prior_stds
        basis = orthonormal(load)
        own = own - basis @ (basis.T @ own)
        values = np.maximum(np.linalg.eigvalsh(own.T @ own), 0.0)
        return float(np.sum(values / (1.0 + values)))

    @property
    def _prior_stds(self) -> Array:
        return np.array([p.prior_std for e in self.effects for p in e.parameters(self.samples)])

    @property
    def samples(self) -> WrenchSamples:
        """Denoised samples of the first stretch."""
        return self.fitted.blocks[0].problem.samples

    def families(self, names: Sequence[str] | None = None) -> list[Family]:
        """Every reading, and every restriction of it, of effects that the model lacks."""
        wanted = [n for n in (names or self.catalogue) if n not in self.effect_names]
        return [family for name in wanted for family in self._families(name)]

    def _families(self, name: str) -> list[Family]:
        samples = self.samples
        found: list[tuple[Effect, str, Array, tuple[int, ...]]] = []
        for reading in create_effect(name).variants(samples):
            columns = self.whitening.family_columns(reading)
            found.append((reading, reading.label, columns, tuple(range(columns.shape[1]))))
            for restricted, kept in reading.restrictions(samples):
                found.append((restricted, reading.label, columns, kept))
        return [
            Family(name, effect.label, reading, columns, kept, len(found), effect, effect.rings)
            for effect, reading, columns, kept in found
        ]

    def with_effect(self, family: Family, coefficients: Array) -> HeldObjectModel:
        """Fit with one more effect at fixed whitening.

        The present effects are linear in the change of their parameters; where that proves too
        coarse, all are fitted jointly.
        """
        effect: Effect = family.source
        block = self.fitted.blocks[0]
        lacking = block.problem.residual(self.phi, self.effects, self.theta)
        start = effect.initial_guess(block.problem.samples, self.phi, coefficients, lacking)
        system = _ExtendedSystem(self, effect)
        solution, _ = levenberg_marquardt(
            system.evaluate,
            np.concatenate([np.zeros(system.present), start]),
            _QUICK_ITERATIONS,
            _QUICK_TOLERANCE,
        )
        moved = self._moved(solution[: system.present], effect, solution[system.present :])
        foreseen = system.evaluate(solution)[0][: len(self.time)]
        if moved.residual @ moved.residual <= _CURVED * foreseen @ foreseen:
            return moved
        return moved._fitted(moved.effects, moved.theta)

    def _moved(self, change: Array, effect: Effect, theta: Array) -> HeldObjectModel:
        """The model with its parameters changed and one effect more."""
        sizes = np.cumsum([10, *[len(t) for t in self.theta]])
        parts = np.split(change, sizes[:-1])
        moved = [t + d for t, d in zip(self.theta, parts[1:], strict=True)]
        return HeldObjectModel(
            self.whitening,
            self.phi + parts[0],
            (*self.effects, effect),
            (*moved, theta),
            self.catalogue,
        )

    def without_effect(self, name: str) -> HeldObjectModel:
        """Fit with one effect less at fixed whitening."""
        kept = [(e, t) for e, t in zip(self.effects, self.theta, strict=True) if e.name != name]
        return self._fitted(tuple(e for e, _ in kept), tuple(t for _, t in kept))

    def refined(self) -> HeldObjectModel:
        """Fit again with new denoised signals and whitening."""
        problems = [
            b.problem.denoised({}).balanced(self.phi, self.effects, self.theta)
            for b in self.fitted.blocks
        ]
        xi, theta = _nearest_body(self.phi, self.fitted.phi), self.theta
        best: FittedModel | None = None
        for _ in range(_MOST_REFINEMENTS):
            model = fit_model(problems, self.effects, theta, xi, 2)
            if best is not None and model.whitened_rms > _SETTLED * best.whitened_rms:
                best = min(best, model, key=lambda fitted: fitted.whitened_rms)
                break
            best = model
            problems = [b.problem for b in model.blocks]
            xi, theta = model.xi, model.theta
        assert best is not None
        return HeldObjectModel.from_fit(best, self.catalogue)

    def parameters(self) -> ParameterTable:
        """{effect: {parameter: {"value", "std", "unit"}}} from the quick covariance."""
        jacobian = self.jacobian
        stds = np.concatenate([np.full(10, np.inf), self._prior_stds])
        information = jacobian.T @ jacobian + np.diag(stds**-2.0)
        scale = np.sqrt(np.diag(information))
        covariance = np.linalg.pinv(information / np.outer(scale, scale)) / np.outer(scale, scale)
        spread = np.sqrt(np.maximum(np.diag(covariance)[10:], 0.0))
        rms = max(1.0, float(np.sqrt(np.mean(self.residual**2))))
        result: ParameterTable = {}
        first = 0
        for effect, theta in zip(self.effects, self.theta, strict=True):
            result[effect.name] = {
                p.name: {"value": float(v), "std": float(rms * s), "unit": p.unit}
                for p, v, s in zip(
                    effect.parameters(self.samples), theta, spread[first:], strict=False
                )
            }
            first += len(theta)
        return result

    def sentence(self, name: str) -> str:
        """What an effect does to the object, as a clause."""
        effect = create_effect(name)
        return effect.sentence or effect.formula

    def residuals(self) -> Residuals:
        """Wrench residuals in body and world axes with what they may depend on."""
        xi = _nearest_body(self.phi, self.fitted.phi)
        model = replace(self.fitted, xi=xi, effects=self.effects, theta=self.theta)
        return wrench_residuals(model, self.residual.reshape(-1, 6))

    def library(self) -> list[Family]:
        """Simple functions of named quantities as wrenches."""
        terms = [list(wrench_terms(block.problem.samples)) for block in self.fitted.blocks]
        families = []
        for parts in zip(*terms, strict=True):
            columns = self.whitening.whiten([part.columns for part in parts])
            families.append(
                Family(
                    parts[0].quantity,
                    parts[0].label,
                    parts[0].label,
                    columns,
                    tuple(range(columns.shape[1])),
                    symbols=parts[0].symbols,
                    frame=parts[0].frame,
                )
            )
        return families

    def separating_motion(self, rivals: Sequence[ResidualModel]) -> dict[str, Any] | None:
        """Plan of the motion or re-grasp that would tell this model from others."""
        others = [rival for rival in rivals if isinstance(rival, HeldObjectModel)]
        return plan_separation(self, others)

    def _fitted(self, effects: tuple[Effect, ...], theta: tuple[Array, ...]) -> HeldObjectModel:
        system = _FrozenSystem(self.whitening, effects)
        start = np.concatenate([self.phi, *theta])
        solution, _ = levenberg_marquardt(
            system.evaluate, start, _JOINT_ITERATIONS, _QUICK_TOLERANCE
        )
        sizes = np.cumsum([10, *[len(t) for t in theta]])
        parts = np.split(solution, sizes[:-1])
        return HeldObjectModel(self.whitening, parts[0], effects, tuple(parts[1:]), self.catalogue)


class _ExtendedSystem:
    """Residual and Jacobian by the change of a model's parameters, linear, and a new effect's."""

    def __init__(self, model: HeldObjectModel, effect: Effect) -> None:
        self._model, self._effect = model, effect
        self._frozen = _FrozenSystem(model.whitening, model.effects)
        self._residual, self._jacobian = self._frozen.evaluate(
            np.concatenate([model.phi, *model.theta])
        )
        stds = [p.prior_std for p in effect.parameters(model.fitted.blocks[0].problem.samples)]
        self._prior = np.diag(1.0 / np.array(stds, dtype=float))
        self.present = self._jacobian.shape[1]

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Rows of the data, then rows of the priors."""
        change, theta = x[: self.present], x[self.present :]
        phi = self._model.phi + change[:10]
        delta, by_phi, by_theta = self._frozen.white_effect(self._effect, phi, theta)
        rows, count = len(delta), len(theta)
        residual = self._residual + self._jacobian @ change
        residual[:rows] -= delta
        jacobian = np.zeros((len(residual) + count, len(x)))
        jacobian[: len(residual), : self.present] = self._jacobian
        jacobian[:rows, self.present :] = -by_theta
        if by_phi is not None:
            jacobian[:rows, :10] -= by_phi
        jacobian[len(residual) :, self.present :] = self._prior
        return np.concatenate([residual, self._prior @ theta]), jacobian


class _FrozenSystem:
    """Residual and Jacobian by [phi, theta] at fixed denoised signals and whitening, with prior.

    The prior of phi is that of the fitted model, linear about it.
    """

    def __init__(self, whitening: _Whitening, effects: tuple[Effect, ...]) -> None:
        self._whitening, self._effects = whitening, effects
        self._model = whitening.model
        samples = self._model.blocks[0].problem.samples
        self._counts = [len(effect.parameters(samples)) for effect in effects]
        stds = [p.prior_std for effect in effects for p in effect.parameters(samples)]
        self._prior_rows, self._prior_values = self._prior(np.array(stds, dtype=float))

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Rows of the data, then rows of the prior."""
        whitening, phi = self._whitening, x[:10]
        residual = whitening.start + whitening.regressor @ (phi - self._model.phi)
        jacobian = np.empty((len(residual), len(x)))
        jacobian[:, :10] = whitening.regressor
        first = 10
        for effect, count in zip(self._effects, self._counts, strict=True):
            part = slice(first, first + count)
            delta, by_phi, by_theta = self.white_effect(effect, phi, x[part])
            residual = residual - delta
            jacobian[:, part] = -by_theta
            if by_phi is not None:
                jacobian[:, :10] -= by_phi
            first += count
        prior = self._prior_rows @ x + self._prior_values
        return np.concatenate([residual, prior]), np.concatenate([jacobian, self._prior_rows])

    def white_effect(
        self, effect: Effect, phi: Array, theta: Array
    ) -> tuple[Array, Array | None, Array]:
        """White Delta with its derivatives by phi (None if zero) and theta."""
        values, by_phi, by_theta = [], [], []
        for block in self._model.blocks:
            samples = block.problem.samples
            values.append(effect.wrench(samples, phi, theta))
            by_theta.append(effect.jacobian(samples, phi, theta))
            by_phi.append(effect.inertia_jacobian(samples, phi, theta))
        depends = any(np.any(part) for part in by_phi)
        white = self._whitening.whiten
        return white(values), white(by_phi) if depends else None, white(by_theta)

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


def _nearest_body(phi: Array, reference: Array) -> Array:
    """Log-Cholesky coordinates of phi with the eigenvalues of its pseudo-inertia made positive."""
    values, vectors = np.linalg.eigh(pseudo_inertia(phi))
    floor = _FLATTEST * np.linalg.eigvalsh(pseudo_inertia(reference))
    return log_cholesky(vectors * np.maximum(values, floor) @ vectors.T)
