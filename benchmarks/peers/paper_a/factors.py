"""Factors of paper A's graph: dynamics, geometric prior, physical consistency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np

from benchmarks.peers.paper_a.dynamics import (
    differentiate,
    net_wrench,
    regressor,
)
from benchmarks.peers.paper_a.parameters import phi_of_principal, phi_of_vector
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import pseudo_inertia
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, skew

VECTOR_KEY = gtsam.symbol("w", 0)
AXES_KEY = gtsam.symbol("r", 0)

_STEP = 1e-6


@dataclass(frozen=True)
class InertiaVariables:
    """Which variables hold the inertia: a vector (10,), or m, r_c, L (7,) and a rotation."""

    principal: bool

    @property
    def keys(self) -> list[int]:
        """Keys in the graph."""
        return [VECTOR_KEY, AXES_KEY] if self.principal else [VECTOR_KEY]

    def read(self, values: gtsam.Values) -> tuple[Array, list[Array]]:
        """Dynamic parameters and their Jacobians by each variable."""
        vector = values.atVector(VECTOR_KEY)
        if not self.principal:
            phi, jacobian = phi_of_vector(vector)
            return phi, [jacobian]
        phi, by_vector, by_axes = phi_of_principal(vector, values.atRot3(AXES_KEY).matrix())
        return phi, [by_vector, by_axes]


ErrorFunction = Callable[[gtsam.CustomFactor, gtsam.Values, "list[Array] | None"], Array]


def dynamics_factor(
    inertia: InertiaVariables,
    poses: list[int],
    forces: list[int],
    points: list[int],
    time: Array,
    noise: gtsam.noiseModel.Base,
) -> gtsam.CustomFactor:
    """D(f, p, H, X) of Eq. 14-15: [A - sum f; B - sum p x f] of one pose triple."""
    keys = inertia.keys + poses + forces + points

    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        phi, by_variables = inertia.read(values)
        found = [values.atPose3(key) for key in poses]
        rotation = np.stack([pose.rotation().matrix() for pose in found])
        position = np.stack([pose.translation() for pose in found])
        force = np.stack([values.atPoint3(key) for key in forces])
        point = np.stack([values.atPoint3(key) for key in points])
        matrix = regressor(differentiate(rotation, position, time))
        residual = np.asarray(matrix @ phi - net_wrench(point, force))
        if jacobians is not None:
            columns = [matrix @ j for j in by_variables]
            columns += _by_poses(rotation, position, time, phi)
            columns += [-np.concatenate([np.eye(3), skew(p)]) for p in point]
            columns += [np.concatenate([np.zeros((3, 3)), skew(f)]) for f in force]
            for k, column in enumerate(columns):
                jacobians[k] = column
        return residual

    return gtsam.CustomFactor(noise, keys, error)


def _by_poses(rotation: Array, position: Array, time: Array, phi: Array) -> list[Array]:
    """Central differences by [rotation, translation] of each pose in its own frame, 3 x (6, 6)."""
    steps = np.concatenate([_STEP * np.eye(6), -_STEP * np.eye(6)])
    turns = np.tile(rotation, (3, 12, 1, 1, 1))
    moves = np.tile(position, (3, 12, 1, 1))
    for k in range(3):
        turns[k, :, k] = rotation[k] @ exp_so3(steps[:, :3])
        moves[k, :, k] = position[k] + steps[:, 3:] @ rotation[k].T
    times = np.broadcast_to(time, (3, 12, 3))
    values = regressor(differentiate(turns, moves, times)) @ phi
    slopes = (values[:, :6] - values[:, 6:]) / (2.0 * _STEP)
    return [slopes[k].T for k in range(3)]


def prior_factor(
    inertia: InertiaVariables, prior: Array, weight: float, corrected: bool
) -> gtsam.CustomFactor:
    """Geometric prior of Eq. 16, tr(P0^-1 P), or its corrected form (see below).

    As printed its minimum is P = 0. The convex divergence of Lee, Wensing, Park 2020 is
    tr(P0^-1 P) - log det(P0^-1 P) - 4; its square root is used as the error here.

    Args:
        inertia: variables.
        prior: (10,) dynamic parameters of P0.
        weight: of the squared error.
        corrected: which of the two.
    """
    inverse = np.linalg.inv(pseudo_inertia(prior))
    basis = pseudo_inertia(np.eye(10))
    slope = np.einsum("ij,kji->k", inverse, basis)

    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        phi, by_variables = inertia.read(values)
        value, by_phi = float(slope @ phi), slope
        if corrected:
            matrix = pseudo_inertia(phi)
            sign, logarithm = np.linalg.slogdet(inverse @ matrix)
            excess = max(value - logarithm - 4.0, 1e-12) if sign > 0 else 1e6
            gradient = slope - np.einsum("ij,kji->k", np.linalg.pinv(matrix), basis)
            value = float(np.sqrt(excess))
            by_phi = gradient / (2.0 * value)
        if jacobians is not None:
            for k, jacobian in enumerate(by_variables):
                jacobians[k] = (by_phi @ jacobian)[None]
        return np.array([value])

    noise = gtsam.noiseModel.Isotropic.Sigma(1, 1.0 / np.sqrt(weight))
    return gtsam.CustomFactor(noise, inertia.keys, error)


def consistency_factor(low: Array, high: Array, sigma: float) -> gtsam.CustomFactor:
    """M > 0, r_c in the box [low, high], L >= 0 as costs that act where violated (Eq. 31-33)."""
    noise = gtsam.noiseModel.Isotropic.Sigma(10, sigma)

    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        vector = values.atVector(VECTOR_KEY)
        rows = np.concatenate([-np.eye(7)[:1], np.eye(7)[1:4], -np.eye(7)[1:4], -np.eye(7)[4:]])
        bounds = np.concatenate([[0.0], high, -low, np.zeros(3)])
        violation = rows @ vector - bounds
        active = violation > 0.0
        if jacobians is not None:
            jacobians[0] = rows * active[:, None]
        return np.asarray(np.where(active, violation, 0.0))

    return gtsam.CustomFactor(noise, [VECTOR_KEY], error)
