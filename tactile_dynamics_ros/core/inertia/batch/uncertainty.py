"""Intervals that stay honest when the model does not fit, and what the motion leaves open."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    dynamic_parameters_from_log_cholesky,
    inertia_vector,
    log_cholesky_jacobian,
)

_SCORE_BLOCK = 300
"""White numbers of a block over which scores are summed: six of each sample, half a second at 100
Hz. Longer than the windows of the motion (±70 ms), short enough that 30 s have 60 blocks, whose
scatter is then known. Of three synthetic recordings it changes only intervals of those that do not
fit: half as long by -9 to +5 %, twice as long by -6 to +17 %."""
_TOLERATED_RATIO = 2.0
"""Variance of the scores between blocks, over that of white noise, up to which standard deviations
are not widened. White noise exceeds 2 in 7 of a million cases with 60 blocks (30 s), in 3 % with
10. At 1 honest intervals of a clean recording grew by 10 %; at 4 correlated errors of three times
the variance would pass unnoticed."""
_OPEN = 0.25
"""Share of the prior's variance that data must leave at most: they have halved the standard
deviation, or the parameter is reported as not excited. At 0.5 weak evidence counts as an estimate;
at 0.1 half-known inertia is called unknown. The live estimator's `_IDENTIFIED` is its inverse."""
_ROUNDING = 1e-12
"""Relative number added to a matrix of unit diagonal so that rounding leaves it positive definite;
ten thousand times the rounding of a number. It changes no ratio that is compared. Above 1e-6 it
would count as information, below 1e-15 it is lost."""
_NOISE_RATIO = 1.5
"""Information of the data over that which noise of the regressors alone would feign, below which a
direction is not excited: at 1.5 a third of what is seen is motion. Where nothing moves it scatters
about 1, so that a bound of 1 takes noise of the poses for excitation; a bound of 3 would ask for
twice as much motion as noise and call gentle motion untold."""
SCATTER = 10.0
"""What the ratio that tells excitation must exceed `_NOISE_RATIO` by, times the root of the number
of samples: 1 at 100 samples, 0.5 for 7 poses held for 1 s at 50 Hz, 0.18 for 30 s at 100 Hz. At
rest the largest of ten such ratios exceeds the bound by chance otherwise; far more calls the first
seconds of a motion untold."""
HOLD = 100.0
"""Weight, over that of the prior, with which unexcited directions are held at it: in the fit they
keep a hundredth of its standard deviation. Less lets noise of the poses move them. Half and twice
as much changed no estimate of three synthetic recordings."""


def _own_coordinates() -> Array:
    """(10, 10) ones where a log-Cholesky coordinate belongs to mass, centre or inertia itself."""
    own = np.zeros((10, 10))
    own[0, 0] = 1.0
    own[1:4, 7:] = 1.0
    own[4:, 1:7] = 1.0
    return own


_OWN_COORDINATES = _own_coordinates()
"""Which of the coordinates [scale, radii, shears, centre] say how large each parameter is by
itself, (10, 10): the mass its scale, the centre itself, inertia radii and shears. Fixed by the
order of the coordinates; elsewhere the size of one parameter would excuse another that is
unexcited."""


def misfit_inflation(white_residual: Array, jacobian: Array) -> Array:
    """Factors by which standard deviations grow when residuals are large or correlated.

    The score of each parameter is summed over blocks of 0.5 s; where its variance between blocks
    exceeds what white unit noise gives, the ratio (a sandwich covariance) is applied.

    Args:
        white_residual: (6 N,).
        jacobian: (6 N, p) its derivative.

    Returns:
        (p,) factors >= 1.

    Source: White 1980; Newey & West 1987 (block form).
    """
    size = min(_SCORE_BLOCK, max(len(white_residual) // 10, 6))
    count = len(white_residual) // size
    used = slice(0, count * size)
    information = jacobian.T @ jacobian
    ridge = 1e-12 * np.trace(information) * np.eye(len(information))
    directions = jacobian[used] @ np.linalg.inv(information + ridge)
    influence = (directions * white_residual[used, None]).reshape(count, size, -1).sum(axis=1)
    expected = np.sum(directions**2, axis=0)
    ratio = np.sum(influence**2, axis=0) / np.maximum(expected, 1e-300)
    scale = float(np.mean(white_residual**2))
    ratio = np.maximum(np.where(ratio > _TOLERATED_RATIO, ratio, 1.0), scale)
    return np.sqrt(np.maximum(ratio, 1.0))


def undetermined_parameters(
    xi: Array, data: Array, prior: Array, covariance: Array, unplaced: bool = False
) -> tuple[str, ...]:
    """Parameters that the data leave open, in the order of PARAMETER_NAMES.

    Their standard deviation is no less than half of the prior's, or, of mass and inertia, larger
    than they are; the size of I_ij is sqrt(I_ii I_jj). The prior of an inertia is that at known
    mass and centre: weighing an object at rest says nothing of how its mass is spread.

    Args:
        xi: (10,) log-Cholesky coordinates.
        data: (10, 10) information of the data on xi.
        prior: (10, 10) information of the prior on xi.
        covariance: (10, 10) of the dynamic parameters, with all that widens it.
        unplaced: whether accelerations are unknown, so that no inertia is determined.
    """
    to_com = com_inertia_jacobian(dynamic_parameters_from_log_cholesky(xi))
    rows = to_com @ log_cholesky_jacobian(xi)
    after = np.einsum("pi,ij,pj->p", rows, np.linalg.inv(data + prior), rows)
    own = rows * _OWN_COORDINATES
    before = np.einsum("pi,ij,pj->p", own, np.linalg.inv(prior), own)
    stated = np.einsum("pi,ij,pj->p", to_com, covariance, to_com)
    is_open = (after > _OPEN * before) | (stated > _sizes(xi) ** 2)
    is_open[4:] |= unplaced
    return tuple(name for name, unknown in zip(PARAMETER_NAMES, is_open, strict=True) if unknown)


def _sizes(xi: Array) -> Array:
    """Sizes (10,) beside which standard deviations are large; none of the centre of mass."""
    body = InertialParameters.from_log_cholesky(xi)
    radii = np.sqrt(np.diag(body.inertia_com))
    inertia = inertia_vector(np.outer(radii, radii))
    return np.concatenate([[body.mass], np.full(3, np.inf), inertia])


def unexcited_directions(
    information: Array, noise: Array, prior: LogCholeskyPrior, scatter: float = 0.0
) -> Array:
    """Directions of standardised xi in which the data are hardly more than noise of the poses.

    Directions are judged at the prior mean, in order of the ratio of all information to that of
    noise, v^T J^T J v / v^T (N + 1) v (generalised eigenvectors).

    Args:
        information: (10, 10) J^T J on phi.
        noise: (10, 10) the part N of it that noise of the regressors feigns.
        prior: of xi.
        scatter: of that ratio where there are few samples; added to what is asked for.

    Returns:
        (10, q) orthonormal directions of (xi - mean) / std.
    """
    mapping = log_cholesky_jacobian(prior.mean) * prior.std
    beside = mapping.T @ noise @ mapping + np.eye(10)
    scale = 1.0 / np.sqrt(np.diag(beside))
    alike = np.outer(scale, scale)
    ratio, vectors = eigh(
        mapping.T @ information @ mapping * alike, beside * alike + _ROUNDING * np.eye(10)
    )
    weak = scale[:, None] * vectors[:, ratio < _NOISE_RATIO + scatter]
    return np.asarray(np.linalg.qr(weak)[0]) if weak.size else np.zeros((10, 0))


def excited_projection(unexcited: Array, prior: LogCholeskyPrior, size: int) -> Array:
    """(size, size) removes unexcited directions from an information on [xi, theta]."""
    keep = np.eye(size)
    keep[:10, :10] -= (unexcited @ unexcited.T) * prior.std / prior.std[:, None]
    return keep
