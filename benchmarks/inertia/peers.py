"""What others would do with the same recordings: smoothing, then least squares of several kinds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import cvxpy
import gtsam
import numpy as np

from benchmarks.inertia.mujoco_peer import identify_with_mujoco, mujoco_is_there
from benchmarks.inertia.scenarios import Case
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.inertia.batch.prior import contact_prior
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import (
    ProblemConfig,
    WrenchProblem,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = np.ndarray

_SMOOTHING = ProblemConfig(regressor_half_width=0.12, regressor_degree=4)
_ENTROPIC_WEIGHT = 1e-2
_KEY = gtsam.symbol("x", 0)


@dataclass(frozen=True)
class SmoothedData:
    """Whitened regressor (6 N, 10) and wrench (6 N,) from smoothed poses, and a rough prior.

    Poses are smoothed by a quartic polynomial over 25 samples; rows are weighted by the stated
    force noise at the contacts' places. Every peer below gets exactly this. `factor` (N, 6, 6) is
    the square root of the wrenches' covariance.
    """

    matrix: Array
    wrench: Array
    prior: Array
    samples: WrenchSamples
    factor: Array

    @classmethod
    def of(cls, case: Case) -> SmoothedData:
        """Smooth a recording."""
        problem = WrenchProblem.from_streams(case.streams, _SMOOTHING)
        samples = problem.samples
        unit = np.broadcast_to(np.eye(3), (*samples.contact_point.shape, 3))
        maps = np.concatenate([skew(samples.contact_point), unit], axis=2)
        maps = maps * samples.in_contact[..., None, None]
        std = max(case.sensors.force_std, 1e-4)
        covariance = std**2 * np.einsum("ncij,nckj->nik", maps, maps)
        factor = np.linalg.cholesky(covariance)
        matrix = np.linalg.solve(factor, problem.regressor).reshape(-1, 10)
        wrench = _whiten(factor, samples.measured_wrench)
        return cls(matrix, wrench, contact_prior(samples).mean, samples, factor)

    def whiten(self, wrench: Array) -> Array:
        """Wrenches (N, 6) in units of their noise, (6 N,)."""
        return _whiten(self.factor, wrench)

    @property
    def reduced(self) -> tuple[Array, Array]:
        """Square root R (10, 10) and d (10,) of the normal equations."""
        stacked = np.linalg.qr(np.column_stack([self.matrix, self.wrench]), mode="r")
        return stacked[:10, :10], stacked[:10, 10]


def _whiten(factor: Array, wrench: Array) -> Array:
    return np.linalg.solve(factor, wrench[..., None]).reshape(-1)


def weighted_least_squares(data: SmoothedData) -> Array:
    """Unconstrained."""
    return np.linalg.lstsq(data.matrix, data.wrench, rcond=None)[0]


def semidefinite_program(data: SmoothedData) -> Array:
    """Least squares subject to P > 0. Source: Wensing, Kim, Slotine 2018."""
    return _solve_convex(data, entropic=False)


def entropic_regularisation(data: SmoothedData) -> Array:
    """Least squares plus a log-det divergence to a rough prior. Source: Lee, Wensing, Park 2020."""
    return _solve_convex(data, entropic=True)


def _solve_convex(data: SmoothedData, entropic: bool) -> Array:
    factor, target = data.reduced
    guess = dynamic_parameters_from_log_cholesky(data.prior)
    half = np.linalg.cholesky(pseudo_inertia(guess))
    inverse = np.linalg.inv(half)
    basis = inverse @ pseudo_inertia(np.eye(10)) @ inverse.T
    scale = np.maximum(np.abs(guess), 1e-3 * np.abs(guess).max())
    variable = cvxpy.Variable(10)
    matrix = sum(variable[k] * (scale[k] * basis[k]) for k in range(10))
    units = np.linalg.norm(factor * scale)
    cost = cvxpy.sum_squares((factor * scale / units) @ variable - target / units)
    constraints = [matrix >> 1e-9 * np.eye(4)]
    if entropic:
        weight = _ENTROPIC_WEIGHT / units**2
        cost = cost + weight * (cvxpy.trace(matrix) - cvxpy.log_det(matrix))
        constraints = []
    problem = cvxpy.Problem(cvxpy.Minimize(cost), constraints)
    problem.solve(solver=cvxpy.CLARABEL)
    if variable.value is None:
        return np.full(10, np.nan)
    return np.asarray(variable.value) * scale


def mujoco_system_identification(data: SmoothedData) -> Array:
    """`mujoco.sysid` on inverse dynamics."""
    guess = dynamic_parameters_from_log_cholesky(data.prior)
    return identify_with_mujoco(data.samples, data.whiten, guess)


PEERS: dict[str, Callable[[SmoothedData], Array]] = {
    "weighted least squares": weighted_least_squares,
    "LMI/SDP": semidefinite_program,
    "entropic": entropic_regularisation,
}
if mujoco_is_there():
    PEERS["MuJoCo sysid"] = mujoco_system_identification


def _sample_factor(matrix: Array, wrench: Array) -> gtsam.CustomFactor:
    """One sample's white Newton-Euler residual on log-Cholesky coordinates."""

    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        xi = values.atVector(_KEY)
        if jacobians is not None:
            jacobians[0] = matrix @ log_cholesky_jacobian(xi)
        return matrix @ dynamic_parameters_from_log_cholesky(xi) - wrench

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(6), [_KEY], error)


def _prior_factor(data: SmoothedData) -> gtsam.NonlinearFactor:
    return gtsam.PriorFactorVector(_KEY, data.prior, gtsam.noiseModel.Isotropic.Sigma(10, 2.0))


def plain_isam2(data: SmoothedData, steps: int) -> tuple[Array, Array]:
    """A factor per sample on one global variable: estimate (10,), seconds per update (steps,)."""
    parameters = gtsam.ISAM2Params()
    parameters.setOptimizationParams(gtsam.ISAM2DoglegParams())
    parameters.relinearizeSkip = 1
    isam = gtsam.ISAM2(parameters)
    values = gtsam.Values()
    values.insert(_KEY, data.prior)
    graph = gtsam.NonlinearFactorGraph()
    graph.add(_prior_factor(data))
    isam.update(graph, values)
    costs, xi = [], data.prior
    for k in range(steps):
        rows = slice(6 * k, 6 * k + 6)
        graph = gtsam.NonlinearFactorGraph()
        graph.add(_sample_factor(data.matrix[rows], data.wrench[rows]))
        started = time.thread_time()
        isam.update(graph, gtsam.Values())
        xi = isam.calculateEstimateVector(_KEY)
        costs.append(time.thread_time() - started)
    return dynamic_parameters_from_log_cholesky(xi), np.array(costs)


def batch_resolve(data: SmoothedData, steps: list[int]) -> tuple[Array, Array]:
    """The whole graph solved again after so many samples: last estimate, seconds per solution."""
    graph = gtsam.NonlinearFactorGraph()
    graph.add(_prior_factor(data))
    values = gtsam.Values()
    values.insert(_KEY, data.prior)
    costs, done = [], 0
    for step in steps:
        for k in range(done, step):
            rows = slice(6 * k, 6 * k + 6)
            graph.add(_sample_factor(data.matrix[rows], data.wrench[rows]))
        done = step
        started = time.thread_time()
        values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        costs.append(time.thread_time() - started)
    return dynamic_parameters_from_log_cholesky(values.atVector(_KEY)), np.array(costs)
