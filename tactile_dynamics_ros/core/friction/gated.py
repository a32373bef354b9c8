"""Any effect on friction, acting only on some of the slips."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.slip_table import SlipTable
from tactile_dynamics_ros.core.numerics.regime import Regime

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.friction.effects import FrictionEffect

Array = NDArray[np.float64]


def slip_scalars(slips: SlipTable) -> dict[str, tuple[str, str, Array]]:
    """Name, unit and values (N,) of what a slip went through, by symbol.

    `t` (time), `N` (normal force), `v` (sliding speed) and `phi` (direction of the pull).
    """
    return {
        "t": ("time", "s", slips.time - slips.time[0]),
        "N": ("normal force", "N", slips.normal[:, 0]),
        "v": ("sliding speed", "m/s", slips.speed),
        "phi": ("direction", "deg", np.degrees(np.mod(slips.angle, 2.0 * np.pi))),
    }


def inside(regime: Regime, slips: SlipTable) -> NDArray[np.bool_]:
    """(N,) slips of a regime.

    Raises:
        BadInputError: slips have no scalar of that symbol.
    """
    known = slip_scalars(slips)

    def values(symbol: str) -> Array:
        if symbol not in known:
            raise BadInputError(f"regime: '{symbol}' is unknown; there are {', '.join(known)}")
        return known[symbol][2]

    return regime.inside(values)


def gate_friction(effect: FrictionEffect, regime: Regime) -> FrictionEffect:
    """An effect on the slips of a regime, with the name ``name[regime]``."""
    kind = type(effect)

    def factor(self: FrictionEffect, slips: SlipTable, theta: Array) -> Array:
        """Factor of the effect, 1 outside."""
        acts = inside(regime, slips)[:, None]
        return np.where(acts, kind.factor(self, slips, theta), 1.0)

    def term(self: FrictionEffect, slips: SlipTable, mu: Array, theta: Array) -> Array:
        """Term of the effect, 0 outside."""
        return np.where(inside(regime, slips)[:, None], kind.term(self, slips, mu, theta), 0.0)

    def curvature(self: FrictionEffect, slips: SlipTable, mu: Array) -> Array:
        """Columns of the effect, 0 outside."""
        acts = inside(regime, slips)[:, None, None]
        return np.where(acts, kind.curvature(self, slips, mu), 0.0)

    body = {"factor": factor, "term": term, "curvature": curvature}
    name = f"{effect.name}[{regime}]"
    gated: FrictionEffect = type("Gated" + kind.__name__, (kind,), {**body, "name": name})()
    return gated
