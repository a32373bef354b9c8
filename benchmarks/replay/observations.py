"""What the nodes said during a replay, and how far that is from the truth."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.ros.diagnostics import Statuses, status_values, to_number
from tactile_dynamics_ros.ros.statuses import read_inertia_status

WRONG = 4.0
"""Standard deviations beyond which an estimate is wrong: by chance once in 16 000 values."""
HELD = 1.0
"""An estimate counts until the next one, for this time of the replay at most, s."""
OK, ERROR = DiagnosticStatus.OK[0], DiagnosticStatus.ERROR[0]
LEVELS = {DiagnosticStatus.OK[0]: "OK", DiagnosticStatus.WARN[0]: "WARN", ERROR: "ERROR"}
_UNSHOWN = re.compile(r"not excited|directions identified")
_MEASURED = frozenset({"comparison_s", "latency", "frame_ms"})
"""Keys on /diagnostics that are measured and no faults."""


@dataclass(frozen=True)
class Status:
    """One message of /inertial_estimator/status.

    Attributes:
        at: time of the replay at which it was heard, s. stamp: of its header, s.
        level: of the parameters. text: of the parameters.
        value, std: (10,) in the order of PARAMETER_NAMES; NaN where not published.
        entries: all key-value pairs by name of the status.
    """

    at: float
    stamp: float
    level: int
    text: str
    value: Array
    std: Array
    entries: dict[str, dict[str, str]]

    @property
    def has_interval(self) -> bool:
        """Whether all ten parameters are published with a finite interval."""
        known = np.isfinite(self.value).all() and np.isfinite(self.std).all()
        return bool(known and (self.std > 0).all() and self.level != ERROR)

    def distance(self, truth: Array) -> float:
        """Return the largest |estimate - truth| / std of ten; 0 where nothing is claimed."""
        if not self.has_interval:
            return 0.0
        return float(np.max(np.abs(self.value - truth) / self.std))

    @property
    def renewed(self) -> bool:
        """Whether it is of a new estimate; others repeat one, or say what is awaited."""
        return float(self.entries.get("state", {}).get("age", math.nan)) == 0.0

    @property
    def samples(self) -> int:
        """Samples that the estimator has used."""
        return int(self.entries.get("solver", {}).get("samples", 0))


@dataclass(frozen=True)
class Report:
    """One status on /diagnostics: when, of which node, its text and its counts."""

    at: float
    node: str
    level: int
    text: str
    counts: dict[str, float]


@dataclass
class Observations:
    """All that was heard, the oldest first.

    Attributes:
        errors: (time of the replay, error) of /model_check/error.
    """

    statuses: list[Status] = field(default_factory=list)
    reports: list[Report] = field(default_factory=list)
    errors: list[tuple[float, float]] = field(default_factory=list)

    def during(self, start: float, stop: float) -> list[Status]:
        """Return the statuses heard with start <= time < stop, s."""
        return [s for s in self.statuses if start <= s.at < stop]

    def error_before(self, time: float) -> float:
        """Return the last model error heard before a time; NaN if there is none."""
        return next((e for at, e in reversed(self.errors) if at < time), math.nan)


def read_status(message: DiagnosticArray, at: float) -> Status:
    """Return a message of /inertial_estimator/status heard at a time of the replay, s."""
    said, read = read_inertia_status(message.status), Statuses(message.status)
    stamp = message.header.stamp
    return Status(
        at=at,
        stamp=stamp.sec + 1e-9 * stamp.nanosec,
        level=read.level("parameters") if "parameters" in read else ERROR,
        text=said.text,
        value=said.value,
        std=said.std,
        entries={status.name: status_values(status) for status in message.status},
    )


def read_reports(message: DiagnosticArray, at: float) -> Iterator[Report]:
    """Return the statuses of a message on /diagnostics."""
    for status in message.status:
        counts = {}
        for key, text in status_values(status).items():
            number = to_number(text)
            if key not in _MEASURED and math.isfinite(number):
                counts[key] = number
        yield Report(at, status.name.strip("/"), status.level[0], status.message, counts)


def wrong_time(statuses: Iterable[Status], truth: Array) -> tuple[float, float]:
    """Return the largest distance from the truth, and for how long (s) it was beyond `WRONG`.

    A status without an interval claims nothing. One with an interval counts until the next.
    """
    worst, wrong = 0.0, 0.0
    chain = list(statuses)
    for k, status in enumerate(chain):
        distance = status.distance(truth)
        worst = max(worst, distance)
        if distance > WRONG:
            lasted = chain[k + 1].at - status.at if k + 1 < len(chain) else HELD
            wrong += min(max(lasted, 0.0), HELD)
    return worst, wrong


def risen(reports: Iterable[Report], start: float, stop: float) -> set[str]:
    """Return "node/key" of the counts that rose on /diagnostics between two times, s."""
    before: dict[str, dict[str, float]] = {}
    found = set()
    for report in reports:
        earlier = before.get(report.node, {})
        if start <= report.at < stop:
            rose = (key for key, n in report.counts.items() if n > earlier.get(key, 0.0))
            found |= {f"{report.node}/{key}" for key in rose}
        before[report.node] = report.counts
    return found


def said_text(statuses: Iterable[Status]) -> set[str]:
    """Return the texts of statuses that are not OK, without numbers.

    What the motion has not shown yet is left out: that is no word about a fault.
    """
    texts = {part for s in statuses if s.level != OK for part in s.text.split("; ")}
    return {_wordless(text) for text in texts if text and not _UNSHOWN.search(text)}


def _wordless(text: str) -> str:
    """Return a text with digits replaced, so that it is the same sentence at every update."""
    return "".join("#" if c.isdigit() else c for c in text)
