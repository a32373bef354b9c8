"""What hypotheses of parameters learn from a measurement: by their trend, or by their weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from tactile_dynamics_ros.core.planar.filter.belief import (
    kalman_step,
    root_of,
    unlearnt,
    weighted_moments,
    without,
)

Array = NDArray[np.float64]

_TRUST = 0.2
"""Power of the likelihood in the parameter step: errors of contact point, friction and arm last
for about five steps, which then tell as much as one. At 1 masses are off by up to twelve of their
std."""
_LEAST_COUNT = 0.5
"""Share of the hypotheses that must go on counting after a step. What a measurement says beyond is
left out: with a tenth of them their covariance would be of ten points."""
_PRINTED = 0.98
"""a of the kernels of Eq. 32 and 33, within what Liu and West advise; the paper's a = h = 0.01
contradicts its h^2 = 1 - a^2. Any a takes half of the standard deviation at each step at least."""
_VANISHED = 1e-5
"""Standard deviation that the printed step leaves, in the units of the parameters: nothing would be
left after forty steps, and the filter could not go on."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Hypotheses, what each expects, and what was measured.

    Attributes:
        own: (C, p) parameters, of equal weight. acting: (C, k) numbers by which they act; where
            they act one by one, `own` itself.
        told: (C, m) what they expect at their likeliest.
        value: (m,) measured. spread: (m, m) covariance of the rest, given the parameters.
        blind: columns of `acting` that this measurement must not tell.
        lasting: by how many times longer errors last than those of the mechanics, as `Prediction`.
    """

    own: Array
    acting: Array
    told: Array
    value: Array
    spread: Array
    blind: list[int]
    lasting: float = 1.0

    @property
    def trust(self) -> float:
        """Power of the likelihood."""
        return _TRUST / self.lasting


Learning = Callable[[Evidence], tuple[tuple[Array, Array], float]]
"""Mean (p,) and lower root (p, p) of the parameters after a measurement, and the share of the
measurement that was not left out."""


def learn_by_trend(given: Evidence) -> tuple[tuple[Array, Array], float]:
    """Take expectations to be linear in what acts; what is not linear counts as noise.

    So does what blind columns add to what follows from the others. What acts is in turn taken to
    be linear in the parameters: how a load is shared out that acts as a whole stays as it was.
    Weights of a few dozen hypotheses move also those parameters that a measurement does not tell,
    at random and without widening them: over 300 steps by several standard deviations.
    """
    count, mean, middle = len(given.own), given.own.mean(axis=0), given.told.mean(axis=0)
    away, deviation = (given.own - mean) / np.sqrt(count), (given.told - middle) / np.sqrt(count)
    seen = [k for k in range(given.acting.shape[1]) if k not in given.blind]
    acts = given.acting[:, seen] - given.acting[:, seen].mean(axis=0)
    linear = acts @ np.linalg.lstsq(acts, deviation, rcond=None)[0]
    slope = np.linalg.lstsq(away, linear, rcond=None)[0].T
    rest = deviation - away @ slope.T
    noise = (given.spread + rest.T @ rest) / given.trust
    root = root_of(away)
    gain, narrower = kalman_step(root, slope @ root, noise)
    return (mean + gain @ (given.value - middle), narrower), 1.0


def learn_by_weights(given: Evidence) -> tuple[tuple[Array, Array], float]:
    """Weigh hypotheses by the likelihood of what was measured; keep the spread of all that counts.

    Source: paper B, Eq. 30 to 33, in the form of Liu and West 2001.
    """
    lack = given.value - without(given.acting, given.told, given.blind)
    weights, kept = tempered_weights(given.trust * log_likelihood(lack, given.spread))
    marginal = weighted_moments(given.own, weights)
    if given.blind and given.acting is given.own:
        marginal = unlearnt(marginal, given.own, given.blind)
    return marginal, kept


def learn_as_printed(given: Evidence) -> tuple[tuple[Array, Array], float]:
    """Take the covariance from shrunken places, as Eq. 32 and 33 do, with the outer product."""
    (mean, root), kept = learn_by_weights(given)
    shrunken = _PRINTED * np.sqrt(1.0 - _PRINTED**2) * root
    rows = np.concatenate([shrunken.T, _VANISHED * np.eye(len(mean))])
    return (mean, root_of(rows)), kept


LEARNINGS: dict[str, Learning] = {
    "trend": learn_by_trend,
    "weights": learn_by_weights,
    "printed": learn_as_printed,
}
"""By their names in the configuration of the filter."""


def log_likelihood(lack: Array, covariance: Array) -> Array:
    """Logarithms (C,) of the likelihood of deviations (C, m)."""
    white = solve_triangular(np.linalg.cholesky(covariance), lack.T, lower=True)
    return np.asarray(-0.5 * np.sum(white**2, axis=0))


def tempered_weights(log_likelihood: Array) -> tuple[Array, float]:
    """Weights (C,) ~ likelihood^b with the largest b <= 1 for which enough hypotheses count.

    They count as 1 / sum w^2. With b below 1 a part of the measurement is left out, which is
    honest: no hypothesis is near enough to say what all of it means.
    """
    raised = log_likelihood - log_likelihood.max()

    def weights(power: float) -> Array:
        w = np.exp(power * raised)
        return np.asarray(w / w.sum())

    wanted = _LEAST_COUNT * len(raised)
    full = weights(1.0)
    if 1.0 / np.sum(full**2) >= wanted:
        return full, 1.0
    low, high = -12.0, 0.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if 1.0 / np.sum(weights(float(np.exp(middle))) ** 2) >= wanted:
            low = middle
        else:
            high = middle
    return weights(float(np.exp(low))), float(np.exp(low))
