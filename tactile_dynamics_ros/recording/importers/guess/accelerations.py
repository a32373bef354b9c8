"""Accelerations of an IMU that stand for the positions which a table lacks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.recording.importers.fields import UNITS
from tactile_dynamics_ros.recording.importers.guess.answers import Question
from tactile_dynamics_ros.recording.importers.guess.groups import Group
from tactile_dynamics_ros.recording.importers.tables import Table

Array = NDArray[np.float64]

_GRAVITY = 9.81
"""m/s^2; within the bound below at any place on Earth."""
_OFF = 0.3
"""Difference of readings and gravity, over gravity, up to which an IMU's axes are those of the
orientation: robots accelerate loads by up to 2 m/s^2. Axes that are exchanged or turned about are
off by 1.4 and 2; at 0.1 robots would have to be slow."""


def read_acceleration(group: Group, table: Table, rotation: Array) -> dict[str, Any]:
    """Return the entry of a mapping for what an accelerometer reads, gravity included.

    At rest it reads R' (0, 0, g).

    Args:
        group: its columns.
        table: rows.
        rotation: (N, 3, 3) body to world, z up.

    Raises:
        Question: it does not read gravity in the axes of the orientation.
    """
    values = table.columns(*group.columns)
    units = [group.unit] if group.unit in UNITS["acceleration"] else list(UNITS["acceleration"])
    off, unit = min((_distance(UNITS["acceleration"][u] * values, rotation), u) for u in units)
    if not off < _OFF:
        raise Question(
            f"no position is in the table, and {group.label} do not read gravity in the axes of "
            "the orientation as an IMU there would: name columns and sensor_rotation of object_imu "
            "in a yaml file (docs/recordings.md)"
        )
    return {"columns": list(group.columns), "unit": unit}


def _distance(specific_force: Array, rotation: Array) -> float:
    """Difference (N, 3) of readings and gravity as a root mean square, over gravity."""
    error = specific_force - _GRAVITY * rotation[:, 2]
    return float(np.sqrt(np.nanmean(np.sum(error**2, axis=1)))) / _GRAVITY
