"""Growing and shrinking of sets of pixels, by counting what lies in the square around each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Counts = NDArray[np.int32]


def count_around(mask: Mask, reach: int) -> Counts:
    """Return how many pixels of a set are at most `reach` rows and columns away, (H, W).

    Args:
        mask: (H, W) the set; nothing outside of the image belongs to it.
        reach: px.
    """
    return _sum_along(_sum_along(mask.T, reach).T, reach)


def grow(mask: Mask, reach: int = 1) -> Mask:
    """Return the pixels (H, W) with one of the set at most `reach` rows and columns away."""
    return np.asarray(count_around(mask, reach) > 0)


def shrink(mask: Mask, reach: int = 1) -> Mask:
    """Return the pixels (H, W) with all at most `reach` rows and columns away in the set."""
    return np.asarray(count_around(mask, reach) == (2 * reach + 1) ** 2)


def grow_cross(mask: Mask) -> Mask:
    """Return a set (H, W) and the pixels above, below, left and right of its pixels."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    grown[:, 1:] |= mask[:, :-1]
    grown[:, :-1] |= mask[:, 1:]
    return grown


def _sum_along(values: NDArray[np.bool_] | Counts, reach: int) -> Counts:
    """Return sums over 2 reach + 1 neighbours along the last axis, (H, W)."""
    rows, columns = values.shape
    total = np.zeros((rows, columns + 2 * reach + 1), dtype=np.int32)
    np.cumsum(values, axis=1, out=total[:, reach + 1 : reach + 1 + columns])
    total[:, reach + 1 + columns :] = total[:, reach + columns, None]
    return np.asarray(total[:, 2 * reach + 1 :] - total[:, :columns])
