"""Stamps of streams that belong together: one clock, and the order in which samples were taken."""

from __future__ import annotations

import math
from bisect import bisect_left
from enum import Enum
from typing import Generic, TypeVar

Item = TypeVar("Item")

_TOLERANCE = 1.0
"""How far a stamp may be from the newest that is believed, s: latencies of the streams are less,
and a clock that restarts jumps by more. Twice as much would let clocks in that are 2 s off. At a
tenth the latency of a camera is taken for another clock."""
_PACE = 20.0
"""Recorded seconds that may pass per second of waiting: a pause of the streams is no jump, also
where a recording is replayed that much faster than real time. Lower takes fast replays for jumps of
the clock, higher believes stamps that are further ahead."""
_CONFIRMED = 10
"""Successive messages on another clock after which it is the clock: two frames of a hand with four
fingers. Single frames with a wrong stamp, and one finger that lives on another clock, never have so
many without a message of the others in between. Fewer let single wrong stamps move the clock, more
ignore a clock that did restart for longer."""


_BEHIND = 5
"""Successive messages of one topic behind the newest of that topic after which its clock has
stepped back: links that change the order do so among two or three. Fewer take such a link for a
clock; a step of fewer periods than this is not told from it, and costs as many samples."""


class Admission(Enum):
    """What a stamp is to the streams of one node."""

    BELIEVED = "believed"
    STRAY = "stray"
    STEPPED = "the clock stepped back"
    RESTARTED = "the clock was set back"


class SharedClock:
    """The newest time that the streams of one node agree on.

    A stamp near to it, or as much later as has been waited for, is believed. Others are strays,
    until so many of them follow each other that it is the clock that has moved. It has stepped back
    by less than a stamp may be late where one topic goes on behind what it has told itself.
    """

    def __init__(self) -> None:
        self.newest = -math.inf
        self._heard = -math.inf
        self._other, self._strays = math.nan, 0
        self._topics: dict[str, _Progress] = {}

    def check(self, time: float, now: float, topic: str = "") -> Admission:
        """Say whether a stamp is believed, and whether the clock has moved back.

        Args:
            time: stamp, s.
            now: when the message was taken, monotonic, s.
            topic: it came on.
        """
        waited = now - self._heard if math.isfinite(self._heard) else math.inf
        if -_TOLERANCE <= time - self.newest <= _TOLERANCE + _PACE * waited:
            if self._topics.setdefault(topic, _Progress()).steps_back(time):
                self._believe(time, now)
                self._topics.clear()
                return Admission.STEPPED
            self._believe(max(time, self.newest), now)
            return Admission.BELIEVED
        self._strays = self._strays + 1 if abs(time - self._other) <= _TOLERANCE else 1
        self._other = time
        if self._strays < _CONFIRMED:
            return Admission.STRAY
        back = time < self.newest
        self._believe(time, now)
        self._topics.clear()
        return Admission.RESTARTED if back else Admission.BELIEVED

    def _believe(self, newest: float, now: float) -> None:
        self.newest, self._heard, self._strays = newest, now, 0


class _Progress:
    """Stamps of one topic in the order in which they came."""

    def __init__(self) -> None:
        self._newest, self._last = -math.inf, -math.inf
        self._behind = 0

    def steps_back(self, time: float) -> bool:
        """Whether so many stamps in a row, each after the one before, are behind the newest."""
        if time >= self._newest:
            self._newest, self._behind = time, 0
        else:
            self._behind = self._behind + 1 if time > self._last else 1
        self._last = time
        return self._behind >= _BEHIND


class Reordered(Generic[Item]):
    """Items in the order of their stamps, held until late ones have had time to come.

    Args:
        capacity: items kept at most; the oldest are dropped beyond.

    Attributes:
        late: items that came after a newer one and were put in their place.
    """

    def __init__(self, capacity: int = 1000) -> None:
        self._capacity = capacity
        self.late = 0
        self.clear()

    def clear(self) -> None:
        """Forget all items and what has been taken."""
        self._times: list[float] = []
        self._items: list[Item] = []
        self._taken = -math.inf

    def add(self, time: float, item: Item) -> bool:
        """Hold an item; return False (and do not) if its stamp repeats or is passed already."""
        place = bisect_left(self._times, time)
        repeats = place < len(self._times) and self._times[place] == time
        if repeats or time <= self._taken:
            return False
        self.late += place < len(self._times)
        self._times.insert(place, time)
        self._items.insert(place, item)
        if len(self._times) > self._capacity:
            self._taken = self._times[0]
            del self._times[0], self._items[0]
        return True

    def take(self, until: float) -> list[tuple[float, Item]]:
        """Return the items up to a time (s), the oldest first, and hold them no longer."""
        count = bisect_left(self._times, math.nextafter(until, math.inf))
        if count == 0:
            return []
        taken = list(zip(self._times[:count], self._items[:count], strict=True))
        del self._times[:count], self._items[:count]
        self._taken = taken[-1][0]
        return taken
