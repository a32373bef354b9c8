"""Effects of a held object that act only in a regime, and the scalars that say where it holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples, once_per_samples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.parameter import EffectParameter, ParameterSum
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.numerics.regime import Regime, gated

_LEAST_FORCE = 1e-9
"""Grip force by which shares are divided at least, N: shares are zero where nothing is touched.
It is far below what any sensor reads, so that it acts nowhere else."""


@dataclass(frozen=True)
class SampleScalar:
    """One scalar at N instants.

    Attributes:
        name: in words.
        unit: SI, degrees for angles.
        values: (N,).
    """

    name: str
    unit: str
    values: Array


@once_per_samples
def sample_scalars(samples: WrenchSamples) -> dict[str, SampleScalar]:
    """Scalars of samples by symbol.

    `t`, `x y z` (place), `speed`, `turn` (rate of turn), `acceleration`, `up_x up_y up_z` (body
    axes against the vertical), `grip`, and per contact `load_<contact>` and `share_<contact>`.
    """
    size = np.linalg.norm
    force = size(samples.contact_force, axis=2)
    grip = force.sum(axis=1)
    found = {"t": SampleScalar("time", "s", samples.time)}
    for k, axis in enumerate("xyz"):
        found[axis] = SampleScalar(axis, "m", samples.position[:, k])
    found["speed"] = SampleScalar("speed", "m/s", size(samples.velocity, axis=1))
    found["turn"] = SampleScalar("rate of turn", "rad/s", size(samples.angular_velocity, axis=1))
    acceleration = size(samples.acceleration, axis=1)
    found["acceleration"] = SampleScalar("acceleration", "m/s^2", acceleration)
    for k, axis in enumerate("xyz"):
        angle = np.degrees(np.arccos(np.clip(samples.rotation[:, 2, k], -1.0, 1.0)))
        found[f"up_{axis}"] = SampleScalar(
            f"angle of body axis {axis} to the vertical", "deg", angle
        )
    several = force.shape[1] > 1
    if several:
        found["grip"] = SampleScalar("grip force", "N", grip)
    for k, name in enumerate(samples.contact_names):
        found[f"load_{name}"] = SampleScalar(f"force of {name}", "N", force[:, k])
        if several:
            share = force[:, k] / np.maximum(grip, _LEAST_FORCE)
            found[f"share_{name}"] = SampleScalar(f"share of {name} in the grip", "", share)
    return found


def values_of(samples: WrenchSamples, symbol: str) -> Array:
    """Values (N,) of one scalar.

    Raises:
        BadInputError: the samples have no scalar of that symbol.
    """
    known = sample_scalars(samples)
    if symbol not in known:
        raise BadInputError(f"regime: '{symbol}' is unknown; there are {', '.join(known)}")
    return known[symbol].values


_COPIED = (
    *("family", "formula", "looks_like", "remedy", "sentence"),
    *("rings", "lasting", "external", "event"),
)
"""What an effect in a regime says of itself as the effect does that acts everywhere. What is left
out has the value of `Effect`."""


class GatedEffect(Effect):
    """Delta(theta) of another effect where its regime holds, zero elsewhere; see `gate_effect`.

    Attributes:
        inner: the effect.
        regime: where it acts.
    """

    inner: Effect
    regime: Regime

    def __init__(self, inner: Effect, regime: Regime) -> None:
        self.inner, self.regime, self.reading = inner, regime, inner.reading

    def __reduce__(self) -> tuple[Any, ...]:
        return gate_effect, (self.inner, self.regime)

    @property
    def screened_as(self) -> str:
        """What readings of the inner effect have in common, and the regime."""
        return f"{self.inner.screened_as}[{self.regime}]"

    def with_reading(self, reading: str) -> Effect:
        """The same regime with another reading of the inner effect."""
        return self._of(self.inner.with_reading(reading))

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Readings of the inner effect."""
        return tuple(map(self._of, self.inner.readings(samples)))

    def restrictions(self, samples: WrenchSamples) -> tuple[tuple[Effect, tuple[int, ...]], ...]:
        """Restrictions of the inner effect."""
        return tuple((self._of(one), kept) for one, kept in self.inner.restrictions(samples))

    def freest(self) -> tuple[Effect, ...]:
        """Freest readings of the inner effect."""
        return tuple(map(self._of, self.inner.freest()))

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Those of the inner effect."""
        return self.inner.parameters(samples)

    def sums(self, samples: WrenchSamples) -> tuple[ParameterSum, ...]:
        """Those of the inner effect."""
        return self.inner.sums(samples)

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Delta inside, zero outside."""
        return self._gated(samples, self.inner.wrench(samples, inertia, theta))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By theta."""
        return self._gated(samples, self.inner.jacobian(samples, inertia, theta))

    def factored(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array] | None:
        """Columns of the inner effect inside."""
        found = self.inner.factored(samples, theta)
        return None if found is None else (self._gated(samples, found[0]), found[1])

    def coefficients(self, samples: WrenchSamples, theta: Array) -> Array | None:
        """Those of the inner effect."""
        return self.inner.coefficients(samples, theta)

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By phi."""
        return self._gated(samples, self.inner.inertia_jacobian(samples, inertia, theta))

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """That of the inner effect inside."""
        return self._gated(samples, self.inner.screening_basis(samples, inertia))

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """That of the inner effect."""
        return self.inner.initial_guess(samples, inertia, coefficients, residual)

    def load_after(self, inertia: Array, theta: Array) -> Array | None:
        """That of the inner effect."""
        return self.inner.load_after(inertia, theta)

    def is_possible(self, samples: WrenchSamples, inertia: Array, theta: Array) -> bool:
        """Whether the inner effect can exist."""
        return self.inner.is_possible(samples, inertia, theta)

    def inside(self, samples: WrenchSamples) -> NDArray[np.bool_]:
        """(N,) where the regime holds."""
        return self.regime.inside(lambda symbol: values_of(samples, symbol))

    def _of(self, inner: Effect) -> Effect:
        return gate_effect(inner, self.regime)

    def _gated(self, samples: WrenchSamples, values: Array) -> Array:
        inside = self.inside(samples)
        return np.asarray(values * inside.reshape(-1, *[1] * (values.ndim - 1)))


def can_be_gated(effect: Effect) -> bool:
    """Whether an effect may act in a regime only: sensors are not late now and then."""
    return not effect.delays


def gate_effect(effect: Effect, regime: Regime) -> Effect:
    """An effect that acts in a regime only, with the name ``name[regime]``.

    Raises:
        BadInputError: the effect makes sensors late.
    """
    if not can_be_gated(effect):
        raise BadInputError(
            f"effect '{effect.name}[{regime}]': sensors are late everywhere; leave the regime out"
        )
    return gated(GatedEffect, effect, regime, _COPIED)
