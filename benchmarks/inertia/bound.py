"""Cramer-Rao bounds on the ten parameters, from exact motion and forces.

Three bounds are given. `forces_only`: the motion is known exactly and only the stated white force
noise remains; no estimator of any kind can do better on average. `with_frame`: the course of the
motion is known exactly too, but where the object's frame sits on the body is known only from the N
poses with their stated white noise, to sigma / sqrt(N); no estimator can do better on average
either, and the parameters are asked for in that frame. `with_poses`: the poses carry their stated
noise and nothing is presumed of the motion but that a quartic polynomial describes each stretch of
nine poses; regressors and covariance are exact.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks.inertia.scenarios import Case
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import WrenchProblem
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    affine_invariant_distance,
    com_inertia_jacobian,
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
    trace_error,
)
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Array = np.ndarray
_DRAWS = 200


def exact_regressor(case: Case) -> Array:
    """(N, 6, 10) at the true motion."""
    scene = case.scene
    motion = scene.motion
    specific = motion.to_body(motion.acceleration - scene.gravity)
    return regressor(
        specific,
        motion.to_body(motion.angular_velocity),
        motion.to_body(motion.angular_acceleration),
    )


def forces_only(case: Case) -> Array:
    """Bound (10, 10) on the covariance of phi with exactly known motion."""
    points = case.scene.contacts.point
    loaded = case.scene.contacts.weight > 0.0
    unit = np.broadcast_to(np.eye(3), (*points.shape, 3))
    maps = np.concatenate([skew(points), unit], axis=2) * loaded[..., None, None]
    covariance = case.sensors.force_std**2 * np.einsum("ncij,nckj->nik", maps, maps)
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, exact_regressor(case)).reshape(-1, 10)
    return np.linalg.inv(white.T @ white)


def with_frame(case: Case) -> Array:
    """Bound (10, 10) on the covariance of phi in a body frame that only its noisy poses show.

    A frame that is off by a rotation e and a translation t has the pseudo-inertia P + D P + P D^T
    with D = [[-skew(e), -t], [0, 0]]; e and t are uncertain by the poses' noise over sqrt(N).
    """
    sensors, count = case.sensors, len(case.streams.pose.time)
    stds = np.repeat([np.radians(sensors.rotation_std_deg), sensors.position_std], 3)
    moved = []
    for twist in np.eye(6):
        change = np.zeros((4, 4))
        change[:3, :3], change[:3, 3] = -skew(twist[:3]), -twist[3:]
        shifted = change @ case.truth.pseudo_inertia
        moved.append(dynamic_parameters_from_pseudo_inertia(shifted + shifted.T))
    spread = np.array(moved).T * stds / np.sqrt(count)
    return forces_only(case) + spread @ spread.T


def with_poses(case: Case) -> Array:
    """Bound (10, 10) with noisy poses, whitened as the estimators' model has it."""
    exact = dataclasses.replace(
        case.streams.pose,
        position=case.scene.motion.position,
        rotation=case.scene.motion.rotation,
    )
    streams = dataclasses.replace(case.streams, pose=exact)
    noisy = WrenchProblem.from_streams(case.streams)
    problem = WrenchProblem.from_streams(streams)
    signals = {
        name: dataclasses.replace(signal, noise_factor=noisy.raw.motion.signals[name].noise_factor)
        for name, signal in problem.raw.motion.signals.items()
    }
    motion = dataclasses.replace(problem.raw.motion, signals=signals)
    raw = dataclasses.replace(problem.raw, motion=motion)
    problem = dataclasses.replace(problem, raw=raw, smooth=raw)
    linearisation = problem.linearise(case.truth.dynamic_parameters)
    matrix = exact_regressor(case)
    stamps = np.searchsorted(case.streams.pose.time, problem.grid[problem.valid] - 1e-4)
    white = linearisation.whiten(matrix[stamps])
    return np.linalg.inv(white.T @ white)


@dataclasses.dataclass(frozen=True)
class Spread:
    """Median errors of an estimator that is normal about the truth with a bound's covariance."""

    trace_error: float
    distance: float
    mass_percent: float
    com_mm: float


def spread(truth: InertialParameters, covariance: Array, seed: int = 0) -> Spread:
    """Median error measures under a bound, from 200 draws."""
    rng = np.random.default_rng(seed)
    phi = truth.dynamic_parameters
    draws = rng.multivariate_normal(np.zeros(10), covariance, _DRAWS, method="cholesky")
    jacobian = com_inertia_jacobian(phi)
    matrices = pseudo_inertia(phi + draws)
    physical = draws @ jacobian.T
    exact = truth.pseudo_inertia
    return Spread(
        float(np.median([trace_error(exact, m) for m in matrices])),
        float(np.median([affine_invariant_distance(exact, m) for m in matrices])),
        float(np.median(np.abs(physical[:, 0])) / truth.mass * 100.0),
        float(np.median(np.linalg.norm(physical[:, 1:4], axis=1)) * 1e3),
    )


@dataclasses.dataclass(frozen=True)
class Deviations:
    """Mean squares of an error in units of a bound: 1 on average for an estimator that reaches it.

    `distance` is that of all ten parameters together, in any coordinates.
    """

    distance: float
    mass_percent: float
    com_mm: float


def deviations(truth: InertialParameters, phi: Array, covariance: Array) -> Deviations:
    """e^T C^-1 e / n of all parameters, of the mass and of the centre of mass."""
    jacobian = com_inertia_jacobian(truth.dynamic_parameters)
    error = jacobian @ (phi - truth.dynamic_parameters)
    spread = jacobian @ covariance @ jacobian.T

    def square(rows: slice) -> float:
        part = error[rows]
        return float(part @ np.linalg.solve(spread[rows, rows], part)) / len(part)

    return Deviations(square(slice(0, 10)), square(slice(0, 1)), square(slice(1, 4)))


def rms(found: list[Deviations]) -> dict[str, float]:
    """Root of the mean over recordings."""
    names = [field.name for field in dataclasses.fields(Deviations)]
    return {name: float(np.sqrt(np.mean([getattr(d, name) for d in found]))) for name in names}
