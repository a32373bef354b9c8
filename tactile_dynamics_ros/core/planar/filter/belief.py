"""Belief about parameters and motion, and what hypotheses learn from a measurement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from tactile_dynamics_ros.core.array import Array


@dataclass(frozen=True, eq=False)
class Belief:
    """Normal distribution of parameters phi (p,), then of what moves, psi (n,).

    Attributes:
        mean: (p + n,). root: (p + n, p + n) lower triangular, covariance = root root^T.
        parameters: p.
    """

    mean: Array
    root: Array
    parameters: int

    @property
    def covariance(self) -> Array:
        """(p + n, p + n)."""
        return np.asarray(self.root @ self.root.T)

    @property
    def std(self) -> Array:
        """(p + n,) standard deviations."""
        return np.asarray(np.linalg.norm(self.root, axis=1))

    def points(self, unit: Array) -> Array:
        """Points (C, p + n) from unit ones (C, p + n) of zero mean and identity covariance."""
        return np.asarray(self.mean + unit @ self.root.T)


def joined(marginal: tuple[Array, Array], slope: Array, conditional: tuple[Array, Array]) -> Belief:
    """Belief from that of the parameters and that of the motion where they are at their mean.

    N(psi | m + B (phi - mu), R R^T) N(phi | mu, V V^T) has the root [[V, 0], [B V, R]]: positive
    definite whatever the updates did, unlike a joint whose cross-covariance is kept.

    Args:
        marginal: mu (p,) and V (p, p), lower triangular.
        slope: B (n, p).
        conditional: m (n,) and R (n, n), lower triangular.

    Source: paper B, Eq. 36, with the joint rebuilt from conditional and marginal.
    """
    p, n = len(marginal[0]), len(conditional[0])
    root = np.zeros((p + n, p + n))
    root[:p, :p], root[p:, :p], root[p:, p:] = marginal[1], slope @ marginal[1], conditional[1]
    return Belief(np.concatenate([marginal[0], conditional[0]]), root, p)


def root_of(rows: Array) -> Array:
    """Lower triangular root (d, d) of rows^T rows, from rows (k, d) with k >= d."""
    lower = np.asarray(np.linalg.qr(rows, mode="r")).T
    return np.asarray(lower * np.where(np.diag(lower) < 0.0, -1.0, 1.0))


def slope_of(root: Array, by: Array) -> Array:
    """Regression slope (a, b) from a root's block (a, b), on variables with root `by` (b, b)."""
    return np.asarray(solve_triangular(by, root.T, lower=True, trans="T").T)


def unit_points(count: int, size: int, rng: np.random.Generator) -> Array:
    """Random points (count, size) whose mean is exactly zero and covariance exactly one.

    Independent draws would move the mean by a tenth of its std at every step with 100 of them; a
    thousand steps later nothing would be left of it. Pairs of opposite points have no skewness.

    Args:
        count: even, more than twice the size.
        size: numbers of each.
        rng: where they come from.
    """
    half = rng.standard_normal((count // 2, size))
    both = np.concatenate([half, -half])
    return np.asarray(np.linalg.qr(both)[0] * np.sqrt(len(both)))


def weighted_moments(points: Array, weights: Array) -> tuple[Array, Array]:
    """Mean (p,) and lower root (p, p) of the covariance of weighted points (C, p).

    They are those of the kernel mixture at a x_i + (1 - a) mean with covariance (1 - a^2) V, for
    any a: a^2 V + (1 - a^2) V = V. Paper B's Eq. 32 and 33 lack the outer product, and take the
    shrunken places for V, which lets the belief collapse.

    Source: Liu and West 2001, section 10.3.
    """
    mean = weights @ points
    return mean, root_of(np.sqrt(weights)[:, None] * (points - mean))


def without(own: Array, told: Array, columns: list[int]) -> Array:
    """What is expected (C, m), less what follows from some columns of the parameters (C, p)."""
    if not columns:
        return told
    away = own - own.mean(axis=0)
    slope = np.linalg.lstsq(away, told - told.mean(axis=0), rcond=None)[0]
    return np.asarray(told - away[:, columns] @ slope[columns])


def unlearnt(
    marginal: tuple[Array, Array], before: Array, columns: list[int]
) -> tuple[Array, Array]:
    """Belief in which some parameters are known by the others only, as they were before.

    N(r | mu', V'_rr) of the rest r after a step, with N(m | r) of the columns m before it:
    K = V_mr V_rr^-1 gives V'_mr = K V'_rr, V'_mm = V_mm - K V_rm + K V'_rr K^T.

    Args:
        marginal: mean (p,) and lower root (p, p) after the step.
        before: points (C, p) of equal weight before it.
        columns: of m.
    """
    size = before.shape[1]
    rest = [k for k in range(size) if k not in columns]
    mean, after = before.mean(axis=0), (marginal[1] @ marginal[1].T)[np.ix_(rest, rest)]
    old = np.cov(before.T, bias=True)
    gain = np.linalg.solve(old[np.ix_(rest, rest)], old[np.ix_(rest, columns)]).T
    spread = np.zeros((size, size))
    spread[np.ix_(rest, rest)] = after
    spread[np.ix_(columns, rest)] = gain @ after
    spread[np.ix_(rest, columns)] = after @ gain.T
    free = old[np.ix_(columns, columns)] - gain @ old[np.ix_(rest, columns)]
    spread[np.ix_(columns, columns)] = free + gain @ after @ gain.T
    middle = marginal[0].copy()
    middle[columns] = mean[columns] + gain @ (middle[rest] - mean[rest])
    return middle, np.asarray(np.linalg.cholesky(spread), dtype=float)


def kalman_step(inner: Array, seen: Array, noise: Array) -> tuple[Array, Array]:
    """Gain (n, m) and posterior root (n, n) of a motion given the parameters.

    [[N, H], [0, R]] Q = [[S, 0], [K S, R']]: triangular, so that nothing is ever subtracted.

    Args:
        inner: (n, n) root R.
        seen: (m, n) root H = dz/dpsi R of what is expected.
        noise: (m, m) covariance N N^T.
    """
    m, n = seen.shape
    rows = np.zeros((m + n, m + n))
    rows[:m, :m], rows[:m, m:], rows[m:, m:] = np.linalg.cholesky(noise), seen, inner
    lower = root_of(rows.T)
    return slope_of(lower[m:, :m], lower[:m, :m]), lower[m:, m:]


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
