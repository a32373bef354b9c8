"""Growing and shrinking of sets of pixels by squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def grow(mask: Mask, reach: int = 1) -> Mask:
    """Return the pixels (H, W) with one of the set at most `reach` rows and columns away."""
    return _spread(_spread(mask, reach).T, reach).T


def shrink(mask: Mask, reach: int = 1) -> Mask:
    """Return the pixels (H, W) with all at most `reach` rows and columns away in the set.

    Nothing outside of the image belongs to it.
    """
    beside = np.ones((mask.shape[0] + 2, mask.shape[1] + 2), dtype=bool)
    np.logical_not(mask, out=beside[1:-1, 1:-1])
    return ~grow(beside, reach)[1:-1, 1:-1]


def grow_cross(mask: Mask) -> Mask:
    """Return a set (H, W) and the pixels above, below, left and right of its pixels."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    grown[:, 1:] |= mask[:, :-1]
    grown[:, :-1] |= mask[:, 1:]
    return grown


def _spread(mask: Mask, reach: int) -> Mask:
    """Return a set (H, W) and what is at most `reach` rows above or below it.

    Each pass adds what the ones before have spread, so that the reach triples.
    """
    spread, done, reach = mask.copy(), 0, min(reach, len(mask) - 1)
    while done < reach:
        step = min(2 * done + 1, reach - done)
        before = spread.copy()
        spread[step:] |= before[:-step]
        spread[:-step] |= before[step:]
        done += step
    return spread
