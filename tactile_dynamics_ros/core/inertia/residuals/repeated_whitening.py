"""White columns that are computed again only where they have changed."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.present import PresentEffects

_KEPT = 8
"""Keys whose white columns are kept; models have a few effects, one key each. With fewer than that,
columns are computed again at each step: slower, not different. More only hold memory."""


class RepeatedWhitening:
    """Remembers the last white columns by key: those of linear effects are the same at every step.

    Of the keys, those used lately.

    Args:
        whiten: makes white columns of arrays, one array per stretch of a recording.
    """

    def __init__(self, whiten: Callable[[Sequence[Array]], Array]) -> None:
        self._whiten = whiten
        self._last: dict[Hashable, tuple[Sequence[Array], Array]] = {}

    def __call__(self, key: Hashable, values: Sequence[Array]) -> Array:
        """White form of the arrays that come under one key."""
        known = self._last.pop(key, None)
        if known is None or not all(map(_is_same, known[0], values)):
            known = values, self._whiten(values)
        self._last[key] = known
        if len(self._last) > _KEPT:
            del self._last[next(iter(self._last))]
        return known[1]

    def jacobian(
        self,
        effect: Effect,
        present: PresentEffects,
        samples: Sequence[WrenchSamples],
        phi: Array,
        theta: Array,
    ) -> Array:
        """White derivative (M, k) of an effect by its parameters.

        Args:
            effect: one that `present` may hold.
            present: effects beside it, which may make sensors late.
            samples: samples of each stretch, as the effect sees them.
            phi: (10,) dynamic parameters.
            theta: (k,) parameters of the effect.
        """
        found = self.factored(effect, present, samples, theta)
        if found is not None:
            return np.asarray(found[0] @ found[1])
        columns = [effect.jacobian(s, phi, theta) for s in samples]
        return self((effect.label, "jacobian"), _shown(effect, present, samples, columns))

    def factored(
        self,
        effect: Effect,
        present: PresentEffects,
        samples: Sequence[WrenchSamples],
        theta: Array,
    ) -> tuple[Array, Array] | None:
        """White columns (M, b) and (b, k) whose product is that derivative; None without such."""
        parts = [p for s in samples if (p := effect.factored(s, theta)) is not None]
        if not parts:
            return None
        columns = _shown(effect, present, samples, [columns for columns, _ in parts])
        return self((effect.label, "columns"), columns), parts[0][1]


def _shown(
    effect: Effect,
    present: PresentEffects,
    samples: Sequence[WrenchSamples],
    columns: Sequence[Array],
) -> list[Array]:
    """Columns of each stretch as late as the present sensors show them."""
    return [present.as_shown(effect, s, part) for s, part in zip(samples, columns, strict=True)]


def _is_same(before: Array, now: Array) -> bool:
    return before is now or np.array_equal(before, now)
