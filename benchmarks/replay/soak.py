"""Hours of live data at 100 Hz, replayed as fast as the nodes take them: does memory stay flat?"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.replay.motion import BODY, RATE_HZ, record_motion
from benchmarks.replay.observations import WRONG
from benchmarks.replay.player import DIAGNOSE, NODES, Player, replay
from benchmarks.replay.tape import Message, messages_of
from tactile_dynamics_ros.core.errors import TactileDynamicsError

CHUNK = 10.0
"""Recorded time that is made at once, s."""
SAMPLED = 5.0
"""Recorded time between two looks at the memory, s."""
MINUTE = 60.0
FLAT = 1.05
"""Mean memory of the last tenth over that of the second."""
PATIENCE = 120.0
"""The replay waits that long for the estimator's next word, s: a diagnosis may hold it up."""


@dataclass
class Diary:
    """What was seen on the way.

    Attributes:
        time: recorded, s. memory: MB by node at these times.
        calls, answers: of /model_check/diagnose.
        statuses, wrong: how many came, and how many were off by more than 4 std.
        worst: largest |estimate - truth| / std.
        drops: counts on /diagnostics at the end.
        samples: used by the estimator.
    """

    time: list[float] = field(default_factory=list)
    memory: dict[str, list[float]] = field(default_factory=dict)
    calls: int = 0
    answers: int = 0
    statuses: int = 0
    wrong: int = 0
    worst: float = 0.0
    samples: int = 0
    drops: dict[str, dict[str, float]] = field(default_factory=dict)


class Soak:
    """A replay without end, watched.

    Args:
        player: with running nodes.
        seconds: of recorded time.
        diagnose: whether to ask for a diagnosis each minute of it.
        quiet: whether nothing is printed on the way.
    """

    def __init__(self, player: Player, seconds: float, diagnose: bool, quiet: bool) -> None:
        self.player, self.seconds, self.diagnose, self.quiet = player, seconds, diagnose, quiet
        self.diary = Diary()
        self._next_look, self._next_minute = SAMPLED, MINUTE
        self._began = time.monotonic()

    def run(self, speed: float) -> None:
        """Replay all of it.

        Raises:
            TactileDynamicsError: a node ended.
        """
        self.player.patience = PATIENCE
        self.player.play(self._messages(), speed, self._watch)
        self.player.listen_until(time.monotonic() + 1.0)
        self._take_statuses()

    def _messages(self) -> Iterator[Message]:
        for start in np.arange(0.0, self.seconds, CHUNK).tolist():
            yield from messages_of(record_motion(start, min(start + CHUNK, self.seconds)))

    def _watch(self) -> None:
        """Look at the memory, and ask for a diagnosis, when it is time."""
        position = self.player.position
        if position >= self._next_look:
            self._next_look += SAMPLED
            self._look(position)
        if position >= self._next_minute:
            self._next_minute += MINUTE
            if self.diagnose:
                self._ask()
            if not self.quiet:
                self._show(position)

    def _look(self, position: float) -> None:
        if self.player.dead():
            name = self.player.dead()[0]
            words = self.player.supervisor.members[name].last_words()
            raise TactileDynamicsError(f"{name} ended after {position:.0f} s: {words}")
        self.diary.time.append(position)
        for name, used in self.player.memory().items():
            self.diary.memory.setdefault(name, []).append(used)
        self._take_statuses()

    def _take_statuses(self) -> None:
        heard = self.player.heard
        fresh = heard.statuses[1:] if self.diary.statuses else heard.statuses
        distances = [status.distance(BODY.values()) for status in fresh]
        self.diary.statuses += len(distances)
        self.diary.wrong += sum(distance > WRONG for distance in distances)
        self.diary.worst = max([self.diary.worst, *distances])
        if heard.statuses:
            self.diary.samples = heard.statuses[-1].samples
        for report in heard.reports:
            self.diary.drops[report.node] = report.counts
        heard.statuses, heard.reports, heard.errors = heard.statuses[-1:], [], heard.errors[-1:]

    def _ask(self) -> None:
        """Call for a diagnosis; the replay waits for the answer."""
        self.diary.calls += 1
        self.diary.answers += self.player.call(DIAGNOSE, 1, PATIENCE) != [None]

    def _show(self, position: float) -> None:
        used = ", ".join(f"{n} {m[-1]:.0f} MB" for n, m in self.diary.memory.items())
        pace = position / (time.monotonic() - self._began)
        print(f"{position / 60:5.0f} min ({pace:.1f} x): {used}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Replay, print memory by node; the exit code is 1 if it grows or a node ended."""
    options = _parse(arguments)
    with replay(NODES, logs=options.logs) as player:
        began, seconds, failure = time.monotonic(), 60 * options.minutes, ""
        soak = Soak(player, seconds, options.diagnose, options.json)
        try:
            soak.run(options.speed)
        except TactileDynamicsError as error:
            failure = str(error)
        result = summarise(soak.diary, seconds, time.monotonic() - began, failure)
    print(json.dumps(result) if options.json else table(result))
    return int(not result["ok"])


def growth(time: Sequence[float], used: Sequence[float]) -> tuple[float, float, float]:
    """Return the mean memory of the second and of the last tenth, MB, and their ratio."""
    moments, memory = np.asarray(time), np.asarray(used)
    end = moments[-1]
    second = memory[(moments > 0.1 * end) & (moments <= 0.2 * end)].mean()
    last = memory[moments > 0.9 * end].mean()
    return float(second), float(last), float(last / second)


def summarise(diary: Diary, seconds: float, wall: float, failure: str = "") -> dict[str, Any]:
    """Return what a soak has shown, ready for JSON.

    Args:
        diary: of the soak.
        seconds: recorded time that was to be replayed.
        wall: time that it took, s.
        failure: why it ended early, or "".
    """
    nodes = {}
    for name, used in diary.memory.items():
        second, last, ratio = growth(diary.time, used)
        nodes[name] = {"second_tenth_mb": second, "last_tenth_mb": last, "ratio": ratio}
    flat = bool(nodes) and all(node["ratio"] <= FLAT for node in nodes.values())
    return {
        "recorded_s": diary.time[-1] if diary.time else 0.0,
        "times_real_time": (diary.time[-1] if diary.time else 0.0) / wall,
        "nodes": nodes,
        "samples_used": diary.samples / (seconds * RATE_HZ),
        "statuses": diary.statuses,
        "wrong": diary.wrong,
        "worst_z": diary.worst,
        "diagnoses": {"called": diary.calls, "answered": diary.answers},
        "diagnostics": diary.drops,
        "series": {"time_s": diary.time, **diary.memory},
        "failure": failure,
        "ok": flat and not failure and diary.calls == diary.answers,
    }


def table(result: dict[str, Any]) -> str:
    """Return the result as lines of a table."""
    lines = [f"{'node':20s} {'2nd tenth':>10s} {'last tenth':>11s} {'ratio':>6s}"]
    for name, node in result["nodes"].items():
        lines.append(
            f"{name:20s} {node['second_tenth_mb']:7.1f} MB {node['last_tenth_mb']:8.1f} MB "
            f"{node['ratio']:6.3f} {'ok' if node['ratio'] <= FLAT else 'GROWS'}"
        )
    asked = result["diagnoses"]
    lines.append(
        f"{result['recorded_s'] / 60:.1f} min at {result['times_real_time']:.1f} times real time, "
        f"{100 * result['samples_used']:.1f} % of the samples used; {result['statuses']} updates, "
        f"{result['wrong']} off by more than 4 std (worst {result['worst_z']:.1f}); "
        f"{asked['answered']} of {asked['called']} diagnoses answered"
    )
    for node, counts in result["diagnostics"].items():
        if counts:
            lines.append(f"/diagnostics of {node}: {counts}")
    return "\n".join([*lines, result["failure"]] if result["failure"] else lines)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=120.0, help="of recorded time")
    parser.add_argument("--diagnose", action="store_true", help="a diagnosis each minute of it")
    parser.add_argument("--speed", type=float, default=float("inf"), help="at most, 1 is real time")
    parser.add_argument("--logs", type=Path, help="folder for the logs of the nodes")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
