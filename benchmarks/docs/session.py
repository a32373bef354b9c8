"""Follows a page from top to bottom in a folder of its own, as a reader with two terminals does."""

from __future__ import annotations

import ast
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.docs import reader, rules
from benchmarks.docs.pages import INLINE, ROOT, SHELLS, Block, blocks, commands

ANSWERS = (0, 3)
"""Exit codes of a command that works: done, and an answer that names what is not known. Running
nodes have to give the answer itself: before anything is held a probe ends with 3."""
LIMIT_S = 600.0
"""A command that is neither long nor endless ends within this time, s, on a loaded machine."""
WAIT_S = 240.0
"""Time in which running nodes can answer, s: a simulated hand grasps and lifts in one to two
minutes where twelve nodes share two cores."""
SERVES_S = 60.0
"""Time in which an endless command prints its first line, s."""
QUIET_S = 20.0
"""Time after which a node that prints nothing is taken to serve, s: start of Python on a loaded
machine."""
STOP_S = 60.0
"""Time in which a command ends after Ctrl-C, s: the stop of all nodes on a loaded machine."""
ROBOTS = {
    "hand": (
        "tactile-dynamics up --simulate",
        "tactile-dynamics call /grasp_controller/start",
        "tactile-dynamics echo /inertial_estimator/inertia --count 1",
    ),
    "table": ("tactile-dynamics up --config config/planar_pusher.yaml --simulate",),
}
"""What runs where a page speaks to a robot that it does not start."""
_VARIANT = re.compile(r"torque_unit|z<0\.6|--remap \S+|--namespace \w+|static-poses|--guess|wrist")
"""Words by which a reader's file of the same name differs."""
_OF_TABLES = re.compile(r"push|explore|property_estimator|shape|/pusher")
_KILLED = -9


@dataclass
class Outcome:
    """What became of a command.

    Attributes:
        page: relative to the source tree.
        line: on the page.
        command: as typed; the first line of a Python block.
        exit: its code; None if it was not run.
        seconds: it took.
        note: why it was not run, or what is wrong.
        output: what it printed, if something is wrong.
    """

    page: str
    line: int
    command: str
    exit: int | None = None
    seconds: float = 0.0
    note: str = ""
    output: str = ""

    @property
    def failed(self) -> bool:
        """Whether the page is wrong."""
        works = (0,) if rules.needs_nodes(self.command) else ANSWERS
        return bool(self.output) or (self.exit is not None and self.exit not in works)


@dataclass
class Running:
    """A process in a session of its own, as a terminal starts it.

    Attributes:
        outcome: that its end completes.
        process: of the shell that became the command.
        log: file of what it prints.
        since: s, when it was started.
    """

    outcome: Outcome
    process: subprocess.Popen[bytes]
    log: Path
    since: float = field(default_factory=time.monotonic)

    def wait(self, seconds: float) -> bool:
        """Wait for its end; return whether it came."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def printed(self) -> str:
        """Return what it has printed."""
        return self.log.read_text(errors="replace")

    def serves(self) -> bool:
        """Wait until it has printed something, or lives quietly; return whether it lives."""
        deadline = time.monotonic() + SERVES_S
        prints = rules.verb(self.outcome.command) != "run"
        while self.process.poll() is None and time.monotonic() < deadline:
            if self.printed() or (not prints and time.monotonic() - self.since > QUIET_S):
                return True
            time.sleep(0.1)
        return self.process.poll() is None

    def stop(self) -> None:
        """Press Ctrl-C; the exit code becomes that of the outcome."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
            if not self.wait(STOP_S):
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()
        self.finish()

    def finish(self) -> None:
        """Complete the outcome after the end."""
        self.outcome.exit = self.process.returncode
        self.outcome.seconds = time.monotonic() - self.since
        if self.outcome.failed:
            self.outcome.output = self.printed() or "(nothing printed)"


class Session:
    """One page in one folder.

    Args:
        page: to follow.
        folder: new and empty, away from the source tree.
        environment: variables, with the commands in PATH.
        long_s: s that a long command may run; 0 lists it only.
    """

    def __init__(
        self, page: Path, folder: Path, environment: Mapping[str, str], long_s: float = 0.0
    ) -> None:
        self.outcomes: list[Outcome] = []
        self._page, self._folder, self._environment = page, folder, dict(environment)
        self._long_s = long_s
        self._running: list[Running] = []
        self._brought: dict[str, list[str]] = {}
        self._imports: list[str] = []
        self._printed = ""
        self._count = 0

    def follow(self) -> list[Outcome]:
        """Do all that the page says, and return what became of it."""
        try:
            for block in blocks(self._page):
                self._do(block)
        finally:
            self._stop_all()
        return self.outcomes

    def _do(self, block: Block) -> None:
        if block.name:
            (self._folder / block.name).write_text(block.text)
        if block.language == "text":
            self._compare(block)
            return
        self._printed = ""
        self._bring(block.text)
        if block.language == "python":
            self._run_python(block)
        elif block.language in SHELLS:
            self._run_shell(block)
            self._stop_all()

    def _outcome(self, line: int, command: str, note: str = "") -> Outcome:
        page = self._page.relative_to(ROOT) if self._page.is_relative_to(ROOT) else self._page
        self.outcomes.append(Outcome(str(page), line, command, note=note))
        return self.outcomes[-1]

    def _bring(self, text: str) -> None:
        """Put the reader's files that a text names where the page has not made them itself."""
        variant = _VARIANT.findall(text)
        for name, write in reader.FILES.items():
            path = self._folder / name
            if not re.search(rf"(?<![\w/.]){re.escape(name)}(?![\w.])", text):
                continue
            made = re.search(rf"(synthetic \w+|record)\b.* {re.escape(name)}( |$)", text, re.M)
            other = self._brought.get(name, []) != variant
            if path.exists() and (other or (made and name in self._brought)):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
                self._brought.pop(name, None)
            if not made and not path.exists():
                write(path, text)
                self._brought[name] = variant

    def _run_python(self, block: Block) -> None:
        """Run a snippet with the imports of those before it, and the reader's arrays."""
        tree = ast.parse(block.text)
        names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
        taken = {node.id for node in names} - {n.id for n in names if isinstance(n.ctx, ast.Store)}
        given = {name: array for name, array in reader.arrays().items() if name in taken}
        np.savez(self._folder / "reader.npz", **given)
        before = [*self._imports, "import numpy; globals().update(numpy.load('reader.npz'))"]
        script = self._folder / f"line_{block.line}.py"
        script.write_text("\n".join([*before, block.text]))
        imports = [n for n in tree.body if isinstance(n, (ast.Import, ast.ImportFrom))]
        self._imports += [ast.unparse(node) for node in imports]
        outcome = self._outcome(block.line, f"python: {block.text.strip().splitlines()[0]} ...")
        self._run(outcome, f"{sys.executable} {script.name}")

    def _compare(self, block: Block) -> None:
        """Hold what a page shows against what was printed last, numbers aside."""
        for line in block.text.splitlines():
            if _without_numbers(line) not in _without_numbers(self._printed):
                last = self.outcomes[-1]
                last.note = f"does not print what line {block.line} shows: {line}"
                last.output = last.output or self._printed

    def _run_shell(self, block: Block) -> None:
        every = list(commands(block))
        starts = any(rules.starts_nodes(one.text) for one in every)
        robots = not starts and any(rules.is_of_a_robot(one.text) for one in every)
        for command in every:
            text, later = command.text, [one.text for one in every if one.line > command.line]
            if "my_run" in text and " import " not in text:
                self._bring(text)
            outcome = self._outcome(command.line, text, self._reason(block, text, robots))
            if outcome.note:
                continue
            if rules.needs_nodes(text) or _is_read(text, later):
                self._need_robot(outcome)
            if rules.is_long(text):
                self._run_long(outcome)
            elif rules.is_endless(text):
                self._start(outcome, later)
            elif rules.needs_nodes(text):
                self._ask(outcome)
            else:
                self._stop_recording(text)
                self._run(outcome, text)

    def _reason(self, block: Block, command: str, robots: bool) -> str:
        """Return why a command is not run; empty if it is."""
        if need := rules.need(command):
            return f"not run: needs {need}"
        asks = rules.needs_nodes(command) or " both" in f" {command}"
        if asks and robots:
            return "not run: needs the robot's nodes that its block starts"
        if asks and block.language == INLINE:
            return "not run: needs running nodes"
        if rules.is_long(command) and not self._long_s:
            return "long, not run"
        return ""

    def _begin(self, outcome: Outcome, command: str) -> Running:
        self._count += 1
        log = self._folder / f".log_{self._count}"
        with log.open("wb") as output:
            process = subprocess.Popen(
                ["bash", "-c", command],
                cwd=ROOT if rules.OF_THE_SOURCE.match(command) else self._folder,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        return Running(outcome, process, log)

    def _run(self, outcome: Outcome, command: str, limit: float = LIMIT_S) -> None:
        """Run a command to its end."""
        running = self._begin(outcome, command)
        if running.wait(limit):
            running.finish()
        else:
            running.stop()
            outcome.note, outcome.output = f"still ran after {limit:.0f} s", running.printed()
        self._printed += running.printed()

    def _run_long(self, outcome: Outcome) -> None:
        """Run a command for so long; one that still runs then has begun well."""
        running = self._begin(outcome, outcome.command)
        if running.wait(self._long_s):
            running.finish()
            return
        running.stop()
        outcome.note = f"long, stopped after {self._long_s:.0f} s with exit {outcome.exit}"
        outcome.exit, outcome.output = 0, ""

    def _start(self, outcome: Outcome, later: list[str]) -> None:
        """Start a command that ends with Ctrl-C, at once or after those that need it."""
        verb = rules.verb(outcome.command)
        if verb in ("up", "sim"):
            self._stop_all()
        if verb == "echo":
            self._ask(outcome)
            return
        running = self._begin(outcome, outcome.command)
        outcome.note = "stopped by Ctrl-C"
        if not running.serves():
            running.finish()
            outcome.note, outcome.output = "ended by itself", running.printed()
            return
        self._running.append(running)
        asked = any(rules.needs_nodes(one) or rules.verb(one) == "record" for one in later)
        if verb in ("view", "run") or (verb in ("up", "sim") and not asked):
            self._stop(running)

    def _ask(self, outcome: Outcome) -> None:
        """Ask running nodes, again until they can answer."""
        deadline = time.monotonic() + WAIT_S
        while True:
            running = self._begin(outcome, outcome.command)
            if rules.is_endless(outcome.command):
                if running.serves():
                    running.stop()
                    outcome.note = "stopped by Ctrl-C"
                else:
                    running.finish()
            elif running.wait(LIMIT_S):
                running.finish()
            else:
                running.stop()
            if not outcome.failed or time.monotonic() > deadline:
                break
            outcome.output, outcome.note = "", "asked again until there was an answer"
            time.sleep(2.0)
        self._printed += running.printed()

    def _need_robot(self, outcome: Outcome) -> None:
        """Start the robot that the reader of a command has, unless one runs."""
        if any(rules.starts_nodes(one.outcome.command) for one in self._running):
            return
        kind = "table" if _OF_TABLES.search(outcome.command) else "hand"
        first, *others = ROBOTS[kind]
        self._start(self._outcome(outcome.line, first), [outcome.command])
        for command in others:
            self._ask(self._outcome(outcome.line, command))

    def _stop_recording(self, command: str) -> None:
        """Stop a recording that a command reads."""
        for running in list(self._running):
            given = rules.words(running.outcome.command)
            if given[1] == "record" and set(given[2:]) & set(rules.words(command)):
                self._stop(running)

    def _stop(self, running: Running) -> None:
        self._running.remove(running)
        running.stop()

    def _stop_all(self) -> None:
        for running in reversed(self._running):
            running.stop()
        self._running = []


def _without_numbers(text: str) -> str:
    return re.sub(r"-?\d[\d.]*", "#", " ".join(text.split()))


def _is_read(command: str, later: list[str]) -> bool:
    """Whether a later command reads what a command records."""
    if rules.verb(command) != "record":
        return False
    out = rules.words(command)[2]
    return any(out in rules.words(one)[2:] and not rules.need(one) for one in later)
