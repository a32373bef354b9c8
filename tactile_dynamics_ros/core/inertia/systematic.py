"""Uncertainty from what the model leaves unexplained: errors that last do not average out.

Where residuals betray a misfit, a constant wrench in the body frame (a bias, an unsensed contact, a
wrong gain of a squeezing finger) and a constant force in the world (a cable) are presumed with the
variance tau^2 that makes the residuals most likely. They are not estimated; what they would shift
the parameters by is added to the covariance. On data that the model fits, tau is zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples

Array = NDArray[np.float64]

SYSTEMATIC_SIZE = 9
_LIKELIHOOD_GAIN = 3.84
_DECADES = np.geomspace(1e-10, 1e6, 161)
_SMALLEST_LEVER = 0.01


def systematic_lever(samples: WrenchSamples) -> float:
    """Lever in m that turns presumed forces into torques: RMS distance of the contacts."""
    held = samples.contact_point[samples.in_contact]
    if len(held) == 0:
        return _SMALLEST_LEVER
    return max(float(np.sqrt(np.mean(np.sum(held**2, axis=1)))), _SMALLEST_LEVER)


def systematic_basis(rotation: Array, lever: float) -> Array:
    """Wrenches (N, 6, 9) of unit presumed errors: body torque and force, world force.

    Args:
        rotation: (N, 3, 3) R_WO.
        lever: m; unit torques are `lever` N m.
    """
    basis = np.zeros((len(rotation), 6, SYSTEMATIC_SIZE))
    basis[:, :3, :3] = lever * np.eye(3)
    basis[:, 3:, 3:6] = np.eye(3)
    basis[:, 3:, 6:] = np.swapaxes(rotation, 1, 2)
    return basis


def systematic_variance(gram: Array, score: Array) -> float:
    """Variance tau^2 (N^2) of the presumed errors that makes the residuals most likely.

    The score B^T r of white residuals has covariance G; with the errors it is G + tau^2 G G. Zero
    unless the likelihood gains significantly (5 %).

    Args:
        gram: (q, q) G, of the white basis without its projection on the parameters.
        score: (q,) likewise.
    """
    values, vectors = np.linalg.eigh(gram)
    seen = values > 1e-9 * float(values[-1])
    if not seen.any() or values[-1] <= 0.0:
        return 0.0
    values = values[seen]
    square = (vectors[:, seen].T @ score) ** 2 / values
    growth = 1.0 + np.multiply.outer(_DECADES / float(values.mean()), values)
    cost = np.sum(np.log(growth) + square / growth, axis=1)
    best = int(np.argmin(cost))
    if cost[best] > square.sum() - _LIKELIHOOD_GAIN:
        return 0.0
    return float(_DECADES[best] / values.mean())


def systematic_covariance(inverse: Array, cross: Array, gram: Array, score: Array) -> Array:
    """Covariance (p, p) to add to that of the parameters.

    Args:
        inverse: (p, p) of the information of data and prior, J^T J + prior.
        cross: (p, q) J^T B of the white rows; gram: (q, q) B^T B.
        gram: as above.
        score: (q,) B^T r.
    """
    shift = inverse @ cross
    remaining = gram - cross.T @ shift
    variance = systematic_variance(0.5 * (remaining + remaining.T), score)
    return np.asarray(variance * shift @ shift.T)


def systematic_covariance_of_rows(
    inverse: Array, jacobian: Array, basis: Array, residual: Array
) -> Array:
    """`systematic_covariance` of white rows: J (n, p), B (n, q) and r (n,)."""
    cross = jacobian.T @ basis
    score = basis.T @ residual - cross.T @ (inverse @ (jacobian.T @ residual))
    return systematic_covariance(inverse, cross, basis.T @ basis, score)
