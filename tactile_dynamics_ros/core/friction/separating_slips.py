"""Which further slip would tell rival models of friction apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.friction.slip_table import LEAST_SPEED, SlipTable

Array = NDArray[np.float64]
OfSlips = Callable[[SlipTable], Array]
"""Forces (N, 2) of slips, N: static and kinetic."""

_FORCES = (0.3, 0.5, 0.8, 1.2, 1.8)
"""Normal forces of the slips that are compared, N: what a probe presses with (up to 1.7 N). Values
beyond would propose slips that no probe makes, finer ones cost time."""
_SPEEDS = (LEAST_SPEED, 1e-2, 4e-2)
"""Speeds of sliding that are compared, m/s: from where a fingertip creeps (`LEAST_SPEED`) to three
times those of a probe's slides. Faster ones would propose slides that no probe makes."""
_TURNS = 8
"""Directions that are compared: every 45 deg, half a period of the second harmonic of a grain.
Fewer miss where an effect shows most, more propose nearly the same direction."""
_LEAST_SEPARATION = 0.1
"""Difference of predictions from which a slip is proposed, in standard deviations of a single one:
nine hundred slips would then make three of them. Less is no proposal to anybody. More would
withhold proposals that some hundred slips can carry out."""


def plan_slips(
    best: OfSlips, rivals: Sequence[OfSlips], scatter_of: OfSlips
) -> dict[str, Any] | None:
    """Return the slip at which predictions differ most, over the scatter of one slip.

    Args:
        best: predicted tangential forces, N.
        rivals: those of other explanations.
        scatter_of: standard deviation of a measured force, N.

    Returns:
        {"description", "normal_force_n", "direction_deg", "sliding_speed_m_s", "rested",
        "separation_sigma", "slips"}, with the number of such slips that would make three standard
        deviations, or None if no slip tells them apart.
    """
    if not rivals:
        return None
    grid = _candidates()
    own = best(grid)
    gap = np.min([np.abs(own - rival(grid)) for rival in rivals], axis=0)
    separation = np.max(gap / scatter_of(grid), axis=1)
    most = int(np.argmax(separation))
    strength = float(separation[most])
    if strength < _LEAST_SEPARATION:
        return None
    force, angle = float(grid.normal[most, 0]), float(np.rad2deg(grid.angle[most]))
    speed, rested = float(grid.speed[most]), bool(grid.memory_normal[most] == 0.0)
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
