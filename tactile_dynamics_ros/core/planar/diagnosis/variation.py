"""How much friction differs from place to place, judged beside all that effects could do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

VARIATIONS = (0.003, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.14)
"""Relative variations of friction from place to place that are compared: real tables have 0.08 to
0.13, and a table that varies by more is not told from what acts there. A finer grid changes
variances of residuals by less than a tenth."""


def log_evidence(residual: Array, columns: Array) -> float:
    """Log probability (up to a constant) of a white residual in which columns may have a share.

    r ~ N(0, I + C C^T): what effects of plausible size could do is no evidence for a variation of
    friction, or that would always hide them.

    Args:
        residual: (M,) white.
        columns: (M, c) what each parameter of plausible size makes of it.

    Source: Patterson, Thompson 1971 (restricted likelihood), with proper priors.
    """
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    share = columns.T @ residual
    explained = float(share @ np.linalg.solve(inner, share))
    return -0.5 * (float(residual @ residual) - explained + float(np.linalg.slogdet(inner)[1]))
