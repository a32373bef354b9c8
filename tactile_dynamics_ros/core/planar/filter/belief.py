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
