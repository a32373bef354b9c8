"""Likelihood of what is measured, as a sign of a changed table (Dutta et al., Eq. 37)."""

from __future__ import annotations

from typing import Any

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.dual import DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import Observation


class RawLikelihood:
    """Logarithm of exp(-1/2 (Z - z)' R^-1 (Z - z)) of each force, R of the sensor alone.

    Args:
        filter: whose predictions Z are looked at before it learns from z.

    Attributes:
        logs: of the forces so far.

    Source: Dutta et al., Eq. 37 (tactile part, which is the one that told there).
    """

    def __init__(self, filter: DualFilter) -> None:
        self.logs: list[float] = []
        inner = filter._believed_noise

        def noted(seen: Observation, ahead: Any) -> Array:
            if seen.wrench is not None:
                told = ahead.told[:, -len(seen.wrench.value) :].mean(axis=0)
                away = (seen.wrench.value - told) / seen.wrench.std
                self.logs.append(float(-0.5 * away @ away))
            return inner(seen, ahead)

        filter._believed_noise = noted  # type: ignore[method-assign]
