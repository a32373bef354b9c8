"""An error that stays too large is reported once, and what was measured then is kept."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from tactile_dynamics_ros.core.configuration import check_ranges, parameter


@dataclass(frozen=True)
class WatchConfig:
    """When an error is reported, and what is kept of it."""

    threshold: float = parameter(0.0, "error that is reported, over the noise; 0: none", "", 0.0)
    hold: float = parameter(5.0, "time that the error stays above it until then", "s", 0.0, 600.0)
    span: float = parameter(30.0, "last seconds that are kept, and diagnosed", "s", 5.0, 300.0)
    folder: str = parameter("", "where recordings are kept; empty: nowhere")
    most: int = parameter(10, "recordings that are kept; the oldest goes first", "", 1, 10000)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


class Event(Enum):
    """What is to be done."""

    REPORT = "report"
    KEEP = "keep"


@dataclass
class Watch:
    """Follows an error: reports it once it has stayed above the threshold, then keeps the data.

    Data are kept when all `span` seconds are of the time since the error rose, so that a diagnosis
    finds nothing else in them, or as soon as the error is small again or nothing is measured. Only
    a small error ends a rise: silence tells nothing, a stream that pauses is not reported again.

    Attributes:
        config: threshold and times.
        risen: s, when the error rose; None while it is small.
        newest: s, time of the newest error.
        reported: whether this rise was reported.
        kept: whether this rise was kept.
    """

    config: WatchConfig
    risen: float | None = None
    newest: float = -math.inf
    reported: bool = False
    kept: bool = False

    def update(self, time: float, error: float) -> list[Event]:
        """Take the error at a time, s, and say what is to be done now."""
        if not self.config.threshold:
            return []
        before, self.newest = self.newest, time
        if time < before:
            self._forget()  # the clock was set back, what was measured is gone
        if error < self.config.threshold:
            left = self.pause()
            self._forget()
            return left
        left_behind = not self.reported and time - before > self.config.span
        if self.risen is None or left_behind:
            self.risen = time
        return self._of_large(time - self.risen)

    def pause(self) -> list[Event]:
        """Say what is left to do as nothing is measured for now."""
        if not self.reported or self.kept:
            return []
        self.kept = True
        return [Event.KEEP]

    def _forget(self) -> None:
        """Begin anew."""
        self.risen, self.reported, self.kept = None, False, False

    def _of_large(self, lasted: float) -> list[Event]:
        """Return what is to be done about an error that has been large for a time, s."""
        events = []
        if lasted >= self.config.hold and not self.reported:
            self.reported = True
            events.append(Event.REPORT)
        if lasted >= self.config.span and not self.kept:
            self.kept = True
            events.append(Event.KEEP)
        return events
