"""Gaussian belief about parameters and motion, kept as a triangular root of its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

Array = NDArray[np.float64]


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
