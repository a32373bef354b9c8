"""Mass, centre of mass and inertia of a rigid body, estimated or known beforehand.

phi = [m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz] about the frame origin;
pseudo-inertia P = [[S, m c], [m c^T, m]] with S = tr(I)/2 1 - I, positive definite exactly for the
bodies that can exist (density-realisable).
Source: Wensing, Kim, Slotine 2018; Rucker, Wensing 2022; paper A, Eq. 17.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import skew

_AXES = np.arange(3)
"""Numbers of the three axes, by which entries of a diagonal are addressed; fixed by space."""
_LOGARITHMS = 1 + _AXES
"""Places of the logarithms of the radii among the log-Cholesky coordinates. Fixed by the order of
these coordinates ([scale, radii, shears, centre]); elsewhere derivatives would be those of other
coordinates."""
_SHEAR_BASIS = np.zeros((10, 4, 4))
"""Derivative (10, 4, 4) of the Cholesky factor by the shears and the centre of mass, over the
factor's last entry. Fixed by the order of the coordinates; an entry elsewhere makes derivatives
that do not fit `log_cholesky_factor`, and fits that do not converge."""
_SHEAR_BASIS[range(4, 10), [0, 1, 0, 0, 1, 2], [1, 2, 2, 3, 3, 3]] = 1.0
_INERTIA_ROWS = np.array([0, 0, 1, 0, 1, 2])
"""Rows of the six numbers of an inertia matrix, [I_xx, I_xy, I_yy, I_xz, I_yz, I_zz]. The order is
that of `PARAMETER_NAMES` and of `newton_euler._INERTIA_MAP`; another one here alone would mix up
moments and products."""
_INERTIA_COLUMNS = np.array([0, 1, 1, 2, 2, 2])
"""Columns of these six numbers. Fixed with the rows."""


def _pseudo_inertia_basis() -> Array:
    """Constant tensor B (10, 4, 4) with P = sum_k phi_k B_k."""
    basis = np.zeros((10, 4, 4))
    basis[0, 3, 3] = 1.0
    for axis in range(3):
        basis[1 + axis, axis, 3] = basis[1 + axis, 3, axis] = 1.0
    for k, (i, j) in enumerate(zip(_INERTIA_ROWS, _INERTIA_COLUMNS, strict=True)):
        if i == j:
            basis[4 + k, :3, :3] = 0.5 * np.eye(3)
            basis[4 + k, i, i] -= 1.0
        else:
            basis[4 + k, i, j] = basis[4 + k, j, i] = -1.0
    return basis


_PSEUDO_BASIS = _pseudo_inertia_basis()
"""Tensor B (10, 4, 4) with the pseudo-inertia P = sum_k phi_k B_k. Computed once from the
definition (paper A, Eq. 17) since it is needed at each step of a fit; nothing in it is a choice.
Another basis is another definition of the ten numbers."""


def _pseudo_inertia_inverse() -> Array:
    """Constant matrix (16, 10) with phi = vec(P) A: mass, first moment, I = tr(S) 1 - S."""
    unit = np.eye(16).reshape(16, 4, 4)
    second = unit[:, :3, :3]
    trace = np.einsum("kii->k", second)[:, None, None]
    inertia = (trace * np.eye(3) - second)[:, _INERTIA_ROWS, _INERTIA_COLUMNS]
    return np.concatenate([unit[:, 3, 3, None], unit[:, :3, 3], inertia], axis=1)


_FROM_PSEUDO = _pseudo_inertia_inverse()
"""Matrix A (16, 10) of the inverse, phi = vec(P) A. Computed once, for the same reason. It is the
basis' inverse: another one does not give back what was put in."""


def inertia_matrix(six: Array) -> Array:
    """Symmetric matrix of [I_xx, I_xy, I_yy, I_xz, I_yz, I_zz], (..., 6) -> (..., 3, 3)."""
    values = np.asarray(six, dtype=float)
    matrix = np.zeros((*values.shape[:-1], 3, 3))
    matrix[..., _INERTIA_ROWS, _INERTIA_COLUMNS] = values
    matrix[..., _INERTIA_COLUMNS, _INERTIA_ROWS] = values
    return matrix


def inertia_vector(matrix: Array) -> Array:
    """[I_xx, I_xy, I_yy, I_xz, I_yz, I_zz] of a symmetric matrix, (..., 3, 3) -> (..., 6)."""
    return np.asarray(matrix, dtype=float)[..., _INERTIA_ROWS, _INERTIA_COLUMNS]


def pseudo_inertia(dynamic_parameters: Array) -> Array:
    """Pseudo-inertia of dynamic parameters, (..., 10) -> (..., 4, 4). Source: paper A, Eq. 17."""
    return np.asarray(np.tensordot(dynamic_parameters, _PSEUDO_BASIS, axes=([-1], [0])))


def dynamic_parameters_from_pseudo_inertia(matrix: Array) -> Array:
    """Dynamic parameters of a pseudo-inertia, (..., 4, 4) -> (..., 10): I = tr(S) 1 - S."""
    p = np.asarray(matrix, dtype=float)
    return np.asarray(p.reshape(*p.shape[:-2], 16) @ _FROM_PSEUDO)


def log_cholesky_factor(xi: Array) -> Array:
    """Upper-triangular factor U (4, 4) of log-Cholesky coordinates (10,), P = U U^T."""
    s12, s23, s13, t1, t2, t3 = xi[4:].tolist()
    scale, e1, e2, e3 = np.exp(xi[:4]).tolist()
    rows = [[e1, s12, s13, t1], [0.0, e2, s23, t2], [0.0, 0.0, e3, t3], [0.0, 0.0, 0.0, 1.0]]
    return np.asarray(scale * np.array(rows))


def dynamic_parameters_from_log_cholesky(xi: Array) -> Array:
    """Dynamic parameters of log-Cholesky coordinates; every xi in R^10 is a body that can exist.

    P = U U^T with U = e^alpha [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3],
    [0, 0, 0, 1]].

    Args:
        xi: (10,) [alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3].

    Source: Rucker, Wensing 2022, Eq. 13-15.
    """
    factor = log_cholesky_factor(np.asarray(xi, dtype=float))
    return dynamic_parameters_from_pseudo_inertia(factor @ factor.T)


def log_cholesky(matrix: Array) -> Array:
    """Log-Cholesky coordinates (10,) of a positive definite pseudo-inertia (4, 4).

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite (no such body exists).
    """
    flipped = np.linalg.cholesky(np.asarray(matrix, dtype=float)[::-1, ::-1])
    upper = flipped[::-1, ::-1]
    alpha = np.log(upper[3, 3])
    scaled = upper / upper[3, 3]
    logs = np.log(np.diag(scaled)[:3])
    shears = [scaled[0, 1], scaled[1, 2], scaled[0, 2], scaled[0, 3], scaled[1, 3], scaled[2, 3]]
    return np.array([alpha, *logs, *shears])


def log_cholesky_factor_derivatives(factor: Array) -> Array:
    """Derivative dU/dxi, (10, 4, 4), of `log_cholesky_factor` at a factor U (4, 4)."""
    derivatives = factor[3, 3] * _SHEAR_BASIS
    derivatives[0] = factor
    derivatives[_LOGARITHMS, _AXES, _AXES] = factor[_AXES, _AXES]
    return np.asarray(derivatives)


def log_cholesky_jacobian(xi: Array) -> Array:
    """Derivative d phi / d xi, (10, 10), of `dynamic_parameters_from_log_cholesky`."""
    factor = log_cholesky_factor(np.asarray(xi, dtype=float))
    derivatives = log_cholesky_factor_derivatives(factor)
    half = derivatives @ factor.T
    return dynamic_parameters_from_pseudo_inertia(half + np.swapaxes(half, -1, -2)).T


def is_feasible(dynamic_parameters: Array) -> bool:
    """Whether a body with these parameters can exist: the pseudo-inertia is positive definite."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(dynamic_parameters))[..., 0].min() > 0.0)


def _relative_eigenvalues(truth: Array, estimate: Array) -> Array:
    factor = np.linalg.cholesky(truth)
    half = np.linalg.solve(factor, estimate)
    return np.linalg.eigvalsh(np.linalg.solve(factor, np.swapaxes(half, -1, -2)))


def affine_invariant_distance(truth: Array, estimate: Array) -> float:
    """Distance sqrt(sum log^2 eig(P_truth^-1 P_estimate)); inf if the estimate is infeasible."""
    values = _relative_eigenvalues(truth, estimate)
    return float(np.sqrt(np.sum(np.log(values) ** 2))) if values.min() > 0 else float("inf")


def log_det_divergence(truth: Array, estimate: Array) -> float:
    """Divergence tr(P_0^-1 P) - log det(P_0^-1 P) - 4, inf if infeasible; Lee & Park 2018."""
    values = _relative_eigenvalues(truth, estimate)
    return float(np.sum(values - np.log(values) - 1.0)) if values.min() > 0 else float("inf")


def trace_error(truth: Array, estimate: Array) -> float:
    """The "inertial error" |4 - tr(P_gt^-1 P_est)| of paper A, Eq. 34.

    Not a distance: zero for every estimate with trace 4 and 4 for an estimate of nothing;
    kept for comparison with the paper only.
    """
    return float(abs(4.0 - np.trace(np.linalg.solve(truth, estimate))))


@dataclass(frozen=True)
class InertialParameters:
    """Mass, centre of mass and inertia about the centre of mass, body axes.

    Attributes:
        mass: kg.
        com: (3,) m, body frame.
        inertia_com: (3, 3) kg m^2 about the centre of mass, tensor signs (I_xy = -integral xy dm).
    """

    mass: float
    com: Array
    inertia_com: Array

    @classmethod
    def from_dynamic_parameters(cls, dynamic_parameters: Array) -> InertialParameters:
        """Build from phi about the origin: I_c = I_o - m (c.c 1 - c c^T) (parallel axes).

        Source: paper A, erratum to "H_cm = H - m r r^T", which lacks the trace part.
        """
        phi = np.asarray(dynamic_parameters, dtype=float)
        com = phi[1:4] / phi[0]
        cross = skew(com)
        return cls(float(phi[0]), com, inertia_matrix(phi[4:]) + phi[0] * cross @ cross)

    @classmethod
    def from_log_cholesky(cls, xi: Array) -> InertialParameters:
        """Build from log-Cholesky coordinates (10,)."""
        return cls.from_dynamic_parameters(dynamic_parameters_from_log_cholesky(xi))

    @cached_property
    def inertia_origin(self) -> Array:
        """Inertia about the frame origin, (3, 3)."""
        cross = skew(np.asarray(self.com, dtype=float))
        return np.asarray(self.inertia_com - self.mass * cross @ cross)

    @cached_property
    def dynamic_parameters(self) -> Array:
        """Ten parameters phi about the origin, (10,)."""
        first = self.mass * np.asarray(self.com, dtype=float)
        return np.concatenate([[self.mass], first, inertia_vector(self.inertia_origin)])

    @property
    def even_ellipsoid(self) -> tuple[Array, Array]:
        """Semi-axes (3,), m, and directions (3, 3), a rotation, of the solid of equal inertia.

        An ellipsoid of even density at the centre of mass: r_k^2 = 5 s_k / m, second moments s_k.
        """
        second = 0.5 * np.trace(self.inertia_com) * np.eye(3) - self.inertia_com
        values, directions = np.linalg.eigh(second)
        directions[:, 0] *= np.linalg.det(directions)
        return np.sqrt(5.0 * np.maximum(values, 0.0) / self.mass), directions

    @cached_property
    def pseudo_inertia(self) -> Array:
        """(4, 4) pseudo-inertia about the origin."""
        return pseudo_inertia(self.dynamic_parameters)


def com_inertia_jacobian(dynamic_parameters: Array) -> Array:
    """Derivative of [m, c (3), I_c (6)] with respect to phi, (10, 10); for interval propagation.

    With h = m c: c = h / m and I_c = I_o - (h.h 1 - h h^T) / m.
    """
    phi = np.asarray(dynamic_parameters, dtype=float)
    mass, first = phi[0], phi[1:4]
    jacobian = np.zeros((10, 10))
    jacobian[0, 0] = 1.0
    jacobian[1:4, 0], jacobian[1:4, 1:4] = -first / mass**2, np.eye(3) / mass
    spread = first @ first * np.eye(3) - np.outer(first, first)
    jacobian[4:, 0] = inertia_vector(spread) / mass**2
    for axis in range(3):
        unit = np.eye(3)[axis]
        change = 2.0 * first[axis] * np.eye(3) - np.outer(unit, first) - np.outer(first, unit)
        jacobian[4:, 1 + axis] = -inertia_vector(change) / mass
    jacobian[4:, 4:] = np.eye(6)
    return jacobian


@dataclass(frozen=True)
class KnownBody:
    """Dynamic parameters with their covariance, in the body frame of the recordings.

    Attributes:
        phi: (10,) dynamic parameters.
        covariance: (10, 10) of phi; zero where it is not known.
        name: where it comes from.
        undetermined: parameters that nothing has told yet.
        effects: effects that were found with it: name to parameters with value, std and unit.
        recordings: number of recordings that it comes from.
        lasting: (10, 10) part of the covariance that lasting errors of the sensors make; None where
            it is not known by itself.
    """

    phi: Array
    covariance: Array
    name: str
    undetermined: tuple[str, ...] = ()
    effects: dict[str, Any] = field(default_factory=dict)
    recordings: int = 0
    lasting: Array | None = None

    @classmethod
    def exact(cls, body: InertialParameters, name: str) -> KnownBody:
        """A body whose uncertainty is not stated."""
        return cls(body.dynamic_parameters, np.zeros((10, 10)), name)

    @property
    def is_exact(self) -> bool:
        """Whether no uncertainty is stated."""
        return not self.covariance.any()
