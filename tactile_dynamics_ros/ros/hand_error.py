"""The hand's error in the world, live: from the fused pose and that of the hand alone."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from itertools import islice
from operator import itemgetter

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray

from tactile_dynamics_ros.core.tracking.hand_error import LASTING, SAME_TIME, hand_motions
from tactile_dynamics_ros.ros.conversions import (
    RESTART_AFTER,
    to_seconds,
    uncertain_pose_to_core,
)
from tactile_dynamics_ros.ros.names import HAND_POSE
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.wire import Stamped

Array = NDArray[np.float64]

KEPT = 200
_STILL = np.eye(4)

_Timed = deque[tuple[float, Array]]


class HandError:
    """Motion that carries contacts to where vision shows the object (`core.tracking.hand_error`).

    Args:
        node: that subscribes. Where nobody publishes the hand's pose, contacts stay.
    """

    def __init__(self, node: Shell) -> None:
        self.clear()
        node.listen(PoseWithCovarianceStamped, HAND_POSE, self._on_hand)

    def clear(self) -> None:
        """Forget what was measured."""
        self._told: _Timed = deque(maxlen=KEPT)
        self._shown: _Timed = deque(maxlen=KEPT)
        self._motions: _Timed = deque(maxlen=KEPT)

    def add_fused(self, time: float, pose: Array) -> None:
        """Take the fused pose (4, 4) of a time, s."""
        _append(self._shown, time, pose)
        hand = _at(self._told, time, SAME_TIME)
        if hand is not None:
            self._add_motion(time, pose, hand)

    def at(self, time: float) -> Array:
        """Return the motion (4, 4) for contacts of a time, s."""
        found = _at(self._motions, time, LASTING)
        return _STILL if found is None else found

    def _on_hand(self, message: Stamped) -> None:
        hand, _ = uncertain_pose_to_core(message, HAND_POSE, "world")
        time = to_seconds(message.stamp)
        _append(self._told, time, hand)
        fused = _at(self._shown, time, SAME_TIME)
        if fused is not None:
            self._add_motion(time, fused, hand)

    def _add_motion(self, time: float, fused: Array, hand: Array) -> None:
        _append(self._motions, time, hand_motions(fused[None], hand[None])[0])


def _append(entries: _Timed, time: float, value: Array) -> None:
    """Append what comes in the order of time; a clock that was restarted makes the past void."""
    if entries and time < entries[-1][0] - RESTART_AFTER:
        entries.clear()
    if not entries or time > entries[-1][0]:
        entries.append((time, value))


def _at(entries: _Timed, time: float, tolerance: float) -> Array | None:
    """The value nearest to a time, or None if it is further than the tolerance."""
    after = bisect_left(entries, time, key=itemgetter(0))
    around = islice(entries, max(after - 1, 0), after + 1)
    near = [entry for entry in around if abs(entry[0] - time) <= tolerance]
    return min(near, key=lambda entry: abs(entry[0] - time))[1] if near else None
