"""Where a tip or a pad touches an object on a table: from its own place and the outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OutlineContactConfig:
    """What tells whether and where an outline is touched."""

    touch_force: float = parameter(0.15, "force below which nothing is touched", "N", 0.0, 5.0)
    tip_radius: float = parameter(0.006, "of a round tip", "m", 0.0, 0.1)
    reach: float = parameter(
        0.02, "a tip further than this from every outline touches something else", "m", 0.0, 1.0
    )

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class OutlineContact:
    """A contact on the side of an object.

    Attributes:
        point: (2,) m, on the outline. normal: (2,) unit vector into the object.
        gap: m, from the middle of the tip to the outline; negative inside.
    """

    point: Array
    normal: Array
    gap: float


def nearest_side(place: Array, outlines: Sequence[Array]) -> OutlineContact:
    """Return the place on outlines that is nearest to a point, with the normal there.

    Outside a corner the normal points from the place to the corner: a round tip rolls about it.

    Args:
        place: (2,) m, middle of the tip.
        outlines: (V, 2) m each, anticlockwise, in the same frame.
    """
    found = [_nearest(place, outline) for outline in outlines]
    return min(found, key=lambda contact: contact.gap)


def _nearest(place: Array, outline: Array) -> OutlineContact:
    edge = np.roll(outline, -1, axis=0) - outline
    away = place - outline
    length = np.maximum(np.sum(edge**2, axis=1), 1e-18)
    share = np.clip(np.sum(away * edge, axis=1) / length, 0.0, 1.0)
    gap = away - share[:, None] * edge
    k = int(np.sum(gap**2, axis=1).argmin())
    offset, along = gap[k], edge[k] / np.sqrt(length[k])
    distance = float(np.linalg.norm(offset))
    inside = along[0] * offset[1] - along[1] * offset[0] > 0.0
    if distance < 1e-9:
        return OutlineContact(place - offset, np.array([-along[1], along[0]]), 0.0)
    signed = -distance if inside else distance
    return OutlineContact(place - offset, -offset / signed, signed)
