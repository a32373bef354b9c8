"""Hours of live data at 100 Hz with effects, diagnoses and restarts: does memory stay flat?"""

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
from rclpy.task import Future

from benchmarks.replay.motion import BODY, record_motion
from benchmarks.replay.observations import WRONG
from benchmarks.replay.player import DIAGNOSE, NODES, Player, replay
from benchmarks.replay.tape import Message, messages_of
from tactile_dynamics_ros.core.errors import TactileDynamicsError

CHUNK = 10.0
"""Recorded time that is made at once, s."""
SAMPLED = 5.0
"""Recorded time between two looks at the memory, s."""
MINUTE = 60.0
FLAT = 0.02
"""By how much of its usual memory may grow over the whole time, by the line through the cycles."""
FIRST = 0.1
"""Share of the time that comes before the line begins: caches fill, libraries are loaded."""
_ROUNDING = 1e-6
"""Share of a cycle by which its borders may be off: looks come every 5 s but for rounding. Of
more, a look falls into the next cycle, of less, rounding decides."""
FEWEST = 4
"""Cycles that the line goes through at least; of three points its std is hardly known."""
PATIENCE = 120.0
"""An answer counts as lost after that, s; so long the replay waits for the estimator's next word:
a diagnosis may hold it up."""
EFFECTS = ("force_bias", "viscous_drag", "contact_offset", "sensor_lag")
"""One is in the model during every second period: an error of sensors, a force, a place, a time."""


@dataclass
class Diary:
    """What was seen on the way.

    Attributes:
        time: recorded, s. memory: MB by node at these times.
        asked, answered: diagnoses and changes of the model, and how many were answered with yes.
        restarts: of nodes.
        statuses, wrong: how many came, and how many were off by more than 4 std.
        worst: largest |estimate - truth| / std.
        drops: counts on /diagnostics at the end.
    """

    time: list[float] = field(default_factory=list)
    memory: dict[str, list[float]] = field(default_factory=dict)
    asked: int = 0
    answered: int = 0
    restarts: int = 0
    statuses: int = 0
    wrong: int = 0
    worst: float = 0.0
    drops: dict[str, dict[str, float]] = field(default_factory=dict)


class Soak:
    """A replay without end, watched.

    Every period, an effect is set or dropped and a diagnosis is called; half a period later one of
    the nodes in turn is stopped and started again. The data go on meanwhile, but for a restart.

    Args:
        player: with running nodes.
        seconds: of recorded time.
        period: of these disturbances, s; infinite for none.
        quiet: whether nothing is printed on the way.
    """

    def __init__(self, player: Player, seconds: float, period: float, quiet: bool) -> None:
        self.player, self.seconds, self.period, self.quiet = player, seconds, period, quiet
        self.diary = Diary()
        self._next_look, self._next_minute = SAMPLED, MINUTE
        self._next_change, self._next_restart = 0.5 * period, period
        self._changes = 0
        self._pending: list[Future] = []
        self._began = time.monotonic()

    def run(self, speed: float) -> None:
        """Replay all of it.

        Raises:
            TactileDynamicsError: a node ended.
        """
        self.player.patience = PATIENCE
        self.player.play(self._messages(), speed, self._watch)
        self.player.listen_until(time.monotonic() + 1.0)
        self._settle()
        self._take_statuses()

    def _messages(self) -> Iterator[Message]:
        for start in np.arange(0.0, self.seconds, CHUNK).tolist():
            yield from messages_of(record_motion(start, min(start + CHUNK, self.seconds)))

    def _watch(self) -> None:
        """Look at the memory, and disturb the nodes, when it is time."""
        position = self.player.position
        if position >= self._next_look:
            self._next_look += SAMPLED
            self._look(position)
        if position >= self._next_change:
            self._next_change += self.period
            self._change()
        if position >= self._next_restart:
            self._next_restart += self.period
            self._restart()
        if position >= self._next_minute:
            self._next_minute += MINUTE
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
        for report in heard.reports:
            self.diary.drops[report.node] = report.counts
        heard.statuses, heard.reports, heard.errors = heard.statuses[-1:], [], heard.errors[-1:]

    def _change(self) -> None:
        """Set an effect or drop it, and call for a diagnosis."""
        number, odd = divmod(self._changes, 2)
        effects = [] if odd else [EFFECTS[number % len(EFFECTS)]]
        self._changes += 1
        estimator = "inertial_estimator"
        self._pending.append(self.player.set_parameter(estimator, "effects", effects))
        self._pending.append(self.player.request(DIAGNOSE))
        self.diary.asked += 2

    def _restart(self) -> None:
        """Stop a node that owes no answer and start it again."""
        self._settle()
        self.player.restart(NODES[self.diary.restarts % len(NODES)])
        self.diary.restarts += 1

    def _settle(self) -> None:
        """Count the answers that came; those that are still owed are waited for."""
        self.player.settle(self._pending, PATIENCE)
        self.diary.answered += sum(future.done() and _agrees(future) for future in self._pending)
        self._pending = []

    def _show(self, position: float) -> None:
        used = ", ".join(f"{n} {m[-1]:.0f} MB" for n, m in self.diary.memory.items())
        pace = position / (time.monotonic() - self._began)
        print(f"{position / 60:5.0f} min ({pace:.1f} x): {used}", file=sys.stderr, flush=True)


def _agrees(future: Future) -> bool:
    """Whether an answer says yes: to a Trigger, or to a change of parameters."""
    results = getattr(future.result(), "results", None)
    return all(r.successful for r in results) if results else bool(future.result().success)


def main(arguments: Sequence[str] | None = None) -> int:
    """Replay, print memory by node; the exit code is 1 if it grows or a node ended."""
    options = _parse(arguments)
    with replay(NODES, logs=options.logs) as player:
        began, seconds, failure = time.monotonic(), MINUTE * options.minutes, ""
        period = MINUTE * options.every if options.every else np.inf
        soak = Soak(player, seconds, period, options.json)
        try:
            soak.run(options.speed)
        except TactileDynamicsError as error:
            failure = str(error)
        result = summarise(soak.diary, 2 * period, time.monotonic() - began, failure)
    print(json.dumps(result) if options.json else table(result))
    return int(not result["ok"])


def growth(
    time: Sequence[float], used: Sequence[float], cycle: float
) -> tuple[float, float, float]:
    """Return usual memory, MB, and its growth over the whole time as a share of it, with its std.

    The growth is the slope of the line through the medians of whole cycles, by least squares; its
    std is from their scatter. Means would count how long fits take. The first tenth is left out.

    Args:
        time: of the looks, s.
        used: memory, MB.
        cycle: after which all nodes were disturbed alike, s.
    """
    moments, memory = np.asarray(time), np.asarray(used)
    end = float(moments[-1])
    cycle = min(cycle, (1.0 - FIRST) * end / FEWEST)
    start = cycle * np.ceil(FIRST * end / cycle - _ROUNDING)
    count = int((end - start) / cycle + _ROUNDING)
    number = np.ceil((moments - start) / cycle - _ROUNDING).astype(int) - 1
    usual = np.array([np.median(memory[number == n]) for n in range(count)])
    share = (np.arange(count) - 0.5 * (count - 1)) / count
    slope = float(share @ usual / (share @ share))
    rest = usual - usual.mean() - slope * share
    std = float(np.sqrt(rest @ rest / (count - 2) / (share @ share)))
    return float(usual.mean()), slope / usual.mean(), std / usual.mean()


def summarise(diary: Diary, cycle: float, wall: float, failure: str = "") -> dict[str, Any]:
    """Return what a soak has shown, ready for JSON.

    Args:
        diary: of the soak.
        cycle: after which all nodes were disturbed alike, s.
        wall: time that it took, s.
        failure: why it ended early, or "".
    """
    nodes = {}
    for name, used in diary.memory.items():
        usual, grown, std = growth(diary.time, used, cycle)
        nodes[name] = {"usual_mb": usual, "growth": grown, "growth_std": std}
    flat = bool(nodes) and all(node["growth"] <= FLAT for node in nodes.values())
    return {
        "recorded_s": diary.time[-1] if diary.time else 0.0,
        "times_real_time": (diary.time[-1] if diary.time else 0.0) / wall,
        "nodes": nodes,
        "statuses": diary.statuses,
        "wrong": diary.wrong,
        "worst_z": diary.worst,
        "answers": {"asked": diary.asked, "answered": diary.answered},
        "restarts": diary.restarts,
        "diagnostics": diary.drops,
        "series": {"time_s": diary.time, **diary.memory},
        "failure": failure,
        "ok": flat and not failure and diary.asked == diary.answered,
    }


def table(result: dict[str, Any]) -> str:
    """Return the result as lines of a table."""
    lines = [f"{'node':20s} {'usual':>10s} {'growth':>8s} {'std':>6s}"]
    for name, node in result["nodes"].items():
        lines.append(
            f"{name:20s} {node['usual_mb']:7.1f} MB {100 * node['growth']:6.2f} % "
            f"{100 * node['growth_std']:4.2f} % {'ok' if node['growth'] <= FLAT else 'GROWS'}"
        )
    answers = result["answers"]
    lines.append(
        f"{result['recorded_s'] / 60:.1f} min at {result['times_real_time']:.1f} times real time, "
        f"{result['restarts']} restarts; {result['statuses']} updates, "
        f"{result['wrong']} off by more than 4 std (worst {result['worst_z']:.1f}); "
        f"{answers['answered']} of {answers['asked']} diagnoses and changes answered"
    )
    for node, counts in result["diagnostics"].items():
        if counts:
            lines.append(f"/diagnostics of {node}: {counts}")
    return "\n".join([*lines, result["failure"]] if result["failure"] else lines)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=120.0, help="of recorded time")
    parser.add_argument(
        "--every", type=float, default=5.0, help="minutes between disturbances, 0 for none"
    )
    parser.add_argument("--speed", type=float, default=float("inf"), help="at most, 1 is real time")
    parser.add_argument("--logs", type=Path, help="folder for the logs of the nodes")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser.parse_args(arguments)
