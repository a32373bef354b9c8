"""What checks of held and of pushed objects answer alike: is it ready, and if not why."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.result import Result

if TYPE_CHECKING:
    from tactile_dynamics_ros.recording.rates import StreamRate

GOAL = 0.1
"""Standard deviation over the size of a parameter that is wanted if nothing else is said: inertia
to a tenth moves a controller's torques by as much. Less asks for more motion."""
_LOST = 0.05
"""Share of a stream's time in gaps from which that is a fault. Nothing is derived across a gap, so
that motion is lost with it; a twentieth costs as much of the recording."""


@dataclass(frozen=True, repr=False)
class Readiness(Result):
    """What is wrong with a recording, and what it does not determine.

    Attributes:
        rates: of its streams.
        faults: sentences on what makes estimates wrong.
        remarks: sentences on what else should be known.
        goal: standard deviation over size that is wanted.
    """

    rates: tuple[StreamRate, ...]
    faults: tuple[str, ...]
    remarks: tuple[str, ...]
    goal: float

    @property
    @abstractmethod
    def source(self) -> str:
        """Where the recording came from."""

    @property
    @abstractmethod
    def duration(self) -> float:
        """Length of the recording, s."""

    @property
    @abstractmethod
    def relative(self) -> dict[str, float]:
        """Standard deviation over size by parameter."""

    @property
    @abstractmethod
    def lacking(self) -> list[str]:
        """Parameters that are not known as well as wanted."""

    @abstractmethod
    def describe(self, name: str) -> str:
        """Return a parameter in words."""

    @abstractmethod
    def advice(self) -> list[str]:
        """Return what is not known, and what would determine it."""

    @property
    def ready(self) -> bool:
        """Whether nothing is wrong and everything is known as well as wanted."""
        return not self.faults and not self.lacking

    def to_json(self) -> dict[str, Any]:
        """Return what the documents of all checks have."""
        return {
            "ready": self.ready,
            "goal": self.goal,
            "duration_s": self.duration,
            "streams": [asdict(rate) for rate in self.rates],
            "faults": list(self.faults),
            "remarks": list(self.remarks),
            "advice": self.advice(),
        }

    def headline(self) -> str:
        """Return whether the recording is ready, and why not."""
        if self.ready:
            return f"{self.source}: ready, every parameter is known to {self.goal:.0%} or better"
        if self.faults:
            return f"{self.source}: not ready, {self.faults[0]}"
        names = ", ".join(self.describe(name) for name in self.lacking)
        return f"{self.source}: not ready, not known to {self.goal:.0%}: {names}"

    def lines(self) -> list[str]:
        """Return streams, faults, what is not known and what to record as well."""
        return [
            f"{self.source}: {self.duration:.1f} s",
            *(f"  {rate.words}" for rate in self.rates),
            *(f"fault: {fault}" for fault in self.faults),
            *(f"note: {remark}" for remark in self.remarks),
            *self.advice(),
            "ready" if self.ready else "not ready",
        ]


def lost_faults(rates: tuple[StreamRate, ...]) -> list[str]:
    """Return a sentence on each stream that lost too much of its time in gaps."""
    return [
        f"{rate.name}: {rate.lost_share:.0%} of the time is lost in {rate.gaps} gaps"
        for rate in rates
        if rate.lost_share > _LOST
    ]
