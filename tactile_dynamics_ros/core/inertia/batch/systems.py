"""White residual and Jacobian of a body with effects, as functions of its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.inertia.batch.fitted_model import Stretch, whiten_stretches
from tactile_dynamics_ros.core.inertia.residuals.repeated_whitening import RepeatedWhitening
from tactile_dynamics_ros.core.numerics.least_squares import rotated

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


class FactoredSystem:
    """White residual r0 + J (phi - phi0) - U (c - c0), rotated to as many rows as columns.

    U are the white columns of effects of which the load changes nothing, c their coefficients.
    """

    def __init__(
        self,
        stretches: Sequence[Stretch],
        phi: Array,
        effects: Sequence[Effect],
        theta: Sequence[Array],
    ) -> None:
        self._samples, self._phi, self._effects = stretches[0].problem.samples, phi, effects
        self._start = self._numbers(theta)
        parts = [np.concatenate([s.jacobian, s.residual[:, None]], axis=1) for s in stretches]
        columns = [np.concatenate(parts)]
        for effect, value in zip(effects, theta, strict=True):
            found = [effect.factored(s.problem.samples, value) for s in stretches]
            columns.append(-whiten_stretches(stretches, [f[0] for f in found if f is not None]))
        self._rows = rotated(np.concatenate(columns, axis=1))

    def evaluate(self, phi: Array, theta: Sequence[Array]) -> tuple[Array, Array]:
        """Residual and Jacobian by [phi, theta]."""
        moved = self._numbers(theta) - self._start
        residual = self._rows @ np.concatenate([phi - self._phi, [1.0], moved])
        pairs = zip(self._effects, theta, strict=True)
        found = [effect.factored(self._samples, value) for effect, value in pairs]
        weights = block_diag(*(f[1] for f in found if f is not None))
        by_theta = self._rows[:, 11:] @ weights if self._effects else self._rows[:, 11:]
        return residual, np.concatenate([self._rows[:, :10], by_theta], axis=1)

    def _numbers(self, theta: Sequence[Array]) -> Array:
        pairs = zip(self._effects, theta, strict=True)
        numbers = [effect.coefficients(self._samples, value) for effect, value in pairs]
        return np.concatenate([np.zeros(0), *(part for part in numbers if part is not None)])


class FullSystem:
    """White residual r0 + J (phi - phi0) - L^-1 (Delta - Delta0), all rows of it."""

    def __init__(
        self,
        stretches: Sequence[Stretch],
        phi: Array,
        effects: Sequence[Effect],
        theta: Sequence[Array],
    ) -> None:
        self._stretches, self._phi, self._effects = stretches, phi, effects
        self._rows = [np.concatenate([s.jacobian, s.residual[:, None]], axis=1) for s in stretches]
        self._white_columns = RepeatedWhitening(lambda values: whiten_stretches(stretches, values))
        self._white_start = self._white_effects(phi, theta)
        plain = whiten_stretches(stretches, [s.problem.regressor for s in stretches])
        self._beside = plain - np.concatenate([s.jacobian for s in stretches])

    def evaluate(self, phi: Array, theta: Sequence[Array]) -> tuple[Array, Array]:
        """Residual and Jacobian by [phi, theta]."""
        rows = np.concatenate(self._rows)
        residual = rows[:, :10] @ (phi - self._phi) + rows[:, 10]
        moved = self._white_effects(phi, theta) - self._white_start
        columns = self._effect_columns(phi, theta)
        # rows already hold dDelta/dphi at the start; the exact change replaces that linear part
        correction = self._beside @ (phi - self._phi)
        residual = residual - moved + correction
        return residual, np.concatenate([rows[:, :10], columns], axis=1)

    def _white_effects(self, phi: Array, theta: Sequence[Array]) -> Array:
        present = PresentEffects(self._effects, theta)
        total = [present.wrench(stretch.problem.samples, phi) for stretch in self._stretches]
        return whiten_stretches(self._stretches, total)

    def _effect_columns(self, phi: Array, theta: Sequence[Array]) -> Array:
        present = PresentEffects(self._effects, theta)
        samples = [stretch.problem.samples for stretch in self._stretches]
        columns = []
        for effect, value in zip(self._effects, theta, strict=True):
            seen = [present.seen_by(effect, s, phi) for s in samples]
            columns.append(self._white_columns.jacobian(effect, present, seen, phi, value))
        return -np.concatenate(columns, axis=1)
