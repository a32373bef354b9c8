"""Least squares on a handful of parameters: Levenberg-Marquardt, and rows rotated to few."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Evaluate = Callable[[Array], tuple[Array, Array]]

_GROWTH, _SHRINK = 4.0, 0.1
"""By what damping grows after a step that failed (twice as much at each further one), and shrinks
at most after one that did as foreseen. Nielsen has 2 and 1/3; these go faster from one end to the
other. They change the path, not the optimum."""
_HESITANT = 1e-3
"""Damping from which a step that fails is shortened at once, relative to the diagonal. From the
least damping of 1e-12 growth alone would need many evaluations before a step changes. Larger
shortens steps that were nearly good too much, smaller spends evaluations first."""


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
