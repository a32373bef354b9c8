"""Effects that another, simpler one may be: a constant pull at the centre of mass."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import chdtri

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W

_PULL = "hanging_cable"
"""Name of the effect that others are forms of. It is API."""

_CERTAIN = 0.01
"""P-value below which a pull is none of the simpler effects, as `significance` of the diagnosis.
Lower names these beside more cables, higher misses them once in as many."""


def imitators(
    name: str, phi: Array, present: Mapping[str, Array], covariance: Array
) -> tuple[str, ...]:
    """Simpler effects that a constant pull F at a point p may be, m the mass and c its centre.

    - `added_mass`, fluid that is moved along but weighs nothing: the body m + m_a with m_a g upward
      at its centre, F_x = F_y = 0 < F_z and p = c;
    - `gravity_tilt`: gravity of the same size and another direction, p = c and
      F_z = (F_x^2 + F_y^2) / (2 m g) to second order.

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
    spread, pull = covariance[np.ix_(rows, rows)], present[name]
    level, weight = pull[:2], phi[0] * np.linalg.norm(GRAVITY_W)
    fluid, tilt = np.zeros((2, 16)), np.zeros((1, 16))
    fluid[:, 10:12] = np.eye(2)
    tilt[0, 10:13] = np.append(-level / weight, 1.0)
    found = []
    if pull[2] > 0.0 and _vanishes(level, fluid, phi, pull, spread):
        found.append("added_mass")
    if _vanishes(pull[2:3] - level @ level / (2.0 * weight), tilt, phi, pull, spread):
        found.append("gravity_tilt")
    return tuple(found)


def _vanishes(value: Array, change: Array, phi: Array, pull: Array, spread: Array) -> bool:
    """Whether values (n,) with derivatives (n, 16) and the arm p - c may all be zero."""
    centre = phi[1:4] / phi[0]
    arm = np.zeros((3, 16))
    arm[:, 13:], arm[:, 0], arm[:, 1:4] = np.eye(3), centre / phi[0], -np.eye(3) / phi[0]
    off, by_both = np.append(value, pull[3:] - centre), np.concatenate([change, arm])
    distance = float(off @ np.linalg.pinv(by_both @ spread @ by_both.T) @ off)
    return bool(distance < chdtri(len(off), _CERTAIN))
