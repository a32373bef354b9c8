"""Effects that every finger has for itself: parameters per contact, restrictions to some."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect, EffectParameter
from tactile_dynamics_ros.core.errors import BadInputError

Array = NDArray[np.float64]

_COMMON = "common"
_MOST_SUBSETS = 6


class FingerEffect(Effect):
    """An effect with its own parameters at each of the chosen contacts (all by default).

    A reading is written `index+thumb` (those contacts), `common` (one set of parameters for all)
    or empty (every contact for itself).

    Attributes:
        allows_common: whether one set of parameters for all contacts is a sensible reading.
    """

    allows_common = False

    def __init__(self, contacts: tuple[str, ...] = (), common: bool = False) -> None:
        """Choose the contacts.

        Args:
            contacts: names; empty means all.
            common: all contacts share one set of parameters.
        """
        self.contacts = contacts
        self.common = common

    @property
    def variant(self) -> str:
        """`common`, contacts joined by `+`, or empty."""
        return _COMMON if self.common else "+".join(self.contacts)

    def with_variant(self, variant: str) -> Effect:
        """`common` or contact names joined by `+`."""
        if variant == _COMMON and self.allows_common:
            return type(self)(common=True)
        return type(self)(tuple(variant.split("+")) if variant else ())

    def variants(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Every contact for itself, and all in common where that makes sense."""
        own = type(self)()
        if self.allows_common and len(samples.contact_names) > 1:
            return (own, type(self)(common=True))
        return (own,)

    def restrictions(self, samples: WrenchSamples) -> tuple[tuple[Effect, tuple[int, ...]], ...]:
        """Every proper subset of contacts (of one and all but one for many contacts)."""
        chosen = self.chosen(samples)
        if self.common or len(chosen) < 2:
            return ()
        width = len(self.contact_parameters(samples, chosen[0]))
        names = samples.contact_names
        found = []
        for picked in _proper_subsets(len(chosen)):
            effect = type(self)(tuple(names[chosen[i]] for i in picked))
            columns = tuple(width * i + j for i in picked for j in range(width))
            found.append((effect, columns))
        return tuple(found)

    @abstractmethod
    def axis_parameters(self) -> tuple[EffectParameter, ...]:
        """Parameters of one contact, without the name of the contact."""

    def contact_parameters(
        self, samples: WrenchSamples, contact: int
    ) -> tuple[EffectParameter, ...]:
        """Parameters of one contact of these samples, the same count for every contact."""
        return self.axis_parameters()

    @abstractmethod
    def finger_wrench(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """Delta (N, 6) of one contact."""

    @abstractmethod
    def finger_jacobian(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """Derivative (N, 6, k) of one contact."""

    def chosen(self, samples: WrenchSamples) -> list[int]:
        """Indices of the chosen contacts.

        Raises:
            BadInputError: a chosen contact is not in the samples.
        """
        if not self.contacts:
            return list(range(len(samples.contact_names)))
        unknown = sorted(set(self.contacts) - set(samples.contact_names))
        if unknown:
            raise BadInputError(
                f"effect '{self.label}': contact '{unknown[0]}' is not in the recording: "
                f"expected {', '.join(samples.contact_names)}"
            )
        return [samples.contact_names.index(name) for name in self.contacts]

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Parameters named `<symbol>_<contact>`, or plain where common."""
        if self.common:
            return self.contact_parameters(samples, 0)
        return tuple(
            replace(p, name=f"{samples.contact_names[c]}_{p.name}", typical=p.typical / (1 + i))
            for i, c in enumerate(self.chosen(samples))
            for p in self.contact_parameters(samples, c)
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Sum over the chosen contacts."""
        parts = [self.finger_wrench(samples, c, part) for c, part in self._split(samples, theta)]
        return np.asarray(np.sum(parts, axis=0))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Columns of the chosen contacts side by side, or their sum where common."""
        columns = [self.finger_jacobian(samples, c, p) for c, p in self._split(samples, theta)]
        total = np.sum(columns, axis=0) if self.common else np.concatenate(columns, axis=2)
        return np.asarray(total)

    def _split(self, samples: WrenchSamples, theta: Array) -> list[tuple[int, Array]]:
        chosen = self.chosen(samples)
        if self.common:
            return [(c, theta) for c in chosen]
        return list(zip(chosen, np.split(theta, len(chosen)), strict=True))


def _proper_subsets(count: int) -> list[tuple[int, ...]]:
    everything = range(count)
    sizes = range(1, count) if count <= _MOST_SUBSETS else (1, count - 1)
    return [subset for size in sizes for subset in combinations(everything, size)]
