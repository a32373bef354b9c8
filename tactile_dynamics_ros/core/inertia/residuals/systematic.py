"""Errors that last: presumed where residuals show them, corrected as far as that is safe.

Where residuals betray a misfit, a constant wrench in the body frame (sensors and finger frames
that are off), a constant force in the world (a cable), gains of the sensors that are off, contacts
that are elsewhere, and what each sensor shows along one axis of a load along another are presumed,
with the variances that make the residuals most likely. On data that the model fits, they are zero.

A reported estimate is corrected by the constant wrench of the sensors, to which a small share of
the load is granted beforehand: residuals are correlated, and much that is not modelled, such as
fingertips that give way to inertial forces, looks a little like it. What all presumed errors would
shift the parameters by is added to the covariance, as if nothing had been corrected; explanations
that the data do not tell apart count by their probability. A gain that all sensors share leaves no
trace: only how much they differ says how far they may be off together.

Sensors whose stated noise grows with what they carry, such as calibrated fingertips, have errors of
all kinds in usual proportions, and data only say how large: live and offline estimates state alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri, stdtrit

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.rotation import cross

SYSTEMATIC_SIZE = 9
"""Number of constant errors, which come first in a basis. Fixed by the kinds: torque and force of
the sensors in the body frame (3 each), and force in the world's (3). Others here alone would shift
the columns of a row."""
_BODY_SIZE = 6
"""Number of those that are constant in the body frame (torque and force of the sensors); they come
first. Fixed by these kinds."""

_PER_SENSOR = 13
"""Errors of a sensor: its gain, the place of its contact (3), and the nine entries of the matrix
that mixes its axes. Fixed by these kinds."""
_GAINS = 2
"""Place of the gains among the kinds of errors: body, world, gains, places, mixings. Fixed by this
order; at another one the variance of other errors would grow for how few the gains are."""

_GRANTED = 0.003
"""Standard deviation, over the load, of the constant wrench by which estimates are corrected. Of 32
recordings in the simulated hand masses were off by 1.36 and 1.04 % RMS with it, 2.48 and 1.98 %
without, and 1.0 % with twice as much; but five quick motions of the demo were off by 1.8 % with it
and 2.7 % with twice as much (docs/lab/in_hand.md)."""

_LIKELIHOOD_GAIN = 3.84
"""By how much twice the log likelihood must grow for each variance of lasting errors that is
presumed: 0.95 quantile of chi squared with one degree of freedom. Clean recordings then get wider
intervals in at most one case of twenty; 2.7 would be one in ten, and 6.6 one in a hundred, at the
price of errors that stay unnoticed."""
_DECADES = np.geomspace(1e-10, 1e6, 161)
"""Variances that are tried, over that at which errors and white noise are alike: sixteen decades,
ten values each. The best lies within 12 % of one of them, in standard deviation 6 %. A coarser grid
chooses variances that are further off, a narrower one cuts off large errors."""
_SMALLEST_LEVER = 0.01
"""Lever, m, that presumed torques have at least: contacts that all lie at the body's origin would
leave none. Contacts around an object are farther apart, so that it hardly acts. Larger presumes too
large errors of torque for a small grasp; at zero a sensor at the origin has a basis of zeros."""
_IMPROBABLE = 0.01
"""Probability, over that of the most probable explanation, below which one is left out: it would
have added a hundredth of the variance that it leaves. A tenth leaves out what may well
hold, a thousandth costs time."""
_USUAL = np.array([np.inf, np.inf, 0.1, 0.005, 0.1])
"""Standard deviations of errors of each kind before any data: a tenth for gains and mixed axes, and
the 5 mm of a fingertip's patch for places; constant wrenches may be anything. Without them gains of
300 % were presumed in the simulated hand where places explain what remains. Smaller ones hold gains
of 20 % back, larger ones let kinds trade places where few numbers show them."""
_FINGERTIPS = np.array([0.015, 0.006, 0.03, 0.0015, 0.015])
"""Standard deviations of each kind of errors of sensors that state shares of their load: wrenches
of the body and forces of the world over the load, gains, places in m, and mixed axes. Only their
proportions matter where data say how large. In the simulated hand 97 to 99 % of 90 % intervals hold
(15 recordings, hands 9401 to 9408) and the worst is off by 2.4; half and twice of one kind changed
coverage on hands 101 to 105 by at most 3 %."""
_ALIKE = 9.0
"""Samples that tell as much of lasting errors as one alone, of such sensors: what remains of
fingertips is alike for a tenth of a second. On hands 101 to 105 96 % of 90 % intervals held at 9,
and 98 % at 4, which are a fifth wider; at 1 all that remains is taken to last."""
_QUANTILE = 0.95
"""Quantile of Student's t at which few gains are made up for: that of two-sided 90 % intervals, as
the product states them. A higher one widens intervals of few gains more: Student's tails differ the
more from the normal's, the farther out one looks."""
_LEAST_SHARE = 1e-4
"""Share of a unit error that must be left beside the body's parameters to be shown by data; of less
the rest is rounding and what noise of the regressors leaves of it. With none, the gain of an only
sensor, which is a heavier load, was presumed from rounding, and masses became uncertain by
kilograms."""
_TINY = 1e-300
"""Smallest squared length that is divided by, near the least that a double holds; a column of zeros
then stays one. Any number below the squares of real columns does the same; zero divides by zero."""


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


def sensor_basis(samples: WrenchSamples) -> Array:
    """Wrenches (N, 6, 12 C) of unit errors of sensors, twelve of each: place, m, and mixings.

    Those of a sensor are moments e_i x f about its axes e_i, f its force, and e_i e_j^T f for all
    axes i and j, f its torque and force: any matrix that multiplies what a sensor measures is a sum
    of these. Sensors follow each other, so that one that comes later adds columns at the end. None
    of an only sensor, (N, 6, 0), whose gain is a heavier load.
    """
    count, contacts = samples.contact_force.shape[:2]
    if contacts < 2:
        return np.zeros((count, 6, 0))
    axes = samples.contact_rotation
    # [n, c, i, j, :] is the part of contact c's force (torque) along axis j, turned to axis i.
    force = np.einsum("ncxi,ncyj,ncy->ncijx", axes, axes, samples.contact_force)
    own = np.einsum("ncxi,ncyj,ncy->ncijx", axes, axes, samples.contact_torque)
    torque = cross(samples.contact_point[:, :, None, None], force) + own
    mixed = np.concatenate([torque, force], axis=-1).reshape(count, contacts, 9, 6)
    places = np.zeros((count, contacts, 3, 6))
    places[..., :3] = cross(np.swapaxes(axes, 2, 3), samples.contact_force[:, :, None])
    columns = np.concatenate([places, mixed], axis=2).reshape(count, 12 * contacts, 6)
    return np.swapaxes(columns, 1, 2)


def lasting_basis(samples: WrenchSamples, lever: float) -> Array:
    """Wrenches (N, 6, 9 + 12 C) of all unit errors: `systematic_basis` and `sensor_basis`."""
    constant = systematic_basis(samples.rotation, lever)
    return np.concatenate([constant, sensor_basis(samples)], axis=2)


def with_gains(columns: int) -> Array:
    """Matrix (9 + 12 C, 9 + 13 C) that sorts columns by kind: constant, gains, places, mixings.

    A gain is the sum of the three mixings of an axis with itself.

    Args:
        columns: 9 + 12 C, of `lasting_basis`.
    """
    every = np.eye(columns)
    by_sensor = every[:, SYSTEMATIC_SIZE:].reshape(columns, -1, 12)
    places, mixed = (part.reshape(columns, -1) for part in np.split(by_sensor, [3], axis=2))
    gains = np.trace(mixed.reshape(columns, -1, 3, 3), axis1=2, axis2=3)
    return np.concatenate([every[:, :SYSTEMATIC_SIZE], gains, places, mixed], axis=1)


def fingertip_variances(mixing: Array, white: Array, load: float) -> Array:
    """Variances (q,) of errors that are usual but for one scale, which data tell.

    Numbers that data show are N(0, s^2 (n + A U A^T)): U what is usual, n samples alike, and s^2
    the mean of their white squares, with one more that is as usual. Source: Birge 1932.

    Args:
        mixing: (r, q) A, see `_shown`; q is 9 + 13 C.
        white: (r,) white numbers, see `_shown`.
        load: N, weight that the sensors carry.
    """
    contacts = (mixing.shape[1] - SYSTEMATIC_SIZE) // _PER_SENSOR
    sizes = [_BODY_SIZE, SYSTEMATIC_SIZE - _BODY_SIZE, *contacts * np.array([1, 3, 9])]
    usual = np.repeat((_FINGERTIPS * [load, load, 1.0, 1.0, 1.0]) ** 2, sizes)
    usual *= mixing.any(axis=0)
    expected = _ALIKE * np.eye(len(white)) + (mixing * usual) @ mixing.T
    square = float(white @ np.linalg.solve(expected, white))
    return np.asarray(usual * (1.0 + square) / (1.0 + len(white)))


def systematic_variances(mixing: Array, white: Array) -> list[tuple[float, Array]]:
    """Probabilities of explanations of the data, each with variances (q,) of the errors.

    With errors of variances D the numbers that data show of them are N(0, 1 + A D A^T). D is one
    number each for constant wrenches of the body, constant forces of the world, and gains, places
    and mixings of sensors; that of gains is widened for how few they are. An explanation has some
    of these kinds, with the variances that make the data most likely; every kind in it has to earn
    what would be significant (5 %), and none at all is one. Kinds are added to the most likely
    explanation one at a time. Explanations are weighed by their likelihoods, since short recordings
    do not tell them apart, and each leaves other parameters uncertain. Source: Hoeting et al. 1999.

    Args:
        mixing: (r, q) A, see `_shown`; q is 9 + 13 C, or 9 of an only sensor.
        white: (r,) white numbers, see `_shown`.

    Returns:
        The most probable first.
    """
    contacts = (mixing.shape[1] - SYSTEMATIC_SIZE) // _PER_SENSOR
    sizes = np.array([_BODY_SIZE, SYSTEMATIC_SIZE - _BODY_SIZE, *contacts * np.array([1, 3, 9])])
    sizes = sizes[sizes > 0]
    parts = np.split(mixing, np.cumsum(sizes)[:-1], axis=1)
    shapes = np.array([part @ part.T for part in parts])
    best, cost = np.zeros(len(sizes)), float(white @ white)
    found = [(cost, best)]
    for _ in sizes:
        absent = np.flatnonzero(best == 0.0).tolist()
        tried = [_with_kind(white, shapes, best, kind) for kind in absent]
        found += [(c, v) for c, v in tried if np.count_nonzero(v) > np.count_nonzero(best)]
        if (least := min(found, key=lambda f: f[0]))[0] >= cost:
            break
        cost, best = least
    costs = np.array([c for c, _ in found])
    weights = np.exp(-0.5 * (costs - costs.min()))
    weights *= weights > _IMPROBABLE
    weights /= weights.sum()
    if contacts:
        for _, variances in found:
            variances[_GAINS] *= _student_factor(variances, shapes)
    order = np.argsort(-weights, kind="stable")
    return [(float(weights[k]), np.repeat(found[k][1], sizes)) for k in order if weights[k] > 0.0]


def _with_kind(white: Array, shapes: Array, variances: Array, kind: int) -> tuple[float, Array]:
    """Cost and variances v of white ~ N(0, 1 + sum v_k S_k) with one kind more, found in turn.

    The cost is -2 log likelihood and what each variance has to earn.
    """
    found, cost = variances.copy(), np.inf
    for own in (kind, *np.flatnonzero(variances).tolist()):
        found[own], cost = _most_likely_one(white, shapes, found, own)
    return cost, found


def _student_factor(variances: Array, shapes: Array) -> float:
    """Factor by which the variance of few gains grows, so that normal 90 % intervals hold.

    The numbers that data show of gains with covariance v S beside other errors C are
    nu = tr(v S (v S + C)^-1), at least one; the factor is (t_nu / t_inf)^2 at 95 %.
    """
    total = _covariance(variances, shapes)
    own = variances[_GAINS] * shapes[_GAINS]
    shown = max(float(np.trace(np.linalg.solve(total, own))), 1.0)
    return float((stdtrit(shown, _QUANTILE) / ndtri(_QUANTILE)) ** 2)


def _covariance(variances: Array, shapes: Array) -> Array:
    """1 + sum v_k S_k, (r, r)."""
    return np.asarray(np.eye(shapes.shape[1]) + np.tensordot(variances, shapes, axes=1))


def _most_likely_one(
    white: Array, shapes: Array, variances: Array, kind: int
) -> tuple[float, float]:
    """Variance of one kind given those of the others, and -2 log likelihood with it.

    Every variance that is not zero has to earn what would be significant.
    """
    others = variances.copy()
    others[kind] = 0.0
    size = float(np.trace(shapes[kind]))
    factor = np.linalg.cholesky(_covariance(others, shapes))
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(inverse @ shapes[kind] @ inverse.T)
    square = (vectors.T @ (inverse @ white)) ** 2
    tried = np.append(0.0, _DECADES * len(white) / size) if size > 0.0 else np.zeros(1)
    growth = 1.0 + np.multiply.outer(tried, np.maximum(values, 0.0))
    costs = np.sum(np.log(growth) + square / growth, axis=1)
    costs += 2.0 * np.sum(np.log(np.diag(factor)))
    costs += _LIKELIHOOD_GAIN * (np.count_nonzero(others) + (tried > 0.0))
    costs += tried / _USUAL[kind] ** 2 + float(np.sum(others / _USUAL[: len(others)] ** 2))
    best = int(np.argmin(costs))
    return float(tried[best]), float(costs[best])


@dataclass(frozen=True)
class PresumedErrors:
    """Presumed lasting errors, and what they do to an estimate.

    Attributes:
        errors: (q,) those by which an estimate is corrected: taken off the residuals.
        spread: (q,) their standard deviations.
        covariance: (p, p) to add to that of the parameters.
    """

    errors: Array
    spread: Array
    covariance: Array

    def mapped(self, mapping: Array) -> PresumedErrors:
        """The same on other parameters, by their derivative (p, p) where it was found."""
        return replace(self, covariance=np.asarray(mapping @ self.covariance @ mapping.T))

    @classmethod
    def find(
        cls,
        inverse: Array,
        cross: Array,
        gram: Array,
        score: Array,
        load: float,
        prior: Array | None = None,
    ) -> PresumedErrors:
        """Find them in the sums that a fit leaves.

        Args:
            inverse: (p, p) inverse of the information of data and prior, J^T J + prior.
            cross: (p, q) J^T B of the white rows.
            gram: (q, q) B^T B.
            score: (q,) B^T r of the residuals after the fit.
            load: N, weight that the sensors carry.
            prior: (p, p) information of the prior, where sensors state shares of their load; no
                error of theirs leaves less known than that.
        """
        by_error = inverse @ cross
        beside = gram - cross.T @ by_error
        mixing, white = _shown(gram, beside, score)
        if prior is None:
            explanations = systematic_variances(mixing, white)
            parts = [weight * _second_moment(v, mixing, white) for weight, v in explanations]
            probable, moment = explanations[0][1], np.sum(parts, axis=0)
        else:
            probable = fingertip_variances(mixing, white, load)
            moment = np.diag(probable)
        granted = np.zeros(len(gram))
        granted[:_BODY_SIZE] = np.minimum(probable[:_BODY_SIZE], (_GRANTED * load) ** 2)
        corrected, posterior = _posterior(granted, mixing, white)
        spread = np.sqrt(np.diag(posterior))
        covariance = np.asarray(by_error @ moment @ by_error.T)
        return cls(corrected, spread, covariance if prior is None else _within(covariance, prior))

    @classmethod
    def of_rows(
        cls,
        inverse: Array,
        jacobian: Array,
        basis: Array,
        residual: Array,
        load: float,
        prior: Array | None = None,
    ) -> PresumedErrors:
        """`find` in white rows: J (n, p), B (n, q) and r (n,)."""
        cross = jacobian.T @ basis
        score = basis.T @ residual - cross.T @ (inverse @ (jacobian.T @ residual))
        return cls.find(inverse, cross, basis.T @ basis, score, load, prior)


def _within(covariance: Array, prior: Array) -> Array:
    """The covariance (p, p) without what exceeds that of a prior of information (p, p)."""
    root = np.linalg.cholesky(prior)
    values, vectors = np.linalg.eigh(root.T @ covariance @ root)
    axes = np.linalg.solve(root.T, vectors)
    return np.asarray((axes * np.minimum(values, 1.0)) @ axes.T)


def _shown(gram: Array, beside: Array, score: Array) -> tuple[Array, Array]:
    """What data show of unit errors beside the parameters: A (r, q) and white numbers (r,).

    The score has covariance A^T A. Directions and errors of which next to nothing is left, such as
    the gain of an only sensor, which is a heavier load, are not shown: there the rest is rounding,
    and what noise of the regressors leaves of it.

    Args:
        gram: (q, q) B^T B.
        beside: (q, q) without its projection on the parameters.
        score: (q,) scores of the errors, without their projection on the parameters.
    """
    length = np.sqrt(np.maximum(np.diag(gram), _TINY))
    values, vectors = np.linalg.eigh(beside / np.outer(length, length))
    seen = values > _LEAST_SHARE
    root, kept = np.sqrt(values[seen]), vectors[:, seen]
    mixing = root[:, None] * kept.T
    mixing[:, np.sum(mixing**2, axis=0) < _LEAST_SHARE] = 0.0
    return mixing * length, kept.T @ (score / length) / root


def _posterior(variances: Array, mixing: Array, white: Array) -> tuple[Array, Array]:
    """Mean (q,) and covariance (q, q) of errors of these variances, given the white numbers w.

    P = (D^-1 + A^T A)^-1 and P A^T w.
    """
    root = np.sqrt(variances)
    own = mixing * root
    spread = np.linalg.inv(np.eye(len(root)) + own.T @ own) * np.outer(root, root)
    return spread @ (mixing.T @ white), spread


def _second_moment(variances: Array, mixing: Array, white: Array) -> Array:
    """E[b b^T] (q, q) of the presumed errors b.

    Gains of sensors are what the data say of them. Constant errors stand in for much that is not
    modelled, so that their variance alone counts.
    """
    moment = np.diag(variances)
    mean, spread = _posterior(variances, mixing, white)
    gains = slice(SYSTEMATIC_SIZE, None)
    moment[gains, gains] = spread[gains, gains] + np.outer(mean[gains], mean[gains])
    return moment
