"""The emergency stop, for every node that commands motion; deactivating it stops it as well."""

from __future__ import annotations

from collections.abc import Callable

from std_msgs.msg import Bool

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.ros.names import EMERGENCY_STOP
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM, Shell

ON = "the emergency stop is on"
"""Reason that a stopped motion gives."""


class EmergencyStop:
    """Follows /emergency_stop (std_msgs/Bool): true stops the node at once, false moves nothing.

    Two subscriptions hear every publisher: one gets what a latched publisher said before this node
    lived, which DDS gives to no subscriber of a publisher that keeps nothing; the other gets what
    any publisher says from now on, however unreliable it is. The newest message counts.

    Args:
        node: that commands motion.
        stop: called with the reason at each true and when the node is deactivated; must end all
            motion.

    Attributes:
        active: whether the stop is on.
    """

    def __init__(self, node: Shell, stop: Callable[[str], None]) -> None:
        self.active = False
        self._stop = stop
        node.stops.append(stop)
        for profile in (LATCHED, STREAM):
            node.listen(Bool, EMERGENCY_STOP, self._take, profile, always=True)

    def require_released(self) -> None:
        """Check that motion may begin.

        Raises:
            NotIdentifiableError: the stop is on.
        """
        if self.active:
            raise NotIdentifiableError(f"{ON}; publish false on {EMERGENCY_STOP} to release it")

    def _take(self, message: Bool) -> None:
        self.active = message.data
        if message.data:
            self._stop(ON)
