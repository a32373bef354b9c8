"""Maximum a posteriori fit of the numbers that slow pushes have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.sparse.prediction import NAMES, Prediction
from tactile_dynamics_ros.core.planar.sparse.pushes import Pushes, cut_pushes
from tactile_dynamics_ros.core.planar.streams import PushedStreams

_SCATTER = np.array([0.1, np.radians(5.0), 1e-3, np.radians(1.0)])
"""Scatter of the residuals expected beforehand: friction of real tables varies by 8 to 13 % from
place to place, which turns force and object by some degrees and makes the tip slip a millimetre."""
_SCATTER_FREEDOM = 4.0
"""Residuals' worth of that expectation. With none, the scatter of few pushes may come out near zero
and the interval with it; with many, real scatter is not believed."""
_TAIL_FREEDOM = 4.0
"""Degrees of freedom of Student's t of one residual: a push of which the mechanics are wrong (on a
foot's edge, past a corner) has a weight below 1/4 from 3.7 std on. Infinite: least squares."""
_PRIOR_FRICTION, _PRIOR_LN_FRICTION_STD = 0.35, 0.7
"""Friction coefficient of a support that is not known, and its relative std: it says how far the
pressure moves under a push above the support, and the mass that is reported as undetermined."""
_PRIOR_TIP_FRICTION, _PRIOR_LN_TIP_FRICTION_STD = 0.4, 0.6
"""Friction coefficient between tip and object and its relative std."""
SIZE_STD = 0.15
"""Relative std of the size of the part of an even face that carries; known feet have 0.02."""
_PRIOR_LN_PRODUCT_STD = 3.0
"""Relative std of the product before any force is known: it excludes nothing."""
_STARTS = ((0.0, 0.0, 0.6), (0.4, 0.4, 0.35), (-0.4, -0.4, 0.35))
"""Centre of mass, in prior std (both axes), and tip friction at which fits begin: slip and stick
make valleys. With the first alone a fit in ten ends in a worse one."""
_ITERATIONS = 20
"""Steps at most; five to ten suffice from these starts."""
_SHORTER, _SHORTEST = 0.4, 0.05
"""Factor of the step where the cost rose, and share of a step below which it has ended: the cost
has kinks where tips begin to slip, so that the last falls take short steps or do not come."""
_SCATTER_ROUNDS = 6
"""Fixed-point rounds for the scatter; the last changes it by less than a percent."""
_IMMATERIAL = 0.05
"""Change of the cost (twice the log posterior) below which the iteration has converged: a step of a
fifth of a std."""
_SAME = 0.5
"""Distance of two optima, in std, up to which they are the same."""
_PATCH = 0.02
"""Distance within which friction is alike, m. At 5 mm the centre of an even face of 150 mm would be
known to a millimetre, which real faces refute; beyond 50 mm std of centres grow no more."""
_FRAME = 1e-3
"""Errors of calibration between tracked frame, feet and tip, m, common to all pushes; they are the
floor of the centre's std."""
_UNKNOWN_PRODUCT = 0.2
"""Relative std from which the friction force is not known, as for every mass of this product."""
_NORMAL_95 = 1.645
"""Quantile of the normal distribution to which intervals refer."""
_UNDETERMINED = 0.7
"""Std over that of the prior from which a number is not determined by the pushes."""


@dataclass(frozen=True, eq=False)
class SparseFit:
    """Numbers common to all pushes, and how well they are known.

    Attributes:
        values: (6,) by `NAMES`. covariance: (6, 6).
        residuals: (K, 4) by `RESIDUALS`, NaN where no force was measured.
        scatter: (4,) std of the residuals among pushes.
        residual_rms: residuals over the scatter that real tables are expected to have.
        converged: whether two starts at least ended by themselves at the best optimum.
        settled: whether one did; the covariance counts where the others ended.
        undetermined: what these pushes do not tell, names of the estimate's JSON.
        pushes: the pieces of the recording.
    """

    values: Array
    covariance: Array
    residuals: Array
    scatter: Array
    residual_rms: float
    converged: bool
    settled: bool
    undetermined: tuple[str, ...]
    pushes: Pushes

    @property
    def std(self) -> Array:
        """(6,) by `NAMES`."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def friction_force(self) -> tuple[float, float]:
        """Product m mu g, N, and its std."""
        product = float(np.exp(self.values[0]))
        return product, product * float(self.std[0])

    @property
    def friction(self) -> tuple[float, float]:
        """Coefficient of the support and its std; the prior's mass unless one was given."""
        ratio = float(np.exp(self.values[0] - self.values[5])) / GRAVITY
        difference = np.zeros(len(NAMES))
        difference[[0, 5]] = 1.0, -1.0
        return ratio, ratio * float(np.sqrt(difference @ self.covariance @ difference))


@dataclass(frozen=True, eq=False)
class _Optimum:
    common: Array
    cost: float
    settled: bool
    residual: Array
    slope: Array
    scatter: Array


def fit_sparse(
    streams: PushedStreams,
    mass: tuple[float, float] | None = None,
    feet: Array | None = None,
) -> SparseFit:
    """Friction force and centre of mass of the first link from its poses before and after pushes.

    The quasi-static mechanics are integrated along the pusher's path from each known pose to the
    next; nothing is differentiated, and no inertia is known.

    Args:
        streams: slow pushes; poses may be as sparse as one before and one after each.
        mass: kg and std, if known from elsewhere.
        feet: (F, 2) m, link frame, the points on which the object stands; else its whole footprint.

    Raises:
        NotIdentifiableError: the pusher never touches the object.
    """
    return fit_pushes(cut_pushes(streams), streams.links[0].footprint, mass, feet)


def fit_pushes(
    pushes: Pushes,
    outline: Array,
    mass: tuple[float, float] | None = None,
    feet: Array | None = None,
) -> SparseFit:
    """Fit as `fit_sparse` does, to pieces that are cut already."""
    patch = SupportPatch(outline) if feet is None else SupportPatch(feet, corners_only=True)
    model = Prediction(pushes, patch, outline)
    prior = _prior(pushes, patch, mass, feet is not None)
    found = [_optimum(model, prior, start) for start in _STARTS]
    best = min(found, key=lambda one: one.cost)
    covariance = _covariance(best, prior[1]) + _common_variation(model, best) + _apart(found)
    std = np.sqrt(np.diag(covariance))
    same = [one.settled and np.max(np.abs(one.common - best.common) / std) < _SAME for one in found]
    return SparseFit(
        values=best.common,
        covariance=covariance,
        residuals=best.residual,
        scatter=best.scatter,
        residual_rms=float(np.sqrt(np.nanmean(np.square(best.residual / _SCATTER)))),
        converged=bool(best.settled and sum(same) >= 2),
        settled=best.settled,
        undetermined=_undetermined(std, prior[1], mass is not None),
        pushes=pushes,
    )


def _prior(
    pushes: Pushes, patch: SupportPatch, mass: tuple[float, float] | None, stands_on_feet: bool
) -> tuple[Array, Array]:
    """Mean and std (6,) of the common numbers before the fit."""
    force = np.linalg.norm(pushes.force, axis=1)
    measured = force[np.isfinite(force)]
    product = float(np.median(measured)) if len(measured) else 1.0
    guess = product / (_PRIOR_FRICTION * GRAVITY), _PRIOR_LN_FRICTION_STD
    kilograms, relative = guess if mass is None else (mass[0], mass[1] / mass[0])
    size = np.sqrt(patch.share @ np.square(patch.offset))
    mean = [np.log(product), *patch.centroid, 0.0, np.log(_PRIOR_TIP_FRICTION), np.log(kilograms)]
    scale = 0.02 if stands_on_feet else SIZE_STD
    std = [_PRIOR_LN_PRODUCT_STD, *size, scale, _PRIOR_LN_TIP_FRICTION_STD, relative]
    return np.array(mean), np.array(std)


def _optimum(
    model: Prediction, prior: tuple[Array, Array], start: tuple[float, float, float]
) -> _Optimum:
    """Iterate reweighted Gauss-Newton steps from one start, halved where the cost rises."""
    mean, std = prior
    common = mean.copy()
    common[1:3] += np.array(start[:2]) * std[1:3]
    common[4] = np.log(start[2])
    best = _at(model, prior, common)
    settled, share = False, 1.0
    for _ in range(_ITERATIONS):
        weight = _weights(best.residual, best.scatter)
        matrix, gradient = _normal(best, weight)
        matrix = matrix + np.diag(1.0 / np.square(std))
        step = -np.linalg.solve(matrix, gradient + (best.common - mean) / np.square(std))
        size = float(np.max(np.abs(step) * np.sqrt(np.diag(matrix))))
        trial = _at(model, prior, best.common + share * step / max(1.0, size / 8.0))
        fall = best.cost - trial.cost
        if fall > 0.0:
            best, share = trial, min(1.0, 2.0 * share)
        else:
            share *= _SHORTER
        settled = abs(fall) < _IMMATERIAL or share < _SHORTEST
        if settled:
            break
    return _Optimum(best.common, best.cost, settled, best.residual, best.slope, best.scatter)


def _at(model: Prediction, prior: tuple[Array, Array], common: Array) -> _Optimum:
    """Residuals, their scatter, and twice the negative log posterior at common numbers."""
    residual, slope = model.linearised(common)
    scatter = _scatter_of(residual)
    square = np.square(residual / scatter)
    freedom = _TAIL_FREEDOM
    misfit = np.nansum((freedom + 1.0) * np.log1p(square / freedom))
    count = np.isfinite(residual).sum(axis=0) + _SCATTER_FREEDOM
    spread = 2.0 * count @ np.log(scatter) + _SCATTER_FREEDOM * np.sum(
        np.square(_SCATTER / scatter)
    )
    away = (common - prior[0]) / prior[1]
    cost = float(misfit + spread + away @ away)
    return _Optimum(common, cost, False, residual, slope, scatter)


def _scatter_of(residual: Array) -> Array:
    """Scale (4,) of Student's t, at the maximum of its posterior."""
    scatter: Array = _SCATTER.copy()
    count = np.isfinite(residual).sum(axis=0) + _SCATTER_FREEDOM
    for _ in range(_SCATTER_ROUNDS):
        share = (_TAIL_FREEDOM + 1.0) / (_TAIL_FREEDOM + np.square(residual / scatter))
        total = np.nansum(share * np.square(residual), axis=0)
        scatter = np.asarray(np.sqrt((total + _SCATTER_FREEDOM * np.square(_SCATTER)) / count))
    return scatter


def _weights(residual: Array, scatter: Array) -> Array:
    """Weights (K, 4) of the squares, zero where nothing was measured."""
    square = np.square(np.nan_to_num(residual) / scatter)
    share = (_TAIL_FREEDOM + 1.0) / (_TAIL_FREEDOM + square)
    return np.where(np.isfinite(residual), share, 0.0) / np.square(scatter)


def _normal(at: _Optimum, weight: Array) -> tuple[Array, Array]:
    """Information (6, 6) and gradient (6,) of the residuals at these weights."""
    slope = np.where(np.isfinite(at.residual)[:, :, None], at.slope, 0.0)
    matrix = np.einsum("kri,kr,krj->ij", slope, weight, slope)
    gradient = np.einsum("kri,kr->i", slope, weight * np.nan_to_num(at.residual))
    return matrix, gradient


def _covariance(at: _Optimum, prior_std: Array) -> Array:
    """Inverse information, widened to the scatter of the pushes' gradients where that is more.

    Pushes are blocks: what a push lacks is common to its force and its end. Quantiles are those of
    Student's t with as many degrees of freedom as pushes.

    Source: Huber 1967; Liang and Zeger 1986.
    """
    count = len(at.residual)
    expected = (_TAIL_FREEDOM + 1.0) / (_TAIL_FREEDOM + 3.0) / np.square(at.scatter)
    matrix, _ = _normal(at, np.broadcast_to(expected, at.residual.shape))
    known = np.diag(1.0 / np.square(prior_std))
    covariance = np.linalg.inv(matrix + known)
    weight = _weights(at.residual, at.scatter)
    slope = np.where(np.isfinite(at.residual)[:, :, None], at.slope, 0.0)
    each = np.einsum("kri,kr->ki", slope, weight * np.nan_to_num(at.residual))
    taken = float(np.trace(covariance @ matrix))
    meat = each.T @ each * count / max(1.0, count - 0.5 * taken) + known
    sandwich = covariance @ meat @ covariance
    ratio = np.sqrt(np.diag(sandwich) / np.diag(covariance))
    wider = np.maximum(1.0, ratio) * student.ppf(0.95, count + _SCATTER_FREEDOM) / _NORMAL_95
    return np.asarray(covariance * np.outer(wider, wider))


def _apart(found: list[_Optimum]) -> Array:
    """Covariance (6, 6) of where the starts ended, each as likely as its posterior is there.

    A fit whose starts end apart stands in a valley with kinks, of which one optimum tells little.
    """
    weight = np.exp(-0.5 * np.array([one.cost for one in found]) + 0.5 * min(o.cost for o in found))
    weight /= weight.sum()
    place = np.array([one.common for one in found])
    away = place - weight @ place
    return np.asarray((weight[:, None] * away).T @ away)


def _common_variation(model: Prediction, at: _Optimum) -> Array:
    """Covariance (6, 6) by friction that differs within the footprint, alike in all pushes.

    What varies from push to push with a std s of the work is friction of places that are
    independent beyond a patch; feet and neighbouring tracks are the same in all pushes, and shift
    product and centre of friction: d ln q = sum p_i e_i, d c = sum p_i (x_i - c) e_i.
    """
    common = at.common
    place = model.patch.centroid + np.exp(common[3]) * model.patch.offset
    apart = np.linalg.norm(place[:, None] - place[None], axis=2)
    alike = np.exp(-0.5 * np.square(apart / _PATCH))
    share = model.load(common[None])[0]
    rows = share[:, None] * np.column_stack([np.ones(len(place)), place - common[1:3]])
    moved = rows.T @ alike @ rows
    found = np.zeros((len(NAMES), len(NAMES)))
    found[:3, :3] = moved * at.scatter[0] ** 2 / moved[0, 0]
    found[[1, 2], [1, 2]] += _FRAME**2
    return found


def _undetermined(std: Array, prior_std: Array, mass_known: bool) -> tuple[str, ...]:
    """Names of what the pushes leave as it was."""
    ratio = std / prior_std
    found = [] if mass_known else ["mass", "friction"]
    found += ["friction_force_n"] * bool(std[0] > _UNKNOWN_PRODUCT)
    found += ["com"] * bool(np.any(ratio[1:3] > _UNDETERMINED))
    return tuple(found)
