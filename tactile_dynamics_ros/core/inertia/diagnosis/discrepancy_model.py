"""The held object as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Family,
    Misfit,
    ParameterTable,
    ResidualModel,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.trials import square
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.effects.registry import create_effect, registered_names
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.fitting import fit_model, nearest_body
from tactile_dynamics_ros.core.inertia.batch.refinement import refine
from tactile_dynamics_ros.core.inertia.batch.uncertainty import effect_freedom, misfit_inflation
from tactile_dynamics_ros.core.inertia.diagnosis.quick_fit import (
    FrozenSystem,
    Whitening,
    extended_system,
)
from tactile_dynamics_ros.core.inertia.diagnosis.separating_motion import plan_separation
from tactile_dynamics_ros.core.inertia.diagnosis.term_library import wrench_terms
from tactile_dynamics_ros.core.inertia.diagnosis.wrench_residuals import wrench_residuals
from tactile_dynamics_ros.core.inertia.residuals.systematic import PresumedErrors
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt

Array = NDArray[np.float64]

_QUICK_ITERATIONS = 12
"""Steps of a quick fit of one more effect at fixed whitening, at most. It ranks candidates; what is
chosen is fitted thoroughly. Fewer rank effects with memory by unfinished fits, more take time for
each candidate."""
_QUICK_TOLERANCE = 2e-5
"""Relative fall of the squared error below which a quick fit has converged. The error of 30 s at
100 Hz is a sum of 18000 squares, so that it is off by 0.4 at most, far below the differences (tens)
by which effects are told apart."""
_JOINT_ITERATIONS = 40
"""Steps of a joint quick fit of all effects, at most. It is done only where linear changes of the
present effects were too coarse, and starts farther away."""
_CURVED = 1.01
"""Squared error after a linear change of the present effects, over what it promised, from which all
effects are fitted jointly: 1 % more. Nearer to 1 more candidates pay for a joint fit; higher,
effects that bend are ranked too low."""


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

    whitening: Whitening
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
        return cls(Whitening(model), model.phi, model.effects, model.theta, names)

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
    def evaluated(self) -> tuple[Array, Array]:
        """White residual and Jacobian, rows of the data, then rows of the prior."""
        system = FrozenSystem(self.whitening, self.effects)
        return system.evaluate(np.concatenate([self.phi, *self.theta]))

    @property
    def residual(self) -> Array:
        """(M,) white residual."""
        return self.evaluated[0][: len(self.time)]

    @property
    def jacobian(self) -> Array:
        """(M, 10 + k) derivative by phi and theta."""
        return self.evaluated[1][: len(self.time)]

    @cached_property
    def freedom(self) -> float:
        """Number of effect parameters that the data determine better than their prior."""
        if not self.effects:
            return 0.0
        return effect_freedom(self.jacobian, self._prior_stds**-2.0)

    @property
    def _prior_stds(self) -> Array:
        return np.array([p.prior_std for e in self.effects for p in e.parameters(self.samples)])

    @property
    def samples(self) -> WrenchSamples:
        """Denoised samples of the first stretch."""
        return self.fitted.blocks[0].problem.samples

    @property
    def noise_level(self) -> float:
        """That of the thorough fit behind this model."""
        return self.fitted.misfit.noise_level

    def families(self, names: Sequence[str] | None = None) -> list[Family]:
        """Every reading, and every restriction of it, of effects that the model lacks."""
        wanted = [n for n in (names or self.catalogue) if n not in self.effect_names]
        return [family for name in wanted for family in self._families(name)]

    def _families(self, name: str) -> list[Family]:
        samples, present = self.samples, PresentEffects(self.effects, self.theta)
        found: list[tuple[Effect, str, Array, tuple[int, ...]]] = []
        for reading in create_effect(name).variants(samples):
            columns = self.whitening.family_columns(reading, present)
            found.append((reading, reading.label, columns, tuple(range(columns.shape[1]))))
            for restricted, kept in reading.restrictions(samples):
                found.append((restricted, reading.label, columns, kept))
        return [
            Family(
                name,
                effect.label,
                reading,
                columns,
                kept,
                len(found),
                effect,
                rings=effect.rings,
                lasting=effect.lasting,
            )
            for effect, reading, columns, kept in found
        ]

    def with_effect(self, family: Family, coefficients: Array) -> HeldObjectModel:
        """Fit with one more effect at fixed whitening.

        The present effects are linear in the change of their parameters; where that proves too
        coarse, all are fitted jointly, from where they were if the change leads astray.
        """
        effect: Effect = family.source
        block = self.fitted.blocks[0]
        lacking = block.problem.residual(self.phi, self.effects, self.theta)
        start = effect.initial_guess(block.problem.samples, self.phi, coefficients, lacking)
        system = extended_system(self, effect)
        solution, _ = levenberg_marquardt(
            system.evaluate,
            np.concatenate([np.zeros(system.present), start]),
            _QUICK_ITERATIONS,
            _QUICK_TOLERANCE,
        )
        change, theta = np.split(solution, [system.present])
        moved = self._moved(change, effect, theta)
        if square(moved) <= _CURVED * system.square(solution):
            return moved
        held = self._moved(np.zeros_like(change), effect, theta)
        nearer = held if square(held) < square(moved) else moved
        return nearer._fitted(nearer.effects, nearer.theta)

    def _moved(self, change: Array, effect: Effect, theta: Array) -> HeldObjectModel:
        """The model with its parameters changed and one effect more."""
        by_phi, by_theta = _split(change, self.theta)
        moved = [t + d for t, d in zip(self.theta, by_theta, strict=True)]
        return HeldObjectModel(
            self.whitening,
            self.phi + by_phi,
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
        return self._refined

    @cached_property
    def _refined(self) -> HeldObjectModel:
        problems = [
            b.problem.balanced(self.phi, self.effects, self.theta) for b in self.fitted.blocks
        ]
        xi, theta = nearest_body(self.phi, self.fitted.phi), self.theta
        model = fit_model(problems, self.effects, theta, xi, 2)
        foreseen = max(self.fitted.whitened_rms, Misfit.of(self).rms)
        refined = refine(model, self.fitted.misfit, foreseen)
        return HeldObjectModel.from_fit(refined, self.catalogue)

    def parameters(self) -> ParameterTable:
        """{effect: {parameter: {"value", "std", "unit"}}}, honest where the model does not fit."""
        spread = np.sqrt(np.maximum(np.diag(self._covariance)[10:], 0.0))
        result: ParameterTable = {}
        first = 0
        for effect, theta in zip(self.effects, self.theta, strict=True):
            result[effect.name] = {
                p.name: {"value": float(v), "std": float(s), "unit": p.unit}
                for p, v, s in zip(
                    effect.parameters(self.samples), theta, spread[first:], strict=False
                )
            }
            first += len(theta)
        return result

    @property
    def _covariance(self) -> Array:
        """(10 + k, 10 + k) of [phi, theta] at the fixed whitening, widened by misfit."""
        jacobian, residual = self.jacobian, self.residual
        stds = np.concatenate([np.full(10, np.inf), self._prior_stds])
        information = jacobian.T @ jacobian + np.diag(stds**-2.0)
        scale = np.sqrt(np.diag(information))
        inverse = np.linalg.pinv(information / np.outer(scale, scale)) / np.outer(scale, scale)
        widen = misfit_inflation(residual, jacobian)
        basis = self.fitted.white_lasting_errors
        load = self.fitted.load
        lasting = PresumedErrors.of_rows(inverse, jacobian, basis, residual, load)
        return np.asarray(inverse * np.outer(widen, widen) + lasting.covariance)

    def sentence(self, name: str) -> str:
        """What an effect does to the object, as a clause."""
        effect = create_effect(name)
        return effect.sentence or effect.formula

    def residuals(self) -> Residuals:
        """Wrench residuals in body and world axes with what they may depend on."""
        xi = nearest_body(self.phi, self.fitted.phi)
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
        system = FrozenSystem(self.whitening, effects)
        start = np.concatenate([self.phi, *theta])
        solution, _ = levenberg_marquardt(
            system.evaluate, start, _JOINT_ITERATIONS, _QUICK_TOLERANCE
        )
        phi, found = _split(solution, theta)
        return HeldObjectModel(self.whitening, phi, effects, found, self.catalogue)


def _split(values: Array, theta: Sequence[Array]) -> tuple[Array, tuple[Array, ...]]:
    """Take [phi, theta] apart, with as many values for each effect as it has in ``theta``."""
    sizes = np.cumsum([10, *[len(part) for part in theta]])
    phi, *parts = np.split(values, sizes[:-1])
    return phi, tuple(parts)
