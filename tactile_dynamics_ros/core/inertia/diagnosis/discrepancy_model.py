"""The held object as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.model.least_squares import (
    LeastSquaresModel,
    split_parameters,
)
from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Condition,
    Convention,
    Family,
    Misfit,
    Residuals,
)
from tactile_dynamics_ros.core.discrepancy.trials import square
from tactile_dynamics_ros.core.discrepancy.verdict.validation import held_out
from tactile_dynamics_ros.core.effects.conditions import can_be_gated, sample_scalars
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.parameter import EffectParameter, ParameterSum
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.effects.registry import create_effect, registered_names
from tactile_dynamics_ros.core.effects.sensor_zero import ZERO
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.fitting import fit_model
from tactile_dynamics_ros.core.inertia.batch.prior import nearest_body
from tactile_dynamics_ros.core.inertia.batch.refinement import refine
from tactile_dynamics_ros.core.inertia.batch.uncertainty import misfit_inflation
from tactile_dynamics_ros.core.inertia.diagnosis.quick_fit import (
    FrozenSystem,
    Whitening,
    extended_system,
)
from tactile_dynamics_ros.core.inertia.diagnosis.tare import describe_zero, was_tared
from tactile_dynamics_ros.core.inertia.diagnosis.term_library import wrench_residuals, wrench_terms
from tactile_dynamics_ros.core.inertia.diagnosis.twins import imitators
from tactile_dynamics_ros.core.inertia.residuals.systematic import PresumedErrors
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import log_cholesky_jacobian

_LEAST_SPAN = 1.8
"""Motion, s, from which the absence of an effect says anything: two seconds of measurements less
the windows at their ends. With one of eight effects of usual size (three seeds each) the test calls
3 of 24 recordings of half a second adequate, 1 of those of one second, none of those of two; it is
the contact offset that takes longest. Shorter calls absent what was not seen, longer refuses what
can be reported."""
_UNFOLLOWED = 0.1
"""Share of poses too far apart to show the motion from which a misfit is put down to that: clean
slow recordings have at most 3 %. Higher, effects are named that only stand in for motion between
the samples; lower, single jolts keep a slow recording from being questioned."""
_QUICK_ITERATIONS = 12
"""Steps of a quick fit of one more effect at fixed whitening, at most. It ranks candidates; what is
chosen is fitted thoroughly. Fewer rank effects with memory by unfinished fits, more take time for
each candidate."""
_QUICK_TOLERANCE = 2e-5
"""Relative fall of the squared error below which a quick fit has converged. The error of 30 s at
100 Hz is a sum of 18000 squares, so that it is off by 0.4 at most, far below the differences (tens)
by which effects are told apart. A hundred times more would reach these; less takes more steps for
each candidate."""
"""Steps of a joint quick fit of all effects, at most. It is done only where linear changes of the
present effects were too coarse, and starts farther away."""
_CURVED = 1.01
"""Squared error after a linear change of the present effects, over what it promised, from which all
effects are fitted jointly: 1 % more. Nearer to 1 more candidates pay for a joint fit; higher,
effects that bend are ranked too low."""


@dataclass(frozen=True)
class HeldObjectModel(LeastSquaresModel[Effect]):
    """Rigid body with effects: residuals at a fixed whitening, quick and thorough refits.

    Attributes:
        whitening: the thoroughly fitted model at which signals are denoised and whitened.
        phi: (10,) dynamic parameters; a quick fit may leave the bodies that can exist.
        effects: the effects of the model.
        theta: their parameters.
        catalogue: labels or names of the effects that may be tried.
        misread: looks for another reading of the recording, given the held-out error of this one;
            None where the recording is not at hand.
    """

    whitening: Whitening
    phi: Array
    effects: tuple[Effect, ...]
    theta: tuple[Array, ...]
    catalogue: tuple[str, ...]
    misread: Callable[[float], Convention | None] | None = None

    tolerance = _QUICK_TOLERANCE

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
    def samples(self) -> WrenchSamples:
        """Denoised samples of the first stretch."""
        return self.fitted.stretches[0].problem.samples

    @property
    def own(self) -> Array:
        """(10,) dynamic parameters."""
        return self.phi

    @property
    def own_scales(self) -> Array:
        """(10,) standard deviations of the prior of a load like this one."""
        fitted = self.fitted
        return np.asarray(
            np.linalg.norm(log_cholesky_jacobian(fitted.xi) * fitted.prior.std, axis=1)
        )

    @cached_property
    def time(self) -> Array:
        """(M,) s."""
        stretches = self.fitted.stretches
        times = [s.problem.grid[s.problem.valid] - s.problem.start for s in stretches]
        return np.repeat(np.concatenate(times), 6)

    @cached_property
    def measured(self) -> Array:
        """(M,) wrench of the object on the contacts, [torque, force] in the body frame."""
        model, found = self.fitted, []
        present = PresentEffects(model.effects, model.theta)
        for stretch in model.stretches:
            problem = stretch.problem
            shown = present.wrench(problem.samples, model.phi) - problem.regressor @ model.phi
            found.append(stretch.linearisation.whitener.colour(stretch.residual) + shown.ravel())
        return np.concatenate(found)

    def predict(self, x: Array, effects: Sequence[Effect]) -> Array:
        """(M,) the same, -Y phi + Delta at the denoised samples."""
        counts = [len(self.parameters_of(effect)) for effect in effects]
        phi, theta = split_parameters(x, 10, [np.zeros(count) for count in counts])
        present = PresentEffects(effects, theta)
        problems = [stretch.problem for stretch in self.fitted.stretches]
        parts = [present.wrench(p.samples, phi) - p.regressor @ phi for p in problems]
        return np.concatenate([part.ravel() for part in parts])

    def whiten(self, rows: Array) -> Array:
        """White form of rows (M, ...)."""
        stretches = self.fitted.stretches
        edges = np.cumsum([len(stretch.residual) for stretch in stretches])[:-1]
        parts = [part.reshape(-1, 6, *rows.shape[1:]) for part in np.split(rows, edges)]
        return self.whitening.whiten(parts)

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(M,) noise of the poses and the contacts as it moves the residual, to first order."""
        stretches = self.fitted.stretches
        return np.concatenate([stretch.linearisation.draw_noise(random) for stretch in stretches])

    def parameters_of(self, effect: Effect) -> tuple[EffectParameter, ...]:
        """Parameters of an effect for the contacts of this recording."""
        return effect.parameters(self.samples)

    def is_possible(self, name: str) -> bool:
        """Whether an effect of the model can exist as it is fitted."""
        return all(
            effect.is_possible(self.samples, self.phi, theta)
            for effect, theta in zip(self.effects, self.theta, strict=True)
            if effect.name == name
        )

    def sums_of(self, effect: Effect) -> tuple[ParameterSum, ...]:
        """Biases of several fingers are known as their sum."""
        return effect.sums(self.samples)

    def with_parameters(
        self, own: Array, effects: tuple[Effect, ...], theta: tuple[Array, ...]
    ) -> HeldObjectModel:
        """The model at other parameters, at the same whitening."""
        return replace(self, phi=own, effects=effects, theta=theta, misread=None)

    def effect_named(self, name: str) -> Effect:
        """An effect of the catalogue, or a reading of it."""
        return create_effect(name)

    def system(self, x: Array, effects: tuple[Effect, ...]) -> tuple[Array, Array]:
        """Residual and derivative in closed form: rows of the data, then rows of the prior."""
        return FrozenSystem(self.whitening, effects).evaluate(x)

    def evaluate(self, x: Array, effects: tuple[Effect, ...]) -> tuple[Array, Array]:
        """The rows of the data."""
        residual, jacobian = self.system(x, effects)
        return residual[: len(self.time)], jacobian[: len(self.time)]

    @property
    def noise_level(self) -> float:
        """That of the thorough fit behind this model."""
        return self.fitted.misfit.noise_level

    @property
    def lasting_freedom(self) -> float:
        """Three for each contact, the axes in which its force may be off for good."""
        return 3.0 * len(self.samples.contact_names)

    def convention(self) -> Convention | None:
        """Another reading of the recording that fits where this one does not."""
        return None if self.misread is None else self.misread(held_out(self).rms)

    @property
    def unreadable(self) -> str:
        """Poses that are too far apart to show the motion."""
        motion = self.fitted.stretches[0].problem.raw.motion
        if motion.unfollowed < _UNFOLLOWED:
            return ""
        return (
            f"The poses do not show the motion: {100.0 * motion.unfollowed:.0f} % of them lie too "
            "far apart for what happens between them; record them faster or move more slowly, so "
            "that at least seven fall into the shortest swing."
        )

    @property
    def too_short(self) -> str:
        """How long the motion is known, where that is less than effects need to show."""
        known = float(self.time[-1] - self.time[0])
        if known >= _LEAST_SPAN:
            return ""
        return (
            f"too short to tell whether an effect is missing: the motion is known for {known:.2g} "
            f"s, and some effects show from {_LEAST_SPAN:g} s on only; record longer"
        )

    @cached_property
    def _zero(self) -> dict[str, dict[str, Any]] | None:
        """Parameters of the zero of a single sensor, if the model has one."""
        return self.parameters().get(ZERO) if len(self.samples.contact_names) == 1 else None

    @property
    def remark(self) -> str:
        """What a single sensor reads with nothing on it."""
        return "" if self._zero is None else describe_zero(self._zero, bool(self.known_event))

    @cached_property
    def known_event(self) -> dict[str, Any] | None:
        """A single sensor that was zeroed with the load on it, at the start."""
        tared = self._zero is not None and was_tared(self.samples, self._zero)
        return {"name": "sensor_zeroed", "t": 0.0, "std": None} if tared else None

    def imitators(self, name: str) -> tuple[str, ...]:
        """Fluid that moves along, and gravity that is turned, pull at the centre of mass."""
        present = dict(zip(self.effect_names, self.theta, strict=True))
        return imitators(name, self.phi, present, self.covariance)

    def families_of(self, name: str) -> list[Family]:
        """Every reading of an effect that the model lacks, and every restriction of it."""
        samples, present = self.samples, PresentEffects(self.effects, self.theta)
        found: list[tuple[Effect, str, Array, tuple[int, ...]]] = []
        for reading in create_effect(name).readings(samples):
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
                regional=can_be_gated(effect),
                event=effect.event,
                contains=effect.contains,
            )
            for effect, reading, columns, kept in found
        ]

    def with_effect(self, family: Family, coefficients: Array) -> HeldObjectModel:
        """Fit with one more effect at fixed whitening.

        The present effects are linear in the change of their parameters; where that proves too
        coarse, all are fitted jointly, from where they were if the change leads too far.
        """
        effect: Effect = family.source
        stretch = self.fitted.stretches[0]
        lacking = stretch.problem.residual(self.phi, self.effects, self.theta)
        start = effect.initial_guess(stretch.problem.samples, self.phi, coefficients, lacking)
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
        return nearer.fitted_from(nearer.effects, nearer.theta)

    def _moved(self, change: Array, effect: Effect, theta: Array) -> HeldObjectModel:
        """The model with its parameters changed and one effect more."""
        by_phi, by_theta = split_parameters(change, 10, self.theta)
        moved = [t + d for t, d in zip(self.theta, by_theta, strict=True)]
        return self.with_parameters(self.phi + by_phi, (*self.effects, effect), (*moved, theta))

    def refined(self) -> HeldObjectModel:
        """Fit again with new denoised signals and whitening."""
        return self._refined

    @cached_property
    def _refined(self) -> HeldObjectModel:
        problems = [
            s.problem.balanced(self.phi, self.effects, self.theta) for s in self.fitted.stretches
        ]
        xi, theta = nearest_body(self.phi, self.fitted.phi), self.theta
        model = fit_model(problems, self.effects, theta, xi, 2)
        foreseen = max(self.fitted.whitened_rms, Misfit.of(self).rms)
        refined = refine(model, self.fitted.misfit, foreseen)
        return HeldObjectModel.from_fit(refined, self.catalogue)

    @cached_property
    def covariance(self) -> Array:
        """(10 + k, 10 + k) of [phi, theta] at the fixed whitening, widened by misfit."""
        jacobian, residual = self.jacobian, self.residual
        stds = np.concatenate([np.full(10, np.inf), self.prior_stds(self.effects)])
        information = jacobian.T @ jacobian + np.diag(stds**-2.0)
        scale = np.sqrt(np.diag(information))
        inverse = np.linalg.pinv(information / np.outer(scale, scale)) / np.outer(scale, scale)
        widen = misfit_inflation(residual, jacobian)
        basis = self.fitted.white_lasting_errors
        load = self.fitted.load
        lasting = PresumedErrors.of_rows(inverse, jacobian, basis, residual, load)
        return np.asarray(inverse * np.outer(widen, widen) + lasting.covariance)

    def residuals(self) -> Residuals:
        """Wrench residuals in body and world axes with what they may depend on."""
        xi = nearest_body(self.phi, self.fitted.phi)
        model = replace(self.fitted, xi=xi, effects=self.effects, theta=self.theta)
        return wrench_residuals(model, self.residual.reshape(-1, 6))

    def conditions(self) -> tuple[Condition, ...]:
        """Scalars of the denoised samples."""
        parts = [sample_scalars(stretch.problem.samples) for stretch in self.fitted.stretches]
        return tuple(
            Condition(
                scalar.name,
                scalar.unit,
                np.concatenate([part[symbol].values for part in parts]),
                symbol=symbol,
            )
            for symbol, scalar in parts[0].items()
        )

    def library(self) -> list[Family]:
        """Simple functions of named quantities as wrenches."""
        terms = [list(wrench_terms(stretch.problem.samples)) for stretch in self.fitted.stretches]
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
                    effect=parts[0].effect,
                )
            )
        return families

    def law_forms(self) -> Sequence[Any]:
        """Laws of a held object."""
        from tactile_dynamics_ros.core.inertia.diagnosis.law_forms import held_forms

        return held_forms()

    def plan_against(self, rivals: Sequence[HeldObjectModel]) -> dict[str, Any] | None:
        """Plan of the motion or re-grasp that would tell this model from others."""
        from tactile_dynamics_ros.core.inertia.diagnosis.separating_motion import plan_separation

        return plan_separation(self, rivals)
