"""What contract tests have in common: their report, and derivatives to hold others against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array


@dataclass(frozen=True)
class CheckReport:
    """Outcome of a contract test: one line per failed requirement.

    Attributes:
        subject: what was tested.
        failures: a line each.
    """

    subject: str
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether every requirement holds."""
        return not self.failures

    def __str__(self) -> str:
        """One line per failure."""
        lines = self.failures or ("all requirements hold",)
        return "\n".join(f"{self.subject}: {line}" for line in lines)


def central_differences(function: Callable[[Array], Array], point: Array, steps: Array) -> Array:
    """Derivative (..., p) of a function at a point (p,), with a step for each parameter."""
    columns = []
    for k, step in enumerate(steps):
        ahead, behind = point.copy(), point.copy()
        ahead[k] += step
        behind[k] -= step
        columns.append((function(ahead) - function(behind)) / (2.0 * step))
    return np.stack(columns, axis=-1)
