"""The five methods that paper A compares. Source: paper A, sections III-B and IV-B."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np
from scipy.signal import savgol_filter

from benchmarks.peers.paper_a.dynamics import (
    differentiate,
    net_wrench,
    regressor,
)
from benchmarks.peers.paper_a.factors import (
    AXES_KEY,
    VECTOR_KEY,
    InertiaVariables,
    consistency_factor,
    dynamics_factor,
    prior_factor,
)
from benchmarks.peers.paper_a.parameters import principal_of_phi
from benchmarks.peers.paper_a.time_steps import TimeSteps
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import inertia_vector
from tactile_dynamics_ros.core.rigid_body.rotation import skew

Method = Literal["Baseline", "Baseline-FG", "No C, No G", "C, No G", "C + G"]
METHODS: tuple[Method, ...] = ("Baseline", "Baseline-FG", "No C, No G", "C, No G", "C + G")

_SMOOTHING_WINDOW = 51
_SMOOTHING_DEGREE = 3
_LARGEST_DAMPING = 1e12


@dataclass(frozen=True)
class PublishedConfig:
    """Weights of the graph; the paper tunes them on noise-free simulation and keeps them."""

    force_std: float = parameter(0.05, "of force measurements", "N", 1e-9)
    point_std: float = parameter(1e-3, "of contact points", "m", 1e-9)
    position_std: float = parameter(5e-4, "of object positions", "m", 1e-9)
    rotation_std: float = parameter(3.5e-3, "of object rotations", "rad", 1e-9)
    dynamics_force_std: float = parameter(0.01, "slack of Eq. 14", "N", 1e-9)
    dynamics_torque_std: float = parameter(0.001, "slack of Eq. 15", "N m", 1e-9)
    constraint_std: float = parameter(1e-4, "slack of violated constraints", "", 1e-12)
    prior_weight: float = parameter(0.01, "of the geometric prior", "", 0.0)
    corrected_prior: bool = parameter(False, "log-det divergence instead of Eq. 16 as printed")
    iterations: int = parameter(40, "of Levenberg-Marquardt", "", 1, 1000)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class PublishedEstimate:
    """Dynamic parameters (10,), feasible or not, and whether the optimiser ended regularly."""

    dynamic_parameters: Array
    converged: bool


def estimate_as_published(
    steps: TimeSteps,
    method: Method,
    prior: Array | None = None,
    bounds: tuple[Array, Array] | None = None,
    config: PublishedConfig | None = None,
) -> PublishedEstimate:
    """Estimate with one of paper A's methods.

    Args:
        steps: pose triples with contacts.
        method: as named in its Tables I to IV.
        prior: (10,) dynamic parameters for C + G (the paper takes the ground truth).
        bounds: corners of a box that contains the object's convex hull, m, body frame.
        config: weights.
    """
    if method == "Baseline":
        return _least_squares(steps)
    config = config or PublishedConfig()
    inertia = InertiaVariables(principal=method != "Baseline-FG")
    graph, values = _measurement_graph(steps, inertia, config)
    _start(values, inertia, steps)
    if method in ("C, No G", "C + G"):
        low, high = bounds if bounds is not None else (np.full(3, -1.0), np.full(3, 1.0))
        graph.add(consistency_factor(low, high, config.constraint_std))
    if method == "C + G" and prior is not None:
        graph.add(prior_factor(inertia, prior, config.prior_weight, config.corrected_prior))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(config.iterations)
    settings.setlambdaUpperBound(_LARGEST_DAMPING)
    try:
        result = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    except RuntimeError:
        return PublishedEstimate(inertia.read(values)[0], converged=False)
    return PublishedEstimate(inertia.read(result)[0], converged=True)


def _least_squares(steps: TimeSteps) -> PublishedEstimate:
    """Atkeson's ordinary least squares on finite differences with smoothed forces and torques."""
    wrench = net_wrench(steps.point, steps.force)
    window = min(_SMOOTHING_WINDOW, (len(wrench) - 1) // 2 * 2 + 1)
    smooth = savgol_filter(wrench, window, _SMOOTHING_DEGREE, axis=0)
    matrix = regressor(differentiate(steps.rotation, steps.position, steps.time))
    phi = np.linalg.lstsq(matrix.reshape(-1, 10), smooth.reshape(-1), rcond=None)[0]
    return PublishedEstimate(np.asarray(phi), converged=True)


def _measurement_graph(
    steps: TimeSteps, inertia: InertiaVariables, config: PublishedConfig
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Variables and measurement factors of poses, forces and points, with dynamics factors."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pose_noise = gtsam.noiseModel.Diagonal.Sigmas(
        np.repeat([config.rotation_std, config.position_std], 3)
    )
    force_noise = gtsam.noiseModel.Isotropic.Sigma(3, config.force_std)
    point_noise = gtsam.noiseModel.Isotropic.Sigma(3, config.point_std)
    slack = gtsam.noiseModel.Diagonal.Sigmas(
        np.repeat([config.dynamics_force_std, config.dynamics_torque_std], 3)
    )
    silent = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
    contacts = steps.force.shape[1]
    for k in range(len(steps.time)):
        poses = [gtsam.symbol("x", 3 * k + i) for i in range(3)]
        for i, key in enumerate(poses):
            pose = gtsam.Pose3(gtsam.Rot3(steps.rotation[k, i]), steps.position[k, i])
            graph.add(gtsam.PriorFactorPose3(key, pose, pose_noise))
            values.insert(key, pose)
        forces = [gtsam.symbol("f", contacts * k + c) for c in range(contacts)]
        points = [gtsam.symbol("p", contacts * k + c) for c in range(contacts)]
        for c in range(contacts):
            absent = not np.any(steps.force[k, c])
            noise = silent if absent else force_noise
            graph.add(gtsam.PriorFactorPoint3(forces[c], steps.force[k, c], noise))
            graph.add(gtsam.PriorFactorPoint3(points[c], steps.point[k, c], point_noise))
            values.insert(forces[c], steps.force[k, c])
            values.insert(points[c], steps.point[k, c])
        graph.add(dynamics_factor(inertia, poses, forces, points, steps.time[k], slack))
    return graph, values


def _start(values: gtsam.Values, inertia: InertiaVariables, steps: TimeSteps) -> None:
    """Begin with the body that balances gravity alone, as large as the contacts are apart."""
    mass = float(np.median(np.linalg.norm(steps.force.sum(axis=1), axis=1))) / 9.81
    up = steps.rotation[:, 0, 2]
    torque = np.cross(steps.point, steps.force).sum(axis=1)
    com = np.linalg.lstsq((-mass * 9.81 * skew(up)).reshape(-1, 3), torque.reshape(-1), rcond=None)[
        0
    ]
    spread = float(np.var(steps.point.reshape(-1, 3), axis=0).sum())
    moments = mass * ((spread + com @ com) * np.eye(3) - np.outer(com, com))
    vector = np.concatenate([[mass], com, inertia_vector(moments)])
    if not inertia.principal:
        values.insert(VECTOR_KEY, vector)
        return
    start, axes = principal_of_phi(np.concatenate([[mass], mass * com, vector[4:]]))
    values.insert(VECTOR_KEY, start)
    values.insert(AXES_KEY, gtsam.Rot3(axes))
