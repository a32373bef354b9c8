"""Uncertainty from what the model leaves unexplained: errors that last do not average out.

Where residuals betray a misfit, a constant wrench in the body frame (a bias, an unsensed contact),
a constant force in the world (a cable) and gains of the sensors that are off are presumed, with the
variances that make the residuals most likely. The estimate is not corrected by them; what they
would shift the parameters by is added to the covariance. A gain that all sensors share leaves no
trace: only how much they differ says how far they may be off together. On data that the model fits,
the variances are zero.
The live estimate presumes the constant errors only, since more would cost it too much.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.rotation import cross

Array = NDArray[np.float64]

SYSTEMATIC_SIZE = 9
"""Number of constant errors, which come first in a basis."""

_LIKELIHOOD_GAIN = 3.84
_DECADES = np.geomspace(1e-10, 1e6, 161)
_SMALLEST_LEVER = 0.01
_ROUNDS = 2
_QUANTILE = 0.95
_LEAST_SHARE = 1e-4
_TINY = 1e-300


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


def sensor_gain_basis(samples: WrenchSamples) -> Array:
    """Wrenches (N, 6, C) of a unit relative gain of each sensor: its contact's wrench.

    None of an only sensor, (N, 6, 0), whose gain is a heavier load.

    Args:
        samples: with forces whose noise is not that of the residual.
    """
    if len(samples.contact_names) < 2:
        return np.zeros((len(samples.time), 6, 0))
    force = samples.contact_force
    torque = cross(samples.contact_point, force) + samples.contact_torque
    return np.swapaxes(np.concatenate([torque, force], axis=2), 1, 2)


def systematic_variances(mixing: Array, white: Array) -> Array:
    """Variances (q,) of the presumed errors that make the residuals most likely.

    With errors of variances D the numbers that data show of them are N(0, 1 + A D A^T). D is
    tau_c^2 for the constant errors, which come first, and tau_s^2 for the gains of sensors, widened
    for how few they are; each is zero unless the likelihood gains significantly (5 %).

    Args:
        mixing: (r, q) A, see `_shown`.
        white: (r,) likewise.
    """
    kinds = [part for part in np.split(mixing, [SYSTEMATIC_SIZE], axis=1) if part.shape[1]]
    shapes = [part @ part.T for part in kinds]
    fits = [_most_likely(white, shapes, first) for first in range(len(shapes))]
    found, cost = min(fits, key=lambda fit: fit[1])
    if cost >= white @ white:
        return np.zeros(mixing.shape[1])
    if len(found) > 1:
        found[1] *= _student_factor(found, shapes)
    return np.repeat(found, [part.shape[1] for part in kinds])


def _student_factor(variances: Array, shapes: list[Array]) -> float:
    """By what a variance of few gains grows, so that normal 90 % intervals hold.

    The numbers that data show of gains with covariance v S beside other errors C are
    nu = tr(v S (v S + C)^-1), at least one; the factor is (t_nu / t_inf)^2 at 95 %.
    """
    total = np.eye(len(shapes[1])) + np.tensordot(variances, np.array(shapes), axes=1)
    shown = max(variances[1] * float(np.trace(np.linalg.solve(total, shapes[1]))), 1.0)
    return float((stdtrit(shown, _QUANTILE) / ndtri(_QUANTILE)) ** 2)


def _most_likely(white: Array, shapes: list[Array], first: int) -> tuple[Array, float]:
    """Variances v of white ~ N(0, 1 + sum v_k S_k), found in turn, and -2 log likelihood.

    Every variance that is not zero has to earn what would be significant.
    """
    found, cost = np.zeros(len(shapes)), np.inf
    rounds = _ROUNDS if len(shapes) > 1 else 1
    for step in range(rounds * len(shapes)):
        k = (first + step) % len(shapes)
        size = float(np.trace(shapes[k]))
        if size == 0.0:
            continue
        found[k] = 0.0
        present = np.eye(len(white)) + np.tensordot(found, np.array(shapes), axes=1)
        factor = np.linalg.cholesky(present)
        inverse = np.linalg.inv(factor)
        values, vectors = np.linalg.eigh(inverse @ shapes[k] @ inverse.T)
        square = (vectors.T @ (inverse @ white)) ** 2
        tried = np.append(0.0, _DECADES * len(white) / size)
        growth = 1.0 + np.multiply.outer(tried, np.maximum(values, 0.0))
        costs = np.sum(np.log(growth) + square / growth, axis=1)
        costs += 2.0 * np.sum(np.log(np.diag(factor)))
        costs += _LIKELIHOOD_GAIN * (np.count_nonzero(found) + (tried > 0.0))
        best = int(np.argmin(costs))
        found[k], cost = tried[best], float(costs[best])
    return found, cost


def systematic_covariance(inverse: Array, cross: Array, gram: Array, score: Array) -> Array:
    """Covariance (p, p) to add to that of the parameters.

    Args:
        inverse: (p, p) of the information of data and prior, J^T J + prior.
        cross: (p, q) J^T B of the white rows.
        gram: (q, q) B^T B.
        score: (q,) B^T r of the residuals after the fit.
    """
    shift = inverse @ cross
    mixing, white = _shown(gram, gram - cross.T @ shift, score)
    moment = _second_moment(systematic_variances(mixing, white), mixing, white)
    return np.asarray(shift @ moment @ shift.T)


def _shown(gram: Array, beside: Array, score: Array) -> tuple[Array, Array]:
    """What data show of unit errors beside the parameters: A (r, q) and white numbers (r,).

    The score has covariance A^T A. Directions and errors of which next to nothing is left, such as
    the gain of an only sensor, which is a heavier load, are not shown: there the rest is rounding,
    and what noise of the regressors leaves of it.

    Args:
        gram: (q, q) B^T B.
        beside: (q, q) without its projection on the parameters.
        score: (q,) likewise.
    """
    length = np.sqrt(np.maximum(np.diag(gram), _TINY))
    values, vectors = np.linalg.eigh(beside / np.outer(length, length))
    seen = values > _LEAST_SHARE
    root, kept = np.sqrt(values[seen]), vectors[:, seen]
    mixing = root[:, None] * kept.T
    mixing[:, np.sum(mixing**2, axis=0) < _LEAST_SHARE] = 0.0
    return mixing * length, kept.T @ (score / length) / root


def _second_moment(variances: Array, mixing: Array, white: Array) -> Array:
    """E[b b^T] (q, q) of the presumed errors b.

    Gains of sensors are what the data say of them: with P = (D^-1 + A^T A)^-1 and white numbers w,
    P + P A^T w w^T A P. Constant errors stand in for much that is not modelled, so that their
    variance alone counts.
    """
    moment = np.diag(variances)
    if not variances[SYSTEMATIC_SIZE:].any():
        return moment
    root = np.sqrt(variances)
    own = mixing * root
    posterior = np.linalg.inv(np.eye(len(root)) + own.T @ own) * np.outer(root, root)
    found = posterior @ (mixing.T @ white)
    gains = slice(SYSTEMATIC_SIZE, None)
    moment[gains, gains] = posterior[gains, gains] + np.outer(found[gains], found[gains])
    return moment


def systematic_covariance_of_rows(
    inverse: Array, jacobian: Array, basis: Array, residual: Array
) -> Array:
    """`systematic_covariance` of white rows: J (n, p), B (n, q) and r (n,)."""
    cross = jacobian.T @ basis
    score = basis.T @ residual - cross.T @ (inverse @ (jacobian.T @ residual))
    return systematic_covariance(inverse, cross, basis.T @ basis, score)
