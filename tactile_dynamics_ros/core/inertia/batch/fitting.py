"""Joint fit of inertia and effect parameters to whitened wrench residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.inertia.batch.fitted_model import (
    FittedModel,
    Stretch,
    regressor_noise_information,
)
from tactile_dynamics_ros.core.inertia.batch.prior import (
    LogCholeskyPrior,
    contact_prior,
    nearest_body,
)
from tactile_dynamics_ros.core.inertia.batch.systems import FactoredSystem, FullSystem
from tactile_dynamics_ros.core.inertia.batch.uncertainty import HOLD, SCATTER, unexcited_directions
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import WrenchProblem
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.numerics.noise import isolated_outlier_variance
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
    pseudo_inertia,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


_MOST_STEPS = 20
"""Steps of one fit at fixed whitening, at most. `_TOLERANCE` ends most fits before: 10 and 40 gave
the same estimates on synthetic recordings (clean, biased forces, drag). A fit that gets here is
reported as not converged."""
_TOLERANCE = 1e-6
"""Relative fall of the squared error below which a fit at fixed whitening has converged. The
whitening is found again after each fit, so that more digits are not kept; half and twice as much
changed no estimate by a thousandth of its standard deviation."""
_FLAT = 1e-2
"""Eigenvalue of the pseudo-inertia, as a share of that of a usual body, below which a fit is flat
and is tried again from a thicker body: a tenth of its thickness (sqrt 0.01). Less than the least
thickness of a start (`prior`), or the second start would count as flat too. A larger value costs a
second fit of thin objects; a much smaller one leaves fits where they got stuck."""

_SETTLED = 2
"""Steps of the alternation after which it is asked anew what the motion excites. After the first,
signals are moved by residuals of a start that may be far off: of poses at rest the ratio to noise
then reached 2.05 once and 1.5 later. After one step noise of resting poses may pass for motion;
each more delays the end of every fit by a step."""


def fit_model(
    problems: Sequence[WrenchProblem],
    effects: Sequence[Effect] = (),
    theta: Sequence[Array] | None = None,
    xi: Array | None = None,
    iterations: int = 4,
) -> FittedModel:
    """Fit inertia and effect parameters jointly.

    Alternates between the covariance of the residual with the denoised signals at fixed parameters
    and Levenberg-Marquardt over [xi, theta] at fixed covariance.

    Args:
        problems: stretches of one recording.
        effects: effects of the model.
        theta: their start; screened from the residual by each effect by default.
        xi: start of the inertia (10,); a linear fit by default.
        iterations: number of iterations of the outer alternation.
    """
    problems = tuple(problems)
    start = xi if xi is not None else _start(problems, contact_prior(problems[0].samples))
    present = np.asarray(start, dtype=float)
    if theta is not None:
        values = [np.asarray(t, dtype=float) for t in theta]
    elif effects:
        values = _guess_effects(_whiten(problems, present, (), ()), present, effects)
    else:
        values = []
    return _alternate(
        _whiten(problems, present, effects, values), present, effects, values, iterations
    )


def fit_further(model: FittedModel, iterations: int) -> FittedModel:
    """Continue the alternation from where it ended.

    Args:
        model: fitted.
        iterations: more of them.
    """
    return _alternate(model.stretches, model.xi, model.effects, list(model.theta), iterations)


def fit_beyond(before: FittedModel, after: FittedModel, factor: float) -> FittedModel:
    """Continue the alternation from where a step leads if it is prolonged.

    The alternation converges linearly; where one step is a share r of the last, its end lies
    r / (1 - r) steps ahead (Aitken 1926).

    Args:
        before: fitted.
        after: the same some iterations later.
        factor: by which the step between them is added once more.
    """

    def ahead(old: Array, new: Array) -> Array:
        return np.asarray(new + factor * (new - old))

    xi = ahead(before.xi, after.xi)
    theta = [ahead(old, new) for old, new in zip(before.theta, after.theta, strict=True)]
    problems = _denoise(after.stretches, xi, after.effects, theta, first=False)
    stretches = _whiten(problems, xi, after.effects, theta)
    return _alternate(stretches, xi, after.effects, theta, 2)


def fit_trusting(model: FittedModel, iterations: int) -> FittedModel:
    """Fit again as if the model were right: all that remains is noise, of the motion too.

    What effects do is seen on motion whose noise may exceed it. The fit then leaves a misfit, a
    misfit is not charged to the motion, and so the motion stays as noisy as it is.

    Args:
        model: fitted.
        iterations: number of iterations of the alternation.
    """
    theta = list(model.theta)
    return _alternate(model.stretches, model.xi, model.effects, theta, iterations, trusting=True)


def fit_from(model: FittedModel, prior: LogCholeskyPrior, iterations: int) -> FittedModel:
    """Fit again with another prior of the body, whose mass is that of the fit.

    Args:
        model: fitted; its lasting errors are found anew if it was corrected, xi stays uncorrected.
        prior: of the log-Cholesky coordinates of a body of 1 kg.
        iterations: number of iterations of the alternation.
    """
    mean = np.concatenate([[model.xi[0]], prior.mean[1:]])
    own = LogCholeskyPrior(mean, prior.std)
    found = _alternate(
        model.stretches, model.xi, model.effects, list(model.theta), iterations, prior=own
    )
    kept = ("frame_covariance", "survey", "restated", "event_std", "noise_bias")
    found = replace(found, **{name: getattr(model, name) for name in kept})
    return found if model.corrected is None else replace(found, corrected=found.presumed_errors)


def fit_unfolded(model: FittedModel, iterations: int) -> FittedModel | None:
    """Fit again from a thicker body where a fit has made it flat; None where it has not.

    The error hardly depends on the logarithm of a thickness that is next to nothing, so that the
    descent may stay there for ever although a thicker body fits better.

    Args:
        model: fitted.
        iterations: number of iterations of the alternation.
    """
    usual = dynamic_parameters_from_log_cholesky(model.prior.mean)
    thickness = np.linalg.eigvalsh(pseudo_inertia(model.phi))
    if np.all(thickness > _FLAT * np.linalg.eigvalsh(pseudo_inertia(usual))):
        return None
    xi, theta = nearest_body(model.phi, usual), list(model.theta)
    stretches = _whiten([s.problem for s in model.stretches], xi, model.effects, theta)
    return _alternate(stretches, xi, model.effects, theta, iterations)


def fit_corrected(model: FittedModel) -> FittedModel:
    """Correct the inertia by the lasting errors of the sensors that the residuals betray.

    Args:
        model: model of a rigid body without effects, fitted.
    """
    found = model.presumed_errors
    if not found.errors.any():
        return replace(model, corrected=found)
    ends = np.cumsum([len(stretch.residual) for stretch in model.stretches])[:-1]
    lasting = np.split(model.white_lasting_errors @ found.errors, ends)
    pairs = zip(model.stretches, lasting, strict=True)
    stretches = [replace(stretch, residual=stretch.residual - part) for stretch, part in pairs]
    trusted = model.prior.weighted(_misfit(stretches))
    xi, _, converged = _solve(stretches, model.xi, (), (), trusted, model.unexcited)
    if not converged:  # a flat body creeps: no alternation follows that would take it on
        xi, _, converged = _solve(stretches, xi, (), (), trusted, model.unexcited)
    return replace(model, xi=xi, converged=model.converged and converged, corrected=found)


def _alternate(
    stretches: tuple[Stretch, ...],
    present: Array,
    effects: Sequence[Effect],
    values: list[Array],
    iterations: int,
    trusting: bool = False,
    prior: LogCholeskyPrior | None = None,
) -> FittedModel:
    """Fit at fixed covariance, then find the covariance at the fit, and so on.

    Motion that a poor start takes for noise may be known for motion after a step: then directions
    that were held are let go, and the count begins anew. What proves at rest in the end after all
    is held again, once.
    """
    prior = prior or contact_prior(stretches[0].problem.samples)
    unexcited = _unexcited(stretches, prior)
    converged = False
    done, first, at_first = 0, True, unexcited.size
    while done < iterations:
        trusted = prior.weighted(_misfit(stretches))
        present, values, converged = _solve(stretches, present, effects, values, trusted, unexcited)
        problems = _denoise(stretches, present, effects, values, first, trusting)
        del stretches  # half the memory, before as much is needed again
        stretches = _whiten(problems, present, effects, values)
        done, first = done + 1, False
        settled = unexcited.size > 0 and done >= _SETTLED
        still = _unexcited(stretches, prior) if settled else unexcited
        if still.size < unexcited.size:
            done, unexcited = 0, still
        elif done == iterations and unexcited.size < at_first:
            at_first, still = 0, _unexcited(stretches, prior)
            if still.size > unexcited.size:
                done, unexcited = max(0, iterations - _SETTLED), still
    return FittedModel(
        stretches, present, tuple(effects), tuple(values), prior, unexcited, converged
    )


def _unexcited(stretches: Sequence[Stretch], prior: LogCholeskyPrior) -> Array:
    total = sum((s.jacobian.T @ s.jacobian for s in stretches), start=np.zeros((10, 10)))
    samples = sum(stretch.problem.count for stretch in stretches)
    noise = regressor_noise_information(stretches)
    return unexcited_directions(total, noise, prior, SCATTER / np.sqrt(samples))


def _start(problems: Sequence[WrenchProblem], prior: LogCholeskyPrior) -> Array:
    """Log-Cholesky coordinates of an ordinary least-squares fit, made feasible."""
    matrix = np.concatenate([p.regressor.reshape(-1, 10) for p in problems])
    wrench = np.concatenate([p.samples.measured_wrench.reshape(-1) for p in problems])
    guess = dynamic_parameters_from_log_cholesky(prior.mean)
    weight = 1e-2 / np.maximum(np.abs(guess), 1e-2 * np.abs(guess).max())
    rows = np.concatenate([matrix, np.diag(weight)])
    phi = np.linalg.lstsq(rows, np.concatenate([wrench, weight * guess]), rcond=None)[0]
    return nearest_body(phi, guess)


def _whiten(
    problems: Sequence[WrenchProblem],
    xi: Array,
    effects: Sequence[Effect],
    theta: Sequence[Array],
) -> tuple[Stretch, ...]:
    phi = dynamic_parameters_from_log_cholesky(xi)
    stretches = []
    for problem in problems:
        linearisation = problem.linearise(phi, effects, theta)
        residual = linearisation.whiten(problem.residual(phi, effects, theta))
        by_phi = problem.regressor.copy()
        for part in PresentEffects(effects, theta).inertia_jacobians(problem.samples, phi):
            by_phi -= part
        stretches.append(Stretch(problem, linearisation, residual, linearisation.whiten(by_phi)))
    return tuple(stretches)


def _misfit(stretches: Sequence[Stretch]) -> float:
    """RMS of the white residual, at least 1: misfit is no evidence against the prior."""
    squares = sum(float(stretch.residual @ stretch.residual) for stretch in stretches)
    return max(1.0, float(np.sqrt(squares / sum(len(stretch.residual) for stretch in stretches))))


def _guess_effects(
    stretches: Sequence[Stretch], xi: Array, effects: Sequence[Effect]
) -> list[Array]:
    """Start of each effect's parameters from a joint linear fit of inertia and screening basis."""
    phi = dynamic_parameters_from_log_cholesky(xi)
    samples = stretches[0].problem.samples
    residual = stretches[0].problem.residual(phi)
    guesses = []
    for effect in effects:
        basis = effect.screening_basis(samples, phi)
        white = stretches[0].linearisation.whiten(basis)
        scale = np.linalg.norm(white, axis=0) + 1e-300
        matrix = np.concatenate([stretches[0].jacobian, -white / scale], axis=1)
        ridge = 1e-3 * np.eye(matrix.shape[1])
        rows = np.concatenate([matrix, ridge])
        target = np.concatenate([-stretches[0].residual, np.zeros(len(ridge))])
        solution = np.linalg.lstsq(rows, target, rcond=None)[0]
        guesses.append(effect.initial_guess(samples, phi, solution[10:] / scale, residual))
    return guesses


def _solve(
    stretches: Sequence[Stretch],
    xi: Array,
    effects: Sequence[Effect],
    theta: Sequence[Array],
    prior: LogCholeskyPrior,
    unexcited: Array,
) -> tuple[Array, list[Array], bool]:
    """One nonlinear least-squares fit at fixed whitening."""
    sizes = [len(value) for value in theta]
    stds = [p.prior_std for e in effects for p in e.parameters(stretches[0].problem.samples)]
    centre = np.concatenate([prior.mean, np.zeros(sum(sizes))])
    std = np.concatenate([prior.std, np.array(stds, dtype=float)])
    keep = HOLD * np.concatenate([unexcited.T, np.zeros((unexcited.shape[1], sum(sizes)))], axis=1)
    regular = np.concatenate([np.eye(len(std)), keep]) / std
    samples, phi = stretches[0].problem.samples, dynamic_parameters_from_log_cholesky(xi)
    factored = all(e.coefficients(samples, e.zero(samples)) is not None for e in effects)
    kind = FactoredSystem if factored else FullSystem
    system = kind(stretches, phi, effects, theta)

    def evaluate(x: Array) -> tuple[Array, Array]:
        parts = np.split(x[10:], np.cumsum(sizes)[:-1]) if sizes else []
        residual, jacobian = system.evaluate(dynamic_parameters_from_log_cholesky(x[:10]), parts)
        jacobian[:, :10] = jacobian[:, :10] @ log_cholesky_jacobian(x[:10])
        return (
            np.concatenate([residual, regular @ (x - centre)]),
            np.concatenate([jacobian, regular]),
        )

    start = np.concatenate([xi, *theta])
    solution, converged = levenberg_marquardt(evaluate, start, _MOST_STEPS, _TOLERANCE)
    values = np.split(solution[10:], np.cumsum(sizes)[:-1]) if sizes else []
    return solution[:10], list(values), converged


def _denoise(
    stretches: Sequence[Stretch],
    xi: Array,
    effects: Sequence[Effect],
    theta: Sequence[Array],
    first: bool,
    trusting: bool = False,
) -> tuple[WrenchProblem, ...]:
    """Move the signals behind the regressors to their expected true values."""
    phi = dynamic_parameters_from_log_cholesky(xi)
    problems = []
    for stretch in stretches:
        white = stretch.linearisation.whiten(stretch.problem.residual(phi, effects, theta))
        problem = stretch.problem.denoised(stretch.linearisation.denoise(white, trusting))
        problem = problem.balanced(phi, effects, theta)
        if first:
            residual = problem.residual(phi, effects, theta)
            problem = problem.with_extra_variance(isolated_outlier_variance(white, residual))
        problems.append(problem)
    return tuple(problems)
