"""Simpler effects that an effect found in pushes may be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import chdtri

from tactile_dynamics_ros.core.array import Array

_POINT = {"constant_pull": slice(2, 4), "tether_spring": slice(3, 5)}
"""Where the parameters of effects that pull at one point have that point."""
_LEAN = "support_tilt"
"""Gravity along the table pulls at the centre of mass, always the same way."""
_CERTAIN = 0.01
"""P-value below which the point of a pull is not the centre of mass, as `significance` of the
diagnosis. Lower names a lean beside more cables, higher misses it once in as many."""


def lean_of(
    name: str, centre: Array, rows: list[int], present: Mapping[str, Array], covariance: Array
) -> tuple[str, ...]:
    """Return the simpler effect that a pull f at a point b may be, c the centre of mass.

    A table that leans pulls with m g sin at c: b = c, tested by the joint covariance of both.

    Args:
        name: of an effect of the model.
        centre: (2,) c from the centroid, m.
        rows: places of c in the covariance.
        present: parameters of all effects of the model, in their order.
        covariance: (q + k, q + k) of the q own parameters and those of all effects.
    """
    if name not in _POINT or _LEAN in present:
        return ()
    names, own = list(present), len(covariance) - sum(len(theta) for theta in present.values())
    first = own + sum(len(present[other]) for other in names[: names.index(name)])
    at = _POINT[name]
    places = [*rows, *range(first + at.start, first + at.stop)]
    change = np.concatenate([-np.eye(2), np.eye(2)], axis=1)
    spread = change @ covariance[np.ix_(places, places)] @ change.T
    off = present[name][at] - centre
    distance = float(off @ np.linalg.pinv(spread) @ off)
    return (_LEAN,) if distance < chdtri(2, _CERTAIN) else ()
