"""The hand's error in the world, live: from the fused pose and that of the hand alone."""

from __future__ import annotations

from collections import deque

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray

from tactile_dynamics_ros.core.tracking.hand_error import LASTING, SAME_TIME, hand_motions
from tactile_dynamics_ros.nodes.conversions import to_seconds, uncertain_pose_to_core
from tactile_dynamics_ros.nodes.shell import Shell
from tactile_dynamics_ros.nodes.wire import Stamped

Array = NDArray[np.float64]

HAND_POSE = "/object/pose/kinematic"
KEPT = 50
_STILL = np.eye(4)


class HandError:
    """Motion that carries contacts to where vision shows the object (`core.tracking.hand_error`).

    Args:
        node: that subscribes. Where nobody publishes the hand's pose, contacts stay.
    """

    def __init__(self, node: Shell) -> None:
        self._told: deque[tuple[float, Array, Array]] = deque(maxlen=KEPT)
        self._shown: deque[tuple[float, Array]] = deque(maxlen=KEPT)
        self._motion, self._time = _STILL, -np.inf
        node.listen(PoseWithCovarianceStamped, HAND_POSE, self._on_hand)

    def add_fused(self, time: float, pose: Array) -> None:
        """Take the fused pose (4, 4) of a time, s."""
        self._shown.append((time, pose))
        self._pair(time)

    def at(self, time: float) -> Array:
        """Return the motion (4, 4) for contacts of a time, s."""
        return self._motion if abs(time - self._time) <= LASTING else _STILL

    def _on_hand(self, message: Stamped) -> None:
        pose, covariance = uncertain_pose_to_core(message, HAND_POSE, "world")
        if covariance is not None:
            time = to_seconds(message.stamp)
            self._told.append((time, pose, covariance))
            self._pair(time)

    def _pair(self, time: float) -> None:
        """Find the motion once both poses of a time have come."""
        shown = [pose for t, pose in self._shown if abs(t - time) < SAME_TIME]
        told = [entry for entry in self._told if abs(entry[0] - time) < SAME_TIME]
        if shown and told:
            _, hand, covariance = told[-1]
            self._motion = hand_motions(shown[-1][None], hand[None], covariance[None])[0]
            self._time = time
