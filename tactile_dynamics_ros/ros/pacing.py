"""When the simulated robot may go on, and when what is late is due."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.ros.conversions import to_seconds

Item = TypeVar("Item")

CATCH_UP = 0.5
"""Real time by which the simulation may fall behind before the lag is forgiven, s: what a busy
machine loses in a moment is caught up, what it loses all the time is not chased for ever."""
SLACK = 0.005
"""Real time by which the simulation may lead, s: half a period of 100 Hz."""
PAUSE = 0.5
"""Simulated time without a command that ends a motion, s: between motions a tip rests, and the
first command of the next one may come when it likes. Controllers that answer poses of 100 Hz miss
0.1 s at times."""
BEHIND = 2.0
"""Simulated time by which estimates may be behind before the simulation waits for them, s: queues
of sensor data hold five seconds, and beyond that estimators would miss some."""
GONE = 2.0
"""Real time without an estimate after which none is waited for, s: the estimator has ended. Nodes
that push give up when they hear nothing of the arm for 5 s."""
_ROUNDING = 1e-6
"""Slack of comparisons of simulated times, s."""


@dataclass(frozen=True)
class PaceConfig:
    """Pace and delays."""

    real_time_factor: float = parameter(1.0, "simulated over real time", "", 0.05, 20.0)
    touch_latency: float = parameter(0.005, "delay of raw counts behind their stamp", "s", 0, 1.0)
    vision_latency: float = parameter(0.02, "delay of poses and images", "s", 0.0, 1.0)
    command_latency: float = parameter(
        0.03, "delay of a command's execution behind its stamp", "s", 0.0, 1.0
    )
    command_lag: float = parameter(
        0.1, "longest period of commands for which the simulation waits", "s", 0.02
    )
    command_timeout: float = parameter(1.0, "real time after which it goes on", "s", 0.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class Pace:
    """Couples simulated time to real time, and to a controller that is at work.

    A command of the stamp t is executed at t + command_latency. Before the simulation passes the
    time at which the next one is to be executed, it waits for that command: how fast a controller
    answers then changes how long a run takes, and not what happens in it.

    Args:
        config: factor and patience.

    Attributes:
        late: how often a command of a motion was waited for in vain.
    """

    def __init__(self, config: PaceConfig) -> None:
        self._config = config
        self._start: float | None = None
        self._command, self._period = (0.0, -np.inf), 0.0
        self._estimate = (0.0, -np.inf)
        self.late = 0
        self._measured = (time.monotonic(), 0.0)

    def must_wait(self, simulated: float) -> bool:
        """Whether simulated time (s) leads real time, a working controller or an estimator."""
        ahead = self._ahead(simulated) > SLACK
        return ahead or self._controller_is_late(simulated) or self._is_unheard(simulated)

    def note_estimate(self, message: DiagnosticArray) -> None:
        """Note an estimator's status, whose stamp says up to when it has heard everything.

        One that is repeated because nothing new is measured is nothing to wait for.
        """
        stamp = to_seconds(message.header.stamp)
        if stamp > self._estimate[0]:
            self._estimate = (stamp, time.monotonic())

    def note_command(self, stamp: float, simulated: float) -> None:
        """Note a command and its stamp, s.

        Args:
            stamp: simulated time to which a controller has answered, s; 0 ends its motion.
            simulated: time now, s.
        """
        if stamp <= 0.0:
            self._command = (0.0, -np.inf)
            return
        since = stamp - self._command[0]
        self._period = since if 0.0 < since <= self._config.command_lag else self._period
        overdue = simulated - stamp > self._config.command_latency + _ROUNDING
        in_vain = time.monotonic() - self._command[1] >= self._config.command_timeout
        self.late += overdue and in_vain and since < PAUSE
        self._command = (stamp, time.monotonic())

    def counts(self) -> dict[str, int]:
        """Return what went wrong so far, by its name."""
        return {"late_commands": self.late}

    def measure(self, simulated: float) -> float:
        """Return simulated over real time since the last call."""
        before, then = self._measured
        self._measured = (time.monotonic(), simulated)
        return (simulated - then) / (self._measured[0] - before)

    def _ahead(self, simulated: float) -> float:
        """Return by how much simulated time leads; a large lag is forgiven."""
        now, real = time.monotonic(), simulated / self._config.real_time_factor
        if self._start is None or now - self._start - real > CATCH_UP:
            self._start = now - real
        return real - (now - self._start)

    def _controller_is_late(self, simulated: float) -> bool:
        stamp, came = self._command
        waited = time.monotonic() - came
        next_due = stamp + self._period + self._config.command_latency
        late = simulated > next_due - _ROUNDING
        return late and waited < self._config.command_timeout

    def _is_unheard(self, simulated: float) -> bool:
        stamp, came = self._estimate
        return simulated - stamp > BEHIND and time.monotonic() - came < GONE


class DelayLine(Generic[Item]):
    """Items that are due some simulated time after they came."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, Item]] = []

    def add(self, due: float, item: Item) -> None:
        """Keep an item until a simulated time, s."""
        self._waiting.append((due, item))

    def take(self, now: float) -> list[Item]:
        """Return what is due at a simulated time (s), in the order in which it came."""
        due = [item for time, item in self._waiting if time <= now + 1e-9]
        self._waiting = [entry for entry in self._waiting if entry[0] > now + 1e-9]
        return due
