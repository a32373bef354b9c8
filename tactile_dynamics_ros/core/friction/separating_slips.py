"""Which further slip would tell rival models of friction apart."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.friction.slip_table import SlipTable

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel

Array = NDArray[np.float64]

_FORCES = (0.3, 0.5, 0.8, 1.2, 1.8)
_SPEEDS = (2e-3, 1e-2, 4e-2)
_TURNS = 8
_NOTABLE = 1.0


def plan_slips(model: FrictionModel, rivals: Sequence[FrictionModel]) -> dict[str, Any] | None:
    """Return the slip at which predictions differ most, over the scatter of one slip.

    Returns:
        {"description", "normal_force_n", "direction_deg", "sliding_speed_m_s", "rested",
        "separation_sigma", "slips"}, with the number of such slips that would make three standard
        deviations, or None if no slip tells them apart.
    """
    if not rivals:
        return None
    grid = _candidates()
    own = model.predict(model.x, model.effects, grid)
    gap = np.min(
        [np.abs(own - rival.predict(rival.x, rival.effects, grid)) for rival in rivals], axis=0
    )
    noise = model.noise
    scatter = np.hypot(noise.force_std, noise.relative_std * model.mu * grid.normal)
    separation = np.max(gap / scatter, axis=1)
    best = int(np.argmax(separation))
    strength = float(separation[best])
    if strength < 0.1 * _NOTABLE:
        return None
    force, angle = float(grid.normal[best, 0]), float(np.rad2deg(grid.angle[best]))
    speed, rested = float(grid.speed[best]), bool(grid.memory_normal[best] == 0.0)
    count = int(np.ceil((3.0 / strength) ** 2))
    return {
        "description": (
            f"{count} slip{'s' * (count > 1)} at {force:.1f} N along {angle:.0f} deg, sliding at "
            f"{1e3 * speed:.0f} mm/s, {'after a rest' if rested else 'soon after a hard press'}"
        ),
        "normal_force_n": force,
        "direction_deg": angle,
        "sliding_speed_m_s": speed,
        "rested": rested,
        "separation_sigma": strength,
        "slips": count,
    }


def _candidates() -> SlipTable:
    angles = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    rows = np.array(list(product(_FORCES, _SPEEDS, angles, (0.0, 1.5))))
    normal = np.repeat(rows[:, :1], 2, axis=1)
    return SlipTable(
        time=np.arange(len(rows), dtype=float),
        angle=rows[:, 2],
        normal=normal,
        tangential=np.zeros_like(normal),
        speed=rows[:, 1],
        memory_normal=rows[:, 3],
        memory_tangential=np.zeros(len(rows)),
    )
