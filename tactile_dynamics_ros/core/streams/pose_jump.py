"""Poses that no body can have reached from the ones before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import log_so3

Array = NDArray[np.float64]

FASTEST = np.array([1000.0, 100.0])
"""Angular, rad/s^2, and linear acceleration, m/s^2, that nothing exceeds which a hand or an arm
holds: arms do a tenth of it, shaken tools a third. Lower breaks windows at impacts, ten times
higher joins poses in mm with those in m."""
ASSUMED_STD = np.array([0.05, 0.02])
"""Noise, rad and m, of a tracker that states none, as far as it may not be called a jump: cameras
without depth do that. Less leaves noisy trackers without a window, more joins what a tracker that
found another object says."""
_SURE = 6.0
"""Standard deviations of noise that are no jump: chance exceeds them once in 10^8 poses. At 4 clean
recordings would break once in five minutes, at 12 jumps of 3 cm would pass."""


def jumps(time: Array, position: Array, rotation: Array, std: Array) -> bool:
    """Whether the last of three poses is farther from where the two before lead than bodies get.

    With steps h1 and h2, the deviation p3 - p2 - (p2 - p1) h2 / h1 is below a h2 (h1 + h2) / 2
    for accelerations below a, and noise of each pose adds to it.

    Args:
        time: (3,) s, increasing.
        position: (3, 3) m.
        rotation: (3, 3, 3).
        std: (2,) noise of a pose: rad, m.
    """
    first, second = np.diff(time)
    share = second / first
    turns = log_so3(rotation[1:] @ np.swapaxes(rotation[:-1], 1, 2))
    steps = np.stack([turns, np.diff(position, axis=0)])
    deviation = np.linalg.norm(steps[:, 1] - share * steps[:, 0], axis=1)
    noise = _SURE * np.sqrt(1.0 + (1.0 + share) ** 2 + share**2) * std
    return bool(np.any(deviation > 0.5 * FASTEST * second * (first + second) + noise))
