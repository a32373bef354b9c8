"""What carries the camera from one pose to the next at a steady speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3

Array = NDArray[np.float64]

TURN_RATE = 1.0
"""Largest rate at which the camera turns, rad/s: as arms turn a wrist. Half of it doubles the time
of moves that only turn."""


class Carriage:
    """Moves straight to its target and turns evenly on the way.

    Args:
        pose: (4, 4) at the start.
        speed: m/s.

    Attributes:
        pose: (4, 4) now.
    """

    def __init__(self, pose: Array, speed: float) -> None:
        self.pose, self._target, self._speed = pose.copy(), pose.copy(), speed

    def go_to(self, target: Array) -> None:
        """Set where to be, (4, 4)."""
        self._target = target.copy()

    def advance(self, duration: float) -> None:
        """Move for so many seconds."""
        way = self._target[:3, 3] - self.pose[:3, 3]
        turn = log_so3(self.pose[:3, :3].T @ self._target[:3, :3])
        needed = max(np.linalg.norm(way) / self._speed, np.linalg.norm(turn) / TURN_RATE)
        if needed <= duration:
            self.pose = self._target.copy()
            return
        share = duration / needed
        self.pose[:3, 3] += share * way
        self.pose[:3, :3] = self.pose[:3, :3] @ exp_so3(share * turn)
