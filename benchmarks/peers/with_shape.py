"""What others do with a wrench, a motion and a shape: OLS, entropic regularisation, parts.

All take the same white rows A (M, 10) and w (M,), w = A phi + noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy
import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.optimize import nnls

from tactile_dynamics_ros.core.inertia.shape_prior import point_masses
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import pseudo_inertia
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor

Array = np.ndarray

PARTS = 8
"""Parts of a tool: the authors' tools have one to six. More parts follow the noise."""
WEIGHTS = (1.0, 100.0, 1000.0, 10000.0)
"""Weights of the divergence beside half the squared white error. The table has the best by its
median, which nobody knows beforehand."""


@dataclass(frozen=True)
class Rows:
    """Normal equations of the white rows.

    Attributes:
        root: (10, 10) R with R^T R = A^T A. target: (10,) Q^T w.
    """

    root: Array
    target: Array

    @classmethod
    def of(
        cls,
        motion: tuple[Array, Array, Array],
        wrench: Array,
        std: tuple[float, float],
    ) -> Rows:
        """Whiten by the noise of torque and force.

        Args:
            motion: (N, 3) specific acceleration, angular velocity and its derivative, body axes.
            wrench: (N, 6) [torque, force], body axes.
            std: of torque, N m, and force, N.
        """
        noise = np.repeat(std, 3)
        rows = (regressor(*motion) / noise[:, None]).reshape(-1, 10)
        stacked = np.linalg.qr(np.column_stack([rows, (wrench / noise).reshape(-1)]), mode="r")
        return cls(stacked[:10, :10], stacked[:10, 10])


def least_squares(rows: Rows) -> Array:
    """Ordinary least squares, (10,)."""
    return np.linalg.lstsq(rows.root, rows.target, rcond=None)[0]


def entropic(rows: Rows, guess: Array, weight: float) -> Array:
    """Least squares with a log-det divergence from a body (10,), (10,).

    Source: Lee, Wensing, Park 2020 (convex in the pseudo-inertia).
    """
    half = np.linalg.cholesky(pseudo_inertia(guess))
    inverse = np.linalg.inv(half)
    scale = np.maximum(np.abs(guess), 1e-3 * np.abs(guess).max())
    basis = inverse @ pseudo_inertia(np.eye(10)) @ inverse.T * scale[:, None, None]
    variable = cvxpy.Variable(10)
    matrix = sum(variable[k] * basis[k] for k in range(10))
    unit = float(np.linalg.norm(rows.root * scale))
    misfit = cvxpy.sum_squares((rows.root * scale / unit) @ variable - rows.target / unit)
    divergence = cvxpy.trace(matrix) - cvxpy.log_det(matrix)
    problem = cvxpy.Problem(cvxpy.Minimize(misfit + 2.0 * weight / unit**2 * divergence))
    try:
        problem.solve(solver=cvxpy.CLARABEL)
    except cvxpy.SolverError:
        return np.full(10, np.nan)
    return np.full(10, np.nan) if variable.value is None else np.asarray(variable.value) * scale


def homogeneous_parts(rows: Rows, points: Array, count: int = PARTS) -> Array:
    """Least squares with a density that is even in each of some parts and not negative, (10,).

    Source: Nadeau, Giamou, Kelly 2023; parts are clusters of the volume instead of their
    segmentation, which is not in the data.

    Args:
        rows: white.
        points: (N, 3) m, evenly spread in the volume.
        count: of parts.
    """
    _, label = kmeans2(points, count, minit="++", seed=0)
    masses = point_masses(points)
    parts = np.array([masses[label == k].mean(axis=0) for k in np.unique(label)])
    shares, _ = nnls(rows.root @ parts.T, rows.target)
    return shares @ parts
