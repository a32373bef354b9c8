"""When the simulated robot may go on, and when what is late is due."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from tactile_dynamics_ros.core.configuration import check_ranges, parameter

Item = TypeVar("Item")

CATCH_UP = 0.5
SLACK = 0.005


@dataclass(frozen=True)
class PaceConfig:
    """Pace and delays."""

    real_time_factor: float = parameter(1.0, "simulated over real time", "", 0.05, 20.0)
    touch_latency: float = parameter(0.005, "delay of raw counts behind their stamp", "s", 0, 1.0)
    vision_latency: float = parameter(0.02, "delay of poses and images", "s", 0.0, 1.0)
    command_latency: float = parameter(
        0.03, "delay of a command's execution behind its stamp", "s", 0.0, 1.0
    )
    command_lag: float = parameter(0.1, "the simulation waits for later commands", "s", 0.02)
    command_timeout: float = parameter(1.0, "real time after which it goes on", "s", 0.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class Pace:
    """Couples simulated time to real time, and to a controller that is at work.

    Args:
        config: factor and patience.
    """

    def __init__(self, config: PaceConfig) -> None:
        self._config = config
        self._start: float | None = None
        self._command = (0.0, -np.inf)
        self._measured = (time.monotonic(), 0.0)

    def must_wait(self, simulated: float) -> bool:
        """Whether simulated time (s) leads real time, or a working controller is late."""
        return self._ahead(simulated) > SLACK or self._controller_is_late(simulated)

    def note_command(self, stamp: float) -> None:
        """Note that a controller has answered to joint states of a simulated time, s."""
        self._command = (stamp, time.monotonic())

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
        late = simulated - stamp > self._config.command_lag
        return late and waited < self._config.command_timeout


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
