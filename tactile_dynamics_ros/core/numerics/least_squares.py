"""Least squares on a handful of parameters; regressors with independent noise.

A motion x read from noisy poses shares their noise with the residuals r around it; regressing r on
Y(x) would shrink the parameters (errors in variables). The part of x that is predictable from r,
Cov(x, r) C^-1 r = y^T nu with y = L^-1 Cov(r, x) and white nu = L^-1 r, is removed; what is left is
independent of every residual near by, as in the Gauss-Helmert solution of the batch estimator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np
from scipy.linalg import lapack

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.banded import BLOCK
from tactile_dynamics_ros.core.numerics.stream_whitening import sliding_rows

Evaluate = Callable[[Array], tuple[Array, Array]]

_GROWTH, _SHRINK = 4.0, 0.1
"""By what damping grows after a step that failed (twice as much at each further one), and shrinks
at most after one that did as foreseen. Nielsen has 2 and 1/3; these go faster from one end to the
other. They change the path, not the optimum."""
_HESITANT = 1e-3
"""Damping from which a step that fails is shortened at once, relative to the diagonal. From the
least damping of 1e-12 growth alone would need many evaluations before a step changes. Larger
shortens steps that were nearly good too much, smaller spends evaluations first."""


DECISIVE = 30.0
"""Expected chi^2 beyond which an explanation is refuted by a new recording: an error of 5.5 std in
one direction. It is far beyond chance because errors of real sensors last and count less than white
ones. Lower promises motions that such errors can spoil, higher finds a motion for fewer rivals."""


def refuted(names: Sequence[str], gaps: Array) -> list[str]:
    """Names of the explanations whose expected chi^2 (n,) is decisive."""
    return [name for name, gap in zip(names, gaps, strict=True) if gap >= DECISIVE]


def chi_square_beside(target: Array, columns: Array, prior: Array) -> float:
    """Square of a difference (n,) that columns (n, p) with a prior cannot adapt to.

    min_d |t - G d|^2 + d^T H d.

    Args:
        target: t, white.
        columns: G, white.
        prior: H (p, p), information on their coefficients.
    """
    information = columns.T @ columns + prior
    gradient = columns.T @ target
    scale = np.sqrt(np.diag(information))
    scaled = information / np.outer(scale, scale)
    solution = np.linalg.lstsq(scaled, gradient / scale, rcond=None)[0]
    return float(target @ target - gradient @ (solution / scale))


def levenberg_marquardt(
    evaluate: Evaluate, start: Array, iterations: int = 30, tolerance: float = 1e-7
) -> tuple[Array, bool]:
    """Minimise |r(x)|^2 with a damping that is scaled by the diagonal of J^T J.

    Args:
        evaluate: x -> (r, J = dr/dx).
        start: initial x.
        iterations: evaluations at most.
        tolerance: relative fall of the cost below which it has converged.

    Returns:
        The best x and whether it converged.

    Source: Marquardt 1963; damping by the ratio of fall and foreseen fall, Nielsen 1999.
    """
    x, damping, growth = np.array(start, dtype=float), 1e-6, _GROWTH
    residual, jacobian = evaluate(x)
    cost = float(residual @ residual)
    for _ in range(iterations):
        hessian, gradient = jacobian.T @ jacobian, jacobian.T @ residual
        scale = np.maximum(np.diag(hessian), 1e-12)
        step = -np.linalg.solve(hessian + damping * np.diag(scale), gradient)
        with np.errstate(all="ignore"):  # what a step too far makes is no number, and refused
            trial, trial_jacobian = evaluate(x + step)
            trial_cost = float(trial @ trial)
        predicted = float(-step @ gradient)
        if np.isfinite(trial_cost) and trial_cost <= cost:
            fall, x = cost - trial_cost, x + step
            foreseen = predicted + damping * float(step @ (scale * step))
            residual, jacobian, cost = trial, trial_jacobian, trial_cost
            trust = 1.0 - (2.0 * fall / max(foreseen, 1e-300) - 1.0) ** 3
            damping, growth = max(damping * max(trust, _SHRINK), 1e-12), _GROWTH
            if fall <= tolerance * max(cost, 1e-12):
                return x, True
        else:
            if predicted <= tolerance * max(cost, 1e-12):
                return x, True
            damping, growth = max(damping, _HESITANT) * growth, 2.0 * growth
    return x, False


def rotated(rows: Array) -> Array:
    """Square root R (n, n) of A^T A for rows A (M, n): all products R x are as long as A x."""
    gram = rows.T @ rows
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale)


Record = TypeVar("Record")


class Decorrelator(Generic[Record]):
    """Last rows of residual noise, Cholesky factor and white residual around a delayed centre."""

    def __init__(self, short: int, long: int) -> None:
        """Start without memory.

        Args:
            short: half width in samples of the residual's pose windows.
            long: half width in samples of the windows that x is read from.
        """
        self.lag = short + long
        self._rows = 2 * self.lag + 1
        self._width = (2 * short + 1) * BLOCK
        self._padding = 2 * short
        self._noise = np.zeros((self._rows, BLOCK, self._width))
        self._white = np.zeros((self._rows, BLOCK, 2))
        self._band = np.zeros((self._width, self._rows * BLOCK), order="F")
        self._band[0] = 1.0
        self._records: list[Record | None] = [None] * self._rows
        row, column = np.mgrid[:BLOCK, : self._width]
        offset = self._width - BLOCK + row - column
        self._kept = offset >= 0
        self._offset = offset[self._kept]
        self._column = self._band.shape[1] - self._width + column[self._kept]

    @property
    def centre(self) -> Record | None:
        """What was stored with the centre row; None for a row without residual."""
        return self._records[self.lag]

    def push(self, noise: Array, factor_row: Array, white: Array, record: Record | None) -> None:
        """Add the newest row.

        Args:
            noise: (6, width) response to the poses of its window.
            factor_row: (6, width) block row of L, diagonal block last.
            white: (6, 2) white residual, and that of a draw of the noise alone.
            record: handed back by `centre` when the row is the centre.
        """
        self._noise[:-1], self._white[:-1] = self._noise[1:].copy(), self._white[1:].copy()
        self._noise[-1], self._white[-1] = noise, white
        self._band[:, :-BLOCK] = self._band[:, BLOCK:].copy()
        self._band[:, -BLOCK:] = 0.0
        self._band[self._offset, self._column] = factor_row[self._kept]
        self._records = [*self._records[1:], record]

    def skip(self) -> None:
        """Add a row without residual."""
        row = np.zeros((BLOCK, self._width))
        row[:, -BLOCK:] = np.eye(BLOCK)
        self.push(np.zeros_like(row), row, np.zeros((BLOCK, 2)), None)

    def correction(self, response: Array) -> Array:
        """Corrections of m readings x at the centre, -Cov(x, r) C^-1 r, for r and for the draw.

        Args:
            response: (2 long + 1, 6, m) response of x to one deviation of each pose around the
                centre.

        Returns:
            (2, m).
        """
        readings = response.shape[2]
        padded = np.zeros((len(response) + 2 * self._padding, BLOCK, readings))
        padded[self._padding : self._padding + len(response)] = response
        size = self._width // BLOCK
        flat = sliding_rows(padded, size).reshape(self._rows, self._width, readings)
        covariance = (self._noise @ flat).reshape(-1, readings)
        solved, _ = lapack.dtbtrs(self._band, covariance, uplo="L")
        return np.asarray(-(self._white.reshape(-1, 2).T @ solved))
