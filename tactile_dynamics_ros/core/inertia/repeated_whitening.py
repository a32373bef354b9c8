"""White columns that are computed again only where they have changed."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RepeatedWhitening:
    """Remembers the last white columns by key: those of linear effects are the same at every step.

    Args:
        whiten: makes white columns of arrays.
    """

    def __init__(self, whiten: Callable[[Sequence[Array]], Array]) -> None:
        self._whiten = whiten
        self._last: dict[Hashable, tuple[Sequence[Array], Array]] = {}

    def __call__(self, key: Hashable, values: Sequence[Array]) -> Array:
        """White form of the arrays that come under one key."""
        known = self._last.get(key)
        if known is None or not all(map(np.array_equal, known[0], values)):
            known = self._last[key] = values, self._whiten(values)
        return known[1]
