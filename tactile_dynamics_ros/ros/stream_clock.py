"""The clock that the streams of one node share: strays are refused, a restart is reported once."""

from __future__ import annotations

import time
from collections.abc import Callable

from tactile_dynamics_ros.core.streams.stamps import Admission, SharedClock
from tactile_dynamics_ros.ros.conversions import MessageError, to_seconds
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.wire import AnyStamp

IDLE = 0.15
"""Wall time without a message after which late ones are no longer waited for, s: streams of 10 Hz
still count as coming."""


class StreamClock:
    """Admits the stamps of a node's streams.

    Args:
        node: whose faults are counted.

    Attributes:
        on_move: called when the clock was set or stepped back: what waits belongs to another time.
        on_restart: called when it was set back, so that the past is void.
        on_step: called with by how much, s, when it stepped back: the past stays, what comes does
            not join it.
    """

    def __init__(self, node: Shell) -> None:
        self._node = node
        self._clock = SharedClock()
        self._heard = 0.0
        self.on_move: list[Callable[[], None]] = []
        self.on_restart: list[Callable[[], None]] = []
        self.on_step: list[Callable[[float], None]] = []

    @property
    def newest(self) -> float:
        """Newest stamp that is believed, s."""
        return self._clock.newest

    @property
    def is_idle(self) -> bool:
        """Whether nothing has come for a while."""
        return time.monotonic() - self._heard > IDLE

    def admit(self, stamp: AnyStamp, topic: str) -> float:
        """Return a stamp in seconds.

        Args:
            stamp: stamp of a message.
            topic: for the error text.

        Raises:
            MessageError: the stamp is zero or less, or not of the time that the other streams have.
        """
        stamped = to_seconds(stamp)
        if stamped <= 0.0:
            raise MessageError(
                "zero_stamp", f"{topic}: the stamp is zero or less, expected when measured"
            )
        self._heard = time.monotonic()
        newest = self._clock.newest
        found = self._clock.check(stamped, self._heard, topic)
        if found is Admission.STRAY:
            raise MessageError(
                "stray_stamp",
                f"{topic}: stamp {stamped:.3f} s where the streams are at {newest:.3f} s; "
                "set the clocks",
            )
        if found is not Admission.BELIEVED:
            self._move(found, newest, stamped, topic)
        return stamped

    def _move(self, found: Admission, newest: float, stamped: float, topic: str) -> None:
        """Count a clock that moved back, and tell those who keep what was before."""
        steps = found is Admission.STEPPED
        kind = "clock_stepped_back" if steps else "clock_restarted"
        self._node.faults.add(kind, f"{topic}: {found.value}, {newest:.3f} to {stamped:.3f} s")
        for forget in [*self.on_move, *([] if steps else self.on_restart)]:
            forget()
        for move in self.on_step if steps else []:
            move(newest - stamped)
