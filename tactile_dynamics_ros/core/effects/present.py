"""Effects side by side: sensors that are late show external wrenches as late as the load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect


@dataclass(frozen=True)
class PresentEffects:
    """Effects of one model with their parameters.

    With external wrenches Delta_e and late sensors of response T (a lag, an offset of clocks), the
    forces show T [Y phi - Delta_e] instead of Y phi - Delta_e, so that
    Delta = Delta_e + (1 - T) [Y phi - Delta_e] = T Delta_e + (1 - T) Y phi. The first form gives
    the derivative by the parameters of T, the second that by those of Delta_e.

    Attributes:
        effects: of the model.
        theta: parameters of each.
    """

    effects: Sequence[Effect] = ()
    theta: Sequence[Array] = ()

    def wrench(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Sum of all Delta, (N, 6)."""
        total = np.zeros((len(samples.time), 6))
        for effect, theta in zip(self.effects, self.theta, strict=True):
            total += effect.wrench(self.seen_by(effect, samples, inertia), inertia, theta)
        return total

    def jacobians(self, samples: WrenchSamples, inertia: Array) -> list[Array]:
        """Derivative (N, 6, k) of the sum by the parameters of each effect."""
        return [
            self.as_shown(effect, samples, effect.jacobian(seen, inertia, theta))
            for effect, theta, seen in self._views(samples, inertia)
        ]

    def inertia_jacobians(self, samples: WrenchSamples, inertia: Array) -> list[Array]:
        """Derivative (N, 6, 10) of each effect's part of the sum by the dynamic parameters."""
        return [
            self.as_shown(effect, samples, effect.inertia_jacobian(seen, inertia, theta))
            for effect, theta, seen in self._views(samples, inertia)
        ]

    def moved_load(self, inertia: Array) -> Array:
        """Dynamic parameters (10,) of all that is accelerated: the load and what effects add."""
        pairs = zip(self.effects, self.theta, strict=True)
        return sum((effect.moved_load(inertia, theta) for effect, theta in pairs), start=inertia)

    def seen_by(self, effect: Effect, samples: WrenchSamples, inertia: Array) -> WrenchSamples:
        """The samples as an effect needs them, which may be none of the present ones."""
        if not effect.delays:
            return samples
        external = [
            other.wrench(samples, inertia, theta)
            for other, theta in zip(self.effects, self.theta, strict=True)
            if other.external
        ]
        return samples.with_external(np.sum(external, axis=0)) if external else samples

    def influence_on(self, effect: Effect) -> tuple[object, ...]:
        """What of the present effects changes how another is seen or shown; empty for nothing."""
        return tuple(
            (other.label, theta.tobytes())
            for other, theta in zip(self.effects, self.theta, strict=True)
            if (effect.delays and other.external) or (effect.external and other.delays)
        )

    def as_shown(self, effect: Effect, samples: WrenchSamples, columns: Array) -> Array:
        """Columns (N, 6, ...) of an effect as late as the present sensors show them."""
        if not effect.external or not columns.any():
            return columns
        shown = columns
        for sensor, theta in zip(self.effects, self.theta, strict=True):
            if sensor.delays:
                shown = shown + sensor.delayed(samples, theta, columns) - columns
        return shown

    def _views(
        self, samples: WrenchSamples, inertia: Array
    ) -> list[tuple[Effect, Array, WrenchSamples]]:
        return [
            (effect, theta, self.seen_by(effect, samples, inertia))
            for effect, theta in zip(self.effects, self.theta, strict=True)
        ]
