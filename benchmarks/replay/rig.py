"""Nodes on a clean replay, one fault at a time, and what each fault did to them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.replay.motion import BODY, RATE_HZ, record_motion
from benchmarks.replay.observations import LEVELS, OK, WRONG, risen, said_text, wrong_time
from benchmarks.replay.player import DIAGNOSE, NODES, RESET, Answer, Player
from benchmarks.replay.stream_faults import RIVAL, StreamFault
from benchmarks.replay.tape import Message, messages_of

TRUTH = BODY.values()
PACE = 2.0
"""Speed of the motion: all ten parameters show within 5 s, so that 10 s after a fault that cost all
data everything can be as before. At 1.6, some stretches take 12 s."""
RECOVERY = 10.0
"""After the fault's end all must be as before within this time, s."""
PATIENCE = 40.0
"""Clean replay within which the nodes must be well, s."""
NAMED = 2.0
"""Within this time of its start a fault must be named by a count or a sentence, s."""
BRIEF = 1.0
"""For this long an estimate may be wrong, s."""
MODEL_ERROR = 1.1
"""The model's error may be that much higher than before the fault: its scatter over 10 s is 2 %."""
MODEL_PATIENCE = 25.0
"""Time after the recovery until that must be so, s: the window of the error and two comparisons."""
LAST_WORDS = 0.7
"""Wall time in which the nodes finish what they have, s: a gathering, an update and a bit."""
ENOUGH = 0.99
"""Share of samples that counts as all: a window is lost where the fault begins and ends."""


@dataclass
class Row:
    """What one fault did.

    Attributes:
        name: of the fault.
        died: nodes that ended.
        said: counts that rose and texts that appeared.
        named: time from the start of the fault to the first of them, s; None if there is none.
        worst: largest |estimate - truth| / std of an interval published during and after.
        wrong_s: time for which it was beyond 4, s.
        withheld: share of the updates during the fault that had no interval.
        samples: share of the samples that the estimator used, from the start to the end.
        after: distance from the truth at the end; None if no interval is published there.
        level: at the end.
        error: of the model, at the end.
        std: (10,) published at the end.
        note: anything else.
        failures: why it is not as it must be.
    """

    name: str
    died: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    named: float | None = None
    worst: float = 0.0
    wrong_s: float = 0.0
    withheld: float = 0.0
    samples: float = 0.0
    after: float | None = None
    level: str = ""
    error: float = float("nan")
    std: list[float] = field(default_factory=list)
    note: str = ""
    failures: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """Return all fields."""
        return {**vars(self), "ok": not self.failures}


@dataclass
class Rig:
    """A player and where its endless recording is.

    Attributes:
        player: with running nodes.
        speed: of the replay.
        lead: clean replay before each fault, s.
        seconds: how long a fault lasts.
        fresh: whether the estimator forgets everything before each fault.
        recovery: clean data after a fault at least, s; up to `RECOVERY` until the nodes are well.
        now: time of the replay from which the next messages are.
    """

    player: Player
    speed: float = 1.0
    lead: float = 15.0
    seconds: float = 5.0
    fresh: bool = True
    recovery: float = RECOVERY
    now: float = 0.0

    def run(self, fault: StreamFault) -> Row:
        """Replay clean data, a fault and clean data; return what came of it."""
        for node in NODES if fault.anew else ():
            self.player.restart(node)
        begun = self.prepare(self.lead, forget=fault.whole)
        start = self.now
        stop = start + self.seconds + (self.lead if fault.whole else 0.0)
        messages = self.record(stop + self.recovery - start)
        self.play(fault.inject(messages, start, stop), begin=start)
        self.player.dismiss(RIVAL)
        self.player.epoch_ns += fault.shift_ns
        self._recover(stop)
        row = self.judge(fault.name, begun, start, stop)
        self._require(row, fault)
        if self.fresh and not row.died and not fault.whole:
            self._question_model_check(row, fault, start)
        return row

    def recover(self) -> None:
        """Replay clean data until the nodes are well, for as long as they may take for it."""
        begun = self.now
        self.play(self.record(self.recovery))
        self._recover(begun)

    def _recover(self, stop: float) -> None:
        while self.now < stop + RECOVERY - 1e-6 and not self.is_well() and not self.player.dead():
            self.play(self.record(min(2.0, stop + RECOVERY - self.now)))

    def _question_model_check(self, row: Row, fault: StreamFault, start: float) -> None:
        """Note if the model's error stays high, or if a diagnosis finds what is not there.

        The error is that of the last 10 s, and a comparison rests after it was made: clean data go
        on until it has left the fault behind.
        """
        end = self.now
        usual = self.player.heard.error_before(start)
        usual = usual if np.isfinite(usual) else 1.0
        while self.player.heard.error_before(self.now + 1.0) > MODEL_ERROR * usual:
            if self.now > end + MODEL_PATIENCE or self.player.dead():
                row.failures.append("model error stays high")
                break
            self.play(self.record(3.0))
        row.error = self.player.heard.error_before(self.now + 1.0)
        if fault.forgotten:
            [answer] = self.player.call(DIAGNOSE)
            verdict = verdict_of(answer)
            row.note = f"diagnosis: {verdict}"
            if verdict != "adequate":
                row.failures.append(f"diagnosed {verdict}")

    def prepare(self, lead: float, forget: bool = False) -> float:
        """Bring the nodes into a good state on clean data; return when that began, s.

        Args:
            lead: clean replay, s.
            forget: leave the estimator without data instead.
        """
        self.player.restart_dead()
        begun = self.now
        if forget or self.fresh or not self.is_well():
            self.player.call(RESET)
            begun = self.now
        if forget:
            return begun
        if self.fresh or not self.is_well():
            self.play(self.record(lead))
        while not self.is_well() and self.now - begun < PATIENCE:
            self.play(self.record(2.0))
            if self.player.dead():
                break
        return begun

    def is_well(self) -> bool:
        """Whether all nodes live and the newest estimate is fresh, sure and right."""
        last = self.player.heard.statuses[-1:]
        return (
            not self.player.dead()
            and bool(last)
            and last[0].at > self.now - 2.0
            and last[0].level == OK
            and last[0].has_interval
            and last[0].distance(TRUTH) <= WRONG
        )

    def record(self, seconds: float) -> list[Message]:
        """Return the messages of the next seconds of the motion."""
        start, self.now = self.now, self.now + seconds
        return messages_of(record_motion(start, self.now, pace=PACE))

    def play(
        self,
        messages: list[Message],
        tick: Callable[[], None] | None = None,
        begin: float | None = None,
    ) -> None:
        """Send messages, and let the nodes finish."""
        self.player.play(messages, self.speed, tick, begin)
        self.player.listen_until(time.monotonic() + LAST_WORDS)

    def judge(self, name: str, begun: float, start: float, stop: float) -> Row:
        """Return what a fault did.

        Args:
            name: of the fault.
            begun: s, from when on the data were clean.
            start: s, of the fault.
            stop: s, of the fault.
        """
        heard, end = self.player.heard, self.now + 1e-6
        lead, during, all_of_it = (
            heard.during(a, b) for a, b in ((begun, start), (start, stop), (start, end))
        )
        usual = risen(heard.reports, begun, start) | said_text(lead)
        said = risen(heard.reports, start, end) | said_text(all_of_it)
        worst, wrong = wrong_time(all_of_it, TRUTH)
        last = next((s for s in reversed(all_of_it) if s.at > end - 1.0 - self.speed), None)
        known = last is not None and last.has_interval
        return Row(
            name=name,
            died=self.player.dead(),
            said=sorted(said - usual),
            named=self._first_word(usual, start, end),
            worst=worst,
            wrong_s=wrong,
            withheld=1.0 - float(np.mean([s.has_interval for s in during])) if during else 1.0,
            samples=self._share_of_samples(start, end),
            after=last.distance(TRUTH) if last is not None and known else None,
            level=LEVELS.get(last.level, "?") if last else "silent",
            error=heard.error_before(end),
            std=last.std.tolist() if last else [],
        )

    def _first_word(self, usual: set[str], start: float, end: float) -> float | None:
        """Return after how many seconds something unusual was said; None if nothing was."""
        heard = self.player.heard
        for until in np.arange(start, end, 0.1) + 0.1:
            said = risen(heard.reports, start, until) | said_text(heard.during(start, until))
            if said - usual:
                return float(until - start)
        return None

    def _share_of_samples(self, start: float, end: float) -> float:
        """Return samples used over samples sent, or 0 where the estimator began anew."""
        statuses = self.player.heard.during(start, end)
        if len(statuses) < 2:
            return 0.0
        first, last = statuses[0], statuses[-1]
        sent = RATE_HZ * (last.stamp - first.stamp)
        return max(last.samples - first.samples, 0) / sent if sent > 0 else 0.0

    def _require(self, row: Row, fault: StreamFault) -> None:
        """Note what is not as it must be."""
        if row.died:
            row.failures.append(f"died: {', '.join(row.died)}")
        if not row.said and not (fault.lossless and row.samples > ENOUGH):
            row.failures.append("nothing said")
        if row.named is not None and row.named > NAMED and not fault.lossless:
            row.failures.append(f"named after {row.named:.1f} s")
        if fault.withheld and row.withheld < ENOUGH - BRIEF / self.seconds:
            row.failures.append("published all the same")
        if row.wrong_s > BRIEF:
            row.failures.append(f"wrong for {row.wrong_s:.1f} s")
        if not fault.whole:
            require_recovery(row)


def verdict_of(answer: Answer | None) -> str:
    """Return the verdict of a diagnosis, or why there is none."""
    if answer is None:
        return "no answer"
    try:
        document = json.loads(answer.message)
    except ValueError:
        return answer.message
    return str(document["effect"] or document["verdict"])


def require_recovery(row: Row) -> None:
    """Note if the estimate is not again right, sure and published."""
    if row.after is None:
        row.failures.append("no interval 10 s after")
    elif row.after > WRONG:
        row.failures.append("wrong 10 s after")
    if row.level != "OK":
        row.failures.append(f"level {row.level} 10 s after")
