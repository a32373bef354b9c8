"""Ends nodes by one SIGINT or SIGTERM in six states: how long that takes, and what is left."""

from __future__ import annotations

import argparse
import itertools
import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import psutil
from rclpy.client import Client
from std_srvs.srv import Trigger

from benchmarks.replay.motion import record_motion
from benchmarks.replay.player import Player
from benchmarks.replay.tape import Message, messages_of
from tactile_dynamics_ros.cli.bringup import node_names
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.supervisor import Member, node_command
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.ros.names import DIAGNOSE, EXPLORE

LIMIT = 3.0
"""Real time within which a node has to have ended, s, and all processes that it started."""
PATIENCE = 240.0
"""Real time within which nodes have to be in the state in which they are stopped, s: four at once
load their libraries for ten seconds of processor time."""
AT_ONCE = 4
"""Nodes that run at the same time: as many as two cores can serve while each computes."""
CHUNK = 10.0
"""Recorded motion that is made at once, s."""
TABLE = {"scene": "table", "object_number": 121, "vision_rate_hz": 100.0}
HELD = ("inertial_estimator", "model_check")


@dataclass
class Stop:
    """How one process ended.

    Attributes:
        state: in which it was. node: that was stopped. by: name of the signal.
        seconds: from the signal to its end. gone: to the end of all processes that it had started.
        exit: code; negative for a signal that killed it. written: whether its file is there; None
        if it has none. load: of the machine, processes that want to run. said: end of a traceback.
    """

    state: str
    node: str
    by: str
    seconds: float
    gone: float
    exit: int | None
    written: bool | None
    load: float
    said: str = ""

    @property
    def ok(self) -> bool:
        """Whether it ended as it has to."""
        in_time = max(self.seconds, self.gone) <= LIMIT
        return in_time and self.exit == 0 and self.written is not False and not self.said


class Bench:
    """A player of recordings whose nodes are stopped one after the other.

    Args:
        player: that sends and hears.
        folder: for the files of the nodes.
        state: that is reported.
    """

    def __init__(self, player: Player, folder: Path, state: str) -> None:
        self.player, self.folder, self.state = player, folder, state
        self._signals = itertools.cycle((signal.SIGINT, signal.SIGTERM))

    def start(
        self, node: str, number: int = 0, *remaps: str, **parameters: object
    ) -> tuple[str, Member]:
        """Start a node; return its name and process."""
        words = node_command(node, None, parameters)
        words += [word for remap in remaps for word in ("-r", remap)]
        return node, self.player.supervisor.start(f"{node}_{number}", words)

    def listening(self, topic: str, count: int) -> None:
        """Wait until so many nodes listen to a topic."""
        node = self.player.node
        self.wait(lambda: node.count_subscribers(topic) >= count, f"listeners of {topic}")

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for a condition."""
        self.player.wait(condition, PATIENCE, what)

    def stop(self, node: str, member: Member, file: Path | None = None) -> Stop:
        """Send one signal, and watch the process and what it started."""
        assert member.process is not None
        process = psutil.Process(member.process.pid)
        family = process.children(recursive=True)
        number, load = next(self._signals), os.getloadavg()[0]
        if file is not None:
            file.unlink(missing_ok=True)
        began = time.monotonic()
        member.process.send_signal(number)
        code = _end(member.process)
        seconds = time.monotonic() - began
        psutil.wait_procs(family, timeout=LIMIT)
        gone = time.monotonic() - began
        self.player.supervisor.members.pop(member.name)
        said = [line for line in member.last_words(100).splitlines() if "Error" in line]
        written = None if file is None else file.exists()
        return Stop(
            self.state, node, number.name, seconds, gone, code, written, load, "; ".join(said)
        )


def _end(process: subprocess.Popen[bytes]) -> int | None:
    """Return the exit code of a process that was asked to stop; None if it had to be killed."""
    try:
        return process.wait(4.0 * LIMIT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return None


def computes(member: Member) -> bool:
    """Whether a node computes in the background: its worker has a child for each job."""
    assert member.process is not None
    family = psutil.Process(member.process.pid).children(recursive=True)
    return len(family) > 1


def waiting(bench: Bench, numbers: range) -> Iterator[Stop]:
    """Nodes that nobody sends anything to."""
    started = [bench.start(_taken(node_names(), number), number) for number in numbers]
    names = {f"/{node}" for node, _ in started}

    def found() -> bool:
        return names <= {f"/{name}" for name in bench.player.node.get_node_names()}

    bench.wait(found, "nodes to come up")
    yield from (bench.stop(*one) for one in started)


def holding(bench: Bench, numbers: range) -> Iterator[Stop]:
    """Nodes that hear what is measured of a held object."""
    yield from _held(bench, numbers, {})


def fitting(bench: Bench, numbers: range) -> Iterator[Stop]:
    """The same with an effect, which is fitted in the background."""
    yield from _held(bench, numbers, {"effects": "[viscous_drag]"})


def _held(bench: Bench, numbers: range, model: Mapping[str, object]) -> Iterator[Stop]:
    kinds = HELD if not model else HELD[:1]
    started, files = [], []
    for number in numbers:
        node = _taken(kinds, number)
        estimates = node == "inertial_estimator"
        files.append(bench.folder / f"object_{number}.yaml" if estimates else None)
        given = {**model, "save": str(files[-1])} if estimates else {"period": 0.5}
        started.append(bench.start(node, number, **given))
    bench.listening("/object/pose", len(numbers))
    with _played(bench):
        _until(lambda: all(file is None or file.exists() for file in files), "files of the object")
        for one, file in zip(started, files, strict=True):
            if model:
                _until(lambda member=one[1]: computes(member), "a fit")
            yield bench.stop(*one, file=file)


def diagnosing(bench: Bench, numbers: range) -> Iterator[Stop]:
    """A node that has not answered a call yet, because it computes the answer."""
    started = [
        bench.start("model_check", k, f"/{DIAGNOSE}:=/check_{k}/diagnose", period=600.0)
        for k in numbers
    ]
    bench.listening("/object/pose", len(numbers))
    bench.player.play(_motion(until=8.0))
    for number, one in zip(numbers, started, strict=True):
        client = bench.player.node.create_client(Trigger, f"/check_{number}/diagnose")
        bench.wait(client.service_is_ready, "the service")
        answer = client.call_async(Trigger.Request())
        bench.wait(lambda member=one[1]: computes(member), "a diagnosis")
        stop = bench.stop(*one)
        stop.said += "answered before the stop" if answer.done() else ""
        yield stop


def moving(bench: Bench, numbers: range) -> Iterator[Stop]:
    """The explorer on a simulated table, in turn while it chooses a push and while it makes one."""
    table = bench.start("robot_sim", 0, **TABLE)
    client = bench.player.node.create_client(Trigger, f"/{EXPLORE}")
    for number in numbers[1:]:
        explorer = bench.start("explorer", number, use_sim_time=True)
        _explore(bench, client, explorer[1])
        if number % 2:
            bench.wait(lambda member=explorer[1]: not computes(member), "a push")
            bench.player.listen_until(time.monotonic() + 1.0)
        yield bench.stop(*explorer)
    yield bench.stop(*table)


def _explore(bench: Bench, client: Client, member: Member) -> None:
    """Call the explorer, again while it refuses, until it chooses a push."""
    bench.wait(client.service_is_ready, "the explorer")
    answer = client.call_async(Trigger.Request())

    def chooses() -> bool:
        nonlocal answer
        if answer.done():
            answer = client.call_async(Trigger.Request())
        return computes(member)

    bench.wait(chooses, "a choice")


def starting(bench: Bench, numbers: range) -> Iterator[Stop]:
    """Nodes that still load their libraries, or make their publishers."""
    for number in numbers:
        started = bench.start(_taken(node_names(), number), number)
        time.sleep(0.2 * number)
        yield bench.stop(*started)


STATES: dict[str, Callable[[Bench, range], Iterator[Stop]]] = {
    state.__name__: state for state in (waiting, holding, fitting, diagnosing, moving, starting)
}


def run_state(state: str, count: int, folder: Path) -> list[Stop]:
    """Stop so many nodes in a state.

    Args:
        state: one of `STATES`.
        count: of stops.
        folder: for logs and files.
    """
    found: list[Stop] = []
    folder.mkdir(parents=True, exist_ok=True)
    for first in range(0, count, AT_ONCE):
        numbers = range(first, min(first + AT_ONCE, count))
        with Player(nodes=(), logs=folder / f"logs_{first}") as player:
            found += STATES[state](Bench(player, folder, state), numbers)
    return found


def _taken(names: Sequence[str], number: int) -> str:
    """Return a name by its number, beginning anew after the last."""
    return names[number % len(names)]


def _until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise TactileDynamicsError(f"{what}: not within {PATIENCE:g} s")
        time.sleep(0.02)


@contextmanager
def _played(bench: Bench) -> Iterator[None]:
    """Play a motion without end beside what is done here."""
    done = Event()
    messages = itertools.takewhile(lambda _: not done.is_set(), _motion())
    thread = Thread(target=bench.player.play, args=(messages,))
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def _motion(until: float = np.inf) -> Iterator[Message]:
    for start in itertools.takewhile(lambda t: t < until, itertools.count(0.0, CHUNK)):
        yield from messages_of(record_motion(start, min(start + CHUNK, until)))


def main() -> int:
    """Stop nodes in the states asked for, print a table; return 1 unless all ended as they must."""
    options = _parse()
    rows: list[Stop] = []
    for state in options.states:
        with tempfile.TemporaryDirectory() as folder, private_domain():
            found = run_state(state, options.count, Path(folder))
        rows += found
        if not options.json:
            print(describe(state, found), flush=True)
    if options.json:
        print(json.dumps([{**asdict(row), "ok": row.ok} for row in rows]))
    return 0 if all(row.ok for row in rows) else 1


def describe(state: str, rows: list[Stop]) -> str:
    """Return a line on all stops in a state, and one for each that went wrong."""
    seconds = np.array([row.seconds for row in rows])
    left = max(row.gone for row in rows)
    files = [row.written for row in rows if row.written is not None]
    lines = [
        f"{state:10s} {len(rows):3d} stops: {sum(row.ok for row in rows)} as they must, "
        f"{np.median(seconds):.2f} s (largest {seconds.max():.2f} s, with all their processes "
        f"{left:.2f} s), files {sum(files)} of {len(files)}, load {rows[0].load:.0f}"
    ]
    wrong: list[dict[str, Any]] = [asdict(row) for row in rows if not row.ok]
    return "\n".join([*lines, *(f"    {row}" for row in wrong)])


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", nargs="+", choices=STATES, default=[*STATES], metavar="STATE")
    parser.add_argument("--count", type=int, default=10, help="stops in each state (default 10)")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser.parse_args()
