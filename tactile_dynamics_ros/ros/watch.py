"""An error that stays too large is reported once, and what was measured then is kept."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError

_NAME = re.compile(r"\d{8}T\d{6}\.\d{3}Z")
_BAG, _DIAGNOSIS = "recording.mcap", "diagnosis.json"


def keep_and_diagnose(
    write: Callable[[Path], Any], diagnose: Callable[[], dict[str, Any]], folder: str, most: int
) -> dict[str, Any]:
    """Write a new recording in a folder, diagnose it, and drop the oldest recordings.

    Args:
        write: what was measured, to a path.
        diagnose: the same.
        folder: where recordings are kept; nothing is kept if empty.
        most: recordings that may be there.

    Returns:
        The diagnosis, with the path as "kept"; a sentence alone where there is none.

    Raises:
        BadInputError: the folder cannot be written.
    """
    place = _new_place(Path(folder)) if folder else None
    if place is not None:
        write(place / _BAG)
    try:
        document = diagnose()
    except TactileDynamicsError as error:
        if place is None:
            raise
        document = {"sentence": f"no diagnosis: {error}", "verdict": None}
    if place is None:
        return document
    document["kept"] = str(place)
    (place / _DIAGNOSIS).write_text(json.dumps(document) + "\n")
    drop_oldest(place.parent, most)
    return document


def drop_oldest(folder: Path, most: int) -> None:
    """Remove the oldest recordings beyond a number; what else is in the folder stays."""
    kept = sorted(path for path in folder.iterdir() if _NAME.fullmatch(path.name))
    for path in kept[: max(len(kept) - most, 0)]:
        if {each.name for each in path.iterdir()} <= {_BAG, _DIAGNOSIS}:
            shutil.rmtree(path)


def _new_place(folder: Path) -> Path:
    """Make a folder named after the time of the wall clock.

    Raises:
        BadInputError: it cannot be made.
    """
    now = datetime.now(UTC)
    place = folder / f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z"
    try:
        place.mkdir(parents=True)
    except OSError as error:
        raise BadInputError(f"{place} cannot be made: {error.strerror}") from error
    return place


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
