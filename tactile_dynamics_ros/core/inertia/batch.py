"""Batch estimation of inertia, and of the parameters of effects, from a whole recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.inertia.contact_grid import choose_grid
from tactile_dynamics_ros.core.inertia.estimate import EffectEstimate, InertialEstimate, ModelError
from tactile_dynamics_ros.core.inertia.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.inertia.outliers import isolated_outlier_variance
from tactile_dynamics_ros.core.inertia.prior import LogCholeskyPrior, contact_prior
from tactile_dynamics_ros.core.inertia.uncertainty import misfit_inflation, unexcited_parameters
from tactile_dynamics_ros.core.inertia.wrench_problem import (
    Linearisation,
    ProblemConfig,
    WrenchProblem,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    dynamic_parameters_from_log_cholesky,
    log_cholesky,
    log_cholesky_jacobian,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.streams import Streams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BatchConfig:
    """Iterations and block length of the batch estimator."""

    problem: ProblemConfig = field(default_factory=ProblemConfig)
    iterations: int = parameter(4, "re-evaluations of covariance and denoised signals", "", 1, 20)
    block_duration: float = parameter(60.0, "stretch that is whitened as one piece", "s", 2.0)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class Block:
    """One stretch of the recording at the present parameters, whitened.

    Attributes:
        problem: its residuals.
        linearisation: its whitening.
        residual: (6 N,) white residual.
        jacobian: (6 N, 10) its derivative by phi.
    """

    problem: WrenchProblem
    linearisation: Linearisation
    residual: Array
    jacobian: Array


@dataclass(frozen=True)
class FittedModel:
    """A rigid body with effects, fitted to a recording.

    Attributes:
        blocks: whitened residuals and Jacobians by stretch, at the solution.
        xi: (10,) log-Cholesky coordinates.
        effects: the effects of the model.
        theta: parameters of each effect.
        prior: of xi.
        converged: whether the iteration converged.
    """

    blocks: tuple[Block, ...]
    xi: Array
    effects: tuple[Effect, ...]
    theta: tuple[Array, ...]
    prior: LogCholeskyPrior
    converged: bool

    @property
    def phi(self) -> Array:
        """(10,) dynamic parameters."""
        return dynamic_parameters_from_log_cholesky(self.xi)

    @cached_property
    def white_residual(self) -> Array:
        """(6 N,) white residual of all blocks."""
        return np.concatenate([block.residual for block in self.blocks])

    @cached_property
    def white_jacobian(self) -> Array:
        """(6 N, 10 + k) derivative of the white residual by phi and all effect parameters."""
        return np.concatenate([self._block_jacobian(block) for block in self.blocks])

    @property
    def whitened_rms(self) -> float:
        """RMS of the white residual per degree of freedom; 1 at the noise floor."""
        freedom = len(self.white_residual) - self.white_jacobian.shape[1]
        return float(np.sqrt(np.sum(self.white_residual**2) / freedom))

    @cached_property
    def coordinate_information(self) -> tuple[Array, Array]:
        """Information of the data and of the prior on [xi, theta]; (p, p) each."""
        mapped = self.white_jacobian.copy()
        mapped[:, :10] = mapped[:, :10] @ log_cholesky_jacobian(self.xi)
        stds = [p.prior_std for e in self.effects for p in e.parameters(self.samples[0])]
        prior = np.diag(np.concatenate([self.prior.std**-2.0, np.array(stds, dtype=float) ** -2.0]))
        return mapped.T @ mapped, prior

    @cached_property
    def covariance(self) -> Array:
        """(10 + k, 10 + k) covariance of [phi, theta], widened where the model does not fit."""
        data, prior = self.coordinate_information
        covariance = np.linalg.inv(data + prior)
        map_phi = np.eye(len(covariance))
        map_phi[:10, :10] = log_cholesky_jacobian(self.xi)
        widen = misfit_inflation(self.white_residual, self.white_jacobian)
        return np.asarray(map_phi @ covariance @ map_phi.T * np.outer(widen, widen))

    @property
    def samples(self) -> tuple[WrenchSamples, ...]:
        """Denoised samples by block."""
        return tuple(block.problem.samples for block in self.blocks)

    def smooth_residual(self) -> Array:
        """(N, 6) predicted minus measured wrench with smoothed motion and measured forces."""
        return np.concatenate(
            [b.problem.smooth_residual(self.phi, self.effects, self.theta) for b in self.blocks]
        )

    def _block_jacobian(self, block: Block) -> Array:
        samples, phi = block.problem.samples, self.phi
        columns = [
            block.linearisation.whiten(effect.jacobian(samples, phi, theta))
            for effect, theta in zip(self.effects, self.theta, strict=True)
        ]
        return np.concatenate([block.jacobian, *[-column for column in columns]], axis=1)

    def to_estimate(self) -> InertialEstimate:
        """Summarise for people and programs."""
        covariance = self.covariance
        smooth = self.smooth_residual()
        data, prior = self.coordinate_information
        times = [block.problem.grid for block in self.blocks]
        return InertialEstimate(
            inertia=InertialParameters.from_log_cholesky(self.xi),
            covariance=covariance[:10, :10],
            effects=self._effect_estimates(covariance[10:, 10:]),
            error=ModelError(
                force_rms_n=float(np.sqrt(np.mean(smooth[:, 3:] ** 2))),
                torque_rms_nm=float(np.sqrt(np.mean(smooth[:, :3] ** 2))),
                whitened_rms=self.whitened_rms,
            ),
            not_excited=unexcited_parameters(self.xi, data[:10, :10], prior[:10, :10]),
            samples=sum(block.problem.count for block in self.blocks),
            duration=float(times[-1][-1] - times[0][0]),
            converged=self.converged,
        )

    def _effect_estimates(self, covariance: Array) -> dict[str, EffectEstimate]:
        stds = np.sqrt(np.diag(covariance))
        estimates, first = {}, 0
        for effect, theta in zip(self.effects, self.theta, strict=True):
            parameters = effect.parameters(self.samples[0])
            std = stds[first : first + len(theta)]
            first += len(theta)
            names = [p.name for p in parameters]
            estimates[effect.name] = EffectEstimate(
                dict(zip(names, map(float, theta), strict=True)),
                dict(zip(names, map(float, std), strict=True)),
                {p.name: p.unit for p in parameters},
            )
        return estimates


def read_blocks(streams: Streams, config: BatchConfig) -> tuple[WrenchProblem, ...]:
    """Cut a recording into stretches of about `block_duration`.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
    """
    grid = choose_grid(streams, config.problem.maximum_rate)
    count = max(1, round((grid[-1] - grid[0]) / config.block_duration))
    edges = np.linspace(grid[0], grid[-1] + 1e-6, count + 1)
    start = float(grid[0])
    if count == 1:
        return (WrenchProblem.from_streams(streams, config.problem, start=start),)
    problems = [
        WrenchProblem.try_from_streams(streams, config.problem, (low, high), start)
        for low, high in zip(edges[:-1], edges[1:], strict=True)
    ]
    found = tuple(problem for problem in problems if problem is not None)
    return found or (WrenchProblem.from_streams(streams, config.problem, start=start),)


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
        iterations: of the outer alternation.
    """
    problems = tuple(problems)
    prior = contact_prior(problems[0].samples)
    present = _start(problems, prior) if xi is None else np.asarray(xi, dtype=float)
    values = None if theta is None else [np.asarray(t, dtype=float) for t in theta]
    blocks = _whiten(problems, present, effects if values is not None else (), values or ())
    if values is None:
        values = _guess_effects(blocks, present, effects)
        blocks = _whiten(problems, present, effects, values) if effects else blocks
    converged = False
    for iteration in range(iterations):
        present, values, converged = _solve(blocks, present, effects, values, prior)
        problems = _denoise(blocks, present, effects, values, first=iteration == 0)
        blocks = _whiten(problems, present, effects, values)
    return FittedModel(blocks, present, tuple(effects), tuple(values), prior, converged)


def fit_recording(
    streams: Streams, effects: Sequence[Effect] = (), config: BatchConfig | None = None
) -> FittedModel:
    """Read a recording and fit the model to it.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
        NotIdentifiableError: the iteration diverged.
    """
    config = config or BatchConfig()
    model = fit_model(read_blocks(streams, config), effects, iterations=config.iterations)
    if not np.all(np.isfinite(model.white_residual)):
        raise NotIdentifiableError("the estimation diverged; check units and stamps of the streams")
    return model


def estimate_inertia(
    streams: Streams, effects: Sequence[Effect] = (), config: BatchConfig | None = None
) -> InertialEstimate:
    """Estimate mass, centre of mass and inertia of a held object from a recording."""
    return fit_recording(streams, effects, config).to_estimate()


def _start(problems: Sequence[WrenchProblem], prior: LogCholeskyPrior) -> Array:
    """Log-Cholesky coordinates of an ordinary least-squares fit, made feasible."""
    matrix = np.concatenate([p.regressor.reshape(-1, 10) for p in problems])
    wrench = np.concatenate([p.samples.measured_wrench.reshape(-1) for p in problems])
    guess = dynamic_parameters_from_log_cholesky(prior.mean)
    weight = 1e-2 / np.maximum(np.abs(guess), 1e-2 * np.abs(guess).max())
    rows = np.concatenate([matrix, np.diag(weight)])
    phi = np.linalg.lstsq(rows, np.concatenate([wrench, weight * guess]), rcond=None)[0]
    values, vectors = np.linalg.eigh(pseudo_inertia(phi))
    floor = np.linalg.eigvalsh(pseudo_inertia(guess))
    clipped = np.maximum(values, 0.1 * floor)
    return log_cholesky(vectors * clipped @ vectors.T)


def _whiten(
    problems: Sequence[WrenchProblem],
    xi: Array,
    effects: Sequence[Effect],
    theta: Sequence[Array],
) -> tuple[Block, ...]:
    phi = dynamic_parameters_from_log_cholesky(xi)
    blocks = []
    for problem in problems:
        linearisation = problem.linearise(phi)
        residual = linearisation.whiten(problem.residual(phi, effects, theta))
        by_phi = problem.regressor.copy()
        for effect, value in zip(effects, theta, strict=True):
            by_phi -= effect.inertia_jacobian(problem.samples, phi, value)
        blocks.append(Block(problem, linearisation, residual, linearisation.whiten(by_phi)))
    return tuple(blocks)


def _guess_effects(blocks: Sequence[Block], xi: Array, effects: Sequence[Effect]) -> list[Array]:
    """Start of each effect's parameters from a joint linear fit of inertia and screening basis."""
    phi = dynamic_parameters_from_log_cholesky(xi)
    samples = blocks[0].problem.samples
    residual = blocks[0].problem.residual(phi)
    guesses = []
    for effect in effects:
        basis = effect.screening_basis(samples, phi)
        white = blocks[0].linearisation.whiten(basis)
        scale = np.linalg.norm(white, axis=0) + 1e-300
        matrix = np.concatenate([blocks[0].jacobian, -white / scale], axis=1)
        ridge = 1e-3 * np.eye(matrix.shape[1])
        rows = np.concatenate([matrix, ridge])
        target = np.concatenate([-blocks[0].residual, np.zeros(len(ridge))])
        solution = np.linalg.lstsq(rows, target, rcond=None)[0]
        guesses.append(effect.initial_guess(samples, phi, solution[10:] / scale, residual))
    return guesses


def _solve(
    blocks: Sequence[Block],
    xi: Array,
    effects: Sequence[Effect],
    theta: Sequence[Array],
    prior: LogCholeskyPrior,
) -> tuple[Array, list[Array], bool]:
    """One nonlinear least-squares fit at fixed whitening."""
    sizes = [len(value) for value in theta]
    stds = [p.prior_std for e in effects for p in e.parameters(blocks[0].problem.samples)]
    centre = np.concatenate([prior.mean, np.zeros(sum(sizes))])
    std = np.concatenate([prior.std, np.array(stds, dtype=float)])
    system = _ReducedSystem(blocks, dynamic_parameters_from_log_cholesky(xi), effects, theta)

    def evaluate(x: Array) -> tuple[Array, Array]:
        parts = np.split(x[10:], np.cumsum(sizes)[:-1]) if sizes else []
        residual, jacobian = system.evaluate(dynamic_parameters_from_log_cholesky(x[:10]), parts)
        jacobian[:, :10] = jacobian[:, :10] @ log_cholesky_jacobian(x[:10])
        return (
            np.concatenate([residual, (x - centre) / std]),
            np.concatenate([jacobian, np.diag(1.0 / std)]),
        )

    start = np.concatenate([xi, *theta])
    solution, converged = levenberg_marquardt(evaluate, start)
    values = np.split(solution[10:], np.cumsum(sizes)[:-1]) if sizes else []
    return solution[:10], list(values), converged


class _ReducedSystem:
    """White residual r0 + J (phi - phi0) - L^-1 (Delta - Delta0), rotated to few rows.

    Without effects ten rows suffice. With effects the full residual is evaluated.
    """

    def __init__(
        self,
        blocks: Sequence[Block],
        phi: Array,
        effects: Sequence[Effect],
        theta: Sequence[Array],
    ) -> None:
        self._blocks, self._phi, self._effects = blocks, phi, effects
        self._rows = [np.concatenate([b.jacobian, b.residual[:, None]], axis=1) for b in blocks]
        self._white_start = [self._white_effects(b, phi, theta) for b in blocks]
        if not effects:
            self._rows = [np.asarray(np.linalg.qr(np.concatenate(self._rows), mode="r"))]

    def evaluate(self, phi: Array, theta: Sequence[Array]) -> tuple[Array, Array]:
        """Residual and Jacobian by [phi, theta]."""
        rows = np.concatenate(self._rows)
        residual = rows[:, :10] @ (phi - self._phi) + rows[:, 10]
        if not self._effects:
            return residual, rows[:, :10].copy()
        moved = [
            self._white_effects(block, phi, theta) - start
            for block, start in zip(self._blocks, self._white_start, strict=True)
        ]
        columns = np.concatenate(
            [self._effect_columns(block, phi, theta) for block in self._blocks]
        )
        # rows already hold dDelta/dphi at the start; the exact change replaces that linear part
        correction = np.concatenate(
            [self._linear_part(block, phi, theta) for block in self._blocks]
        )
        residual = residual - np.concatenate(moved) + correction
        return residual, np.concatenate([rows[:, :10], columns], axis=1)

    def _white_effects(self, block: Block, phi: Array, theta: Sequence[Array]) -> Array:
        total = np.zeros((block.problem.count, 6))
        for effect, value in zip(self._effects, theta, strict=True):
            total += effect.wrench(block.problem.samples, phi, value)
        return block.linearisation.whiten(total)

    def _effect_columns(self, block: Block, phi: Array, theta: Sequence[Array]) -> Array:
        samples = block.problem.samples
        columns = [
            effect.jacobian(samples, phi, value)
            for effect, value in zip(self._effects, theta, strict=True)
        ]
        return -block.linearisation.whiten(np.concatenate(columns, axis=2))

    def _linear_part(self, block: Block, phi: Array, theta: Sequence[Array]) -> Array:
        plain = block.linearisation.whiten(block.problem.regressor)
        return (plain - block.jacobian) @ (phi - self._phi)


def _denoise(
    blocks: Sequence[Block],
    xi: Array,
    effects: Sequence[Effect],
    theta: Sequence[Array],
    first: bool,
) -> tuple[WrenchProblem, ...]:
    """Move the signals behind the regressors to their expected true values."""
    phi = dynamic_parameters_from_log_cholesky(xi)
    problems = []
    for block in blocks:
        white = block.linearisation.whiten(block.problem.residual(phi, effects, theta))
        problem = block.problem.denoised(block.linearisation.denoise(white))
        if first:
            residual = problem.residual(phi, effects, theta)
            problem = problem.with_extra_variance(isolated_outlier_variance(white, residual))
        problems.append(problem)
    return tuple(problems)
