"""Effects that another, simpler one may be: a pull straight up at the centre of mass."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

Array = NDArray[np.float64]

_PULL, _FLUID = "hanging_cable", "added_mass"
"""Names of the effects that may be each other. They are API."""

_CERTAIN = 0.01
"""P-value below which a pull is off the vertical or off the centre of mass, as `significance` of
the diagnosis. Lower names the fluid beside more cables, higher misses it once in as many."""


def imitators(
    name: str, phi: Array, present: Mapping[str, Array], covariance: Array
) -> tuple[str, ...]:
    """`added_mass` beside a constant pull that may be a fluid, moved along but weighing nothing.

    The body m with added mass m_a is the body m + m_a with the pull m_a g upward at its centre of
    mass c: a pull F at p is that if F_x = F_y = 0 < F_z and p = c.

    Args:
        name: of an effect of the model.
        phi: (10,) dynamic parameters.
        present: parameters of all effects of the model, in their order.
        covariance: (10 + k, 10 + k) of phi and all of them.
    """
    if name != _PULL:
        return ()
    names = list(present)
    first = 10 + sum(len(present[other]) for other in names[: names.index(name)])
    rows = [*range(10), *range(first, first + 6)]
    theta, centre = present[name], phi[1:4] / phi[0]
    off = np.concatenate([theta[:2], theta[3:] - centre])
    by_both = np.zeros((5, 16))
    by_both[:2, 10:12], by_both[2:, 13:] = np.eye(2), np.eye(3)
    by_both[2:, 0], by_both[2:, 1:4] = centre / phi[0], -np.eye(3) / phi[0]
    spread = by_both @ covariance[np.ix_(rows, rows)] @ by_both.T
    distance = float(off @ np.linalg.pinv(spread) @ off)
    return (_FLUID,) if theta[2] > 0.0 and distance < chdtri(len(off), _CERTAIN) else ()
