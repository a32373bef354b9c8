"""Where the table is."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.ros.conversions import MessageError, pose_to_core
from tactile_dynamics_ros.ros.names import SUPPORT_POSE
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.wire import Stamped

LEVEL = np.cos(np.deg2rad(1.0))
"""Cosine of the table's tilt up to which it counts as level: at 1 deg the foot of an object of
10 cm is 0.9 mm off at its sides, as much as a camera's noise. Shapes are reported upright."""


class Support:
    """Hears `/support/pose`, whose z is the normal of the table.

    Args:
        node: that listens.
    """

    def __init__(self, node: Shell) -> None:
        self._pose: NDArray[np.float64] | None = None
        node.listen(PoseStamped, SUPPORT_POSE, self._on_pose, LATCHED)

    def height(self) -> float:
        """Return the height of the table in the world, m.

        Raises:
            NotIdentifiableError: nobody told it yet.
        """
        if self._pose is None:
            raise NotIdentifiableError(f"no {SUPPORT_POSE} yet: publish where the table is")
        return float(self._pose[2, 3])

    def _on_pose(self, message: Stamped) -> None:
        pose = pose_to_core(message, SUPPORT_POSE, "world")
        if pose[2, 2] < LEVEL:
            raise MessageError("tilted", f"{SUPPORT_POSE}: the table must be level within 1 deg")
        self._pose = pose
