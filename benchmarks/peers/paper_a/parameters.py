"""The two parametrisations of paper A: a plain vector, and m, r_c, L, R. Source: Eq. 18-26."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import inertia_matrix, inertia_vector
from tactile_dynamics_ros.core.rigid_body.rotation import skew

_SUMS = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]])


def phi_of_vector(vector: Array) -> tuple[Array, Array]:
    """Dynamic parameters and their Jacobian (10, 10) of [m, r_c, H] as independent numbers."""
    mass, com = vector[0], vector[1:4]
    jacobian = np.eye(10)
    jacobian[1:4, 0], jacobian[1:4, 1:4] = com, mass * np.eye(3)
    return np.concatenate([[mass], mass * com, vector[4:]]), jacobian


def phi_of_principal(vector: Array, rotation: Array) -> tuple[Array, Array, Array]:
    """Dynamic parameters of m, r_c, L (7,) and the principal axes R; Jacobians (10, 7), (10, 3).

    H = R diag(L_y + L_z, L_x + L_z, L_x + L_y) R^T about the body origin (Eq. 25-26). The rotation
    is perturbed on the right.
    """
    mass, com, moments = vector[0], vector[1:4], vector[4:]
    diagonal = np.diag(_SUMS @ moments)
    phi = np.concatenate([[mass], mass * com, inertia_vector(rotation @ diagonal @ rotation.T)])
    by_vector, by_rotation = np.zeros((10, 7)), np.zeros((10, 3))
    by_vector[0, 0] = 1.0
    by_vector[1:4, 0], by_vector[1:4, 1:4] = com, mass * np.eye(3)
    for k in range(3):
        by_vector[4:, 4 + k] = inertia_vector(rotation @ np.diag(_SUMS[:, k]) @ rotation.T)
        turn = skew(np.eye(3)[k])
        change = rotation @ (turn @ diagonal - diagonal @ turn) @ rotation.T
        by_rotation[4:, k] = inertia_vector(change)
    return phi, by_vector, by_rotation


def principal_of_phi(phi: Array) -> tuple[Array, Array]:
    """m, r_c, L (7,) and principal axes (3, 3) of dynamic parameters."""
    values, vectors = np.linalg.eigh(inertia_matrix(phi[4:]))
    axes = vectors * np.sign(np.linalg.det(vectors))
    moments = 0.5 * values.sum() - values
    return np.concatenate([phi[:1], phi[1:4] / phi[0], moments]), axes
