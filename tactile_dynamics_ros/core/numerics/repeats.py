"""Readings that repeat themselves to the last bit for longer than chance lets them."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STUCK = 10
"""Equal forces in a row, all three axes to the last bit, that are no chance: a sensor whose noise
is a fifth of its step still repeats itself so often once in ten million rows. Fewer call coarse
sensors stuck, more believe a stuck one for longer (10 are 0.1 s at 100 Hz)."""
_ROUNDING = 1e-9
"""Relative change of a force that is rounding: what a sensor repeats is turned into the world by
rotations of 16 digits. Larger than 1e-6 would call quiet sensors stuck."""
FROZEN = 8
"""Equal poses in a row that are no chance: a camera of 15 Hz that is published at 100 Hz repeats
each pose seven times. Fewer would refuse such a camera, more believe a tracker that hangs for
longer."""


def repeated_forces(in_world: Array, in_sensor: Array, lost: Mask) -> Mask:
    """Whether forces (N - 1, C) are those of the row before, in the world or in the sensor.

    Args:
        in_world: (N, C, 3) N.
        in_sensor: (N, C, 3) N, the same in the axes of each sensor.
        lost: (N,) whether a row has no reading that could repeat one.
    """
    found = np.zeros((max(len(in_world) - 1, 0), in_world.shape[1]), dtype=bool)
    for force in (in_world, in_sensor):
        change = np.abs(np.diff(force, axis=0)).max(axis=2)
        found |= change <= _ROUNDING * np.abs(force[1:]).max(axis=2)
    loaded = np.any(in_world[1:] != 0.0, axis=2)
    return np.asarray(found & loaded & ~lost[1:, None])


def repeated_poses(position: Array, rotation: Array) -> Mask:
    """Whether poses (N - 1,) are those of the row before; (N, 3) m and (N, 3, 3)."""
    same = np.all(position[1:] == position[:-1], axis=1)
    return np.asarray(same & np.all(rotation[1:] == rotation[:-1], axis=(1, 2)))


def in_runs(same: Mask, least: int) -> Mask:
    """Whether each of N + 1 rows is part of a run of at least `least` equal rows.

    Args:
        same: (N, C) whether a row equals the one before it.
        least: rows.
    """
    runs = np.zeros((len(same) + 1, same.shape[1]), dtype=bool)
    if len(same) < least - 1:
        return runs
    whole = np.all(sliding_window_view(same, least - 1, axis=0), axis=2)
    for shift in range(least):
        runs[shift : shift + len(whole)] |= whole
    return runs
