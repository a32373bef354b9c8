"""Processes of a running system: started together, watched, stopped together."""

from __future__ import annotations

import ctypes
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO

from tactile_dynamics_ros.cli.bringup import RESPAWN_DELAY, Respawns
from tactile_dynamics_ros.ros.names import enclave_of
from tactile_dynamics_ros.stopping import hold_requests
from tactile_dynamics_ros.view import TOKEN_VARIABLE

PATIENCE = (("SIGINT", 6.0), ("SIGTERM", 2.0), ("SIGKILL", 2.0))
PR_SET_PDEATHSIG = 1
EXECUTABLE = "tactile_dynamics_ros.ros.executable"
"""Module that runs a node."""


def verb_command(*arguments: str) -> list[str]:
    """Return the command line that runs a verb of `tactile-dynamics` with this interpreter."""
    return [sys.executable, "-P", "-m", "tactile_dynamics_ros.cli.main", *arguments]


@dataclass
class Member:
    """One process: how to start it and how it fares.

    Attributes:
        name: of the process.
        command: that starts it.
        log: file of its output.
        process: the running one, None between its death and the next start.
        due: when it is started again, monotonic s; None unless it waits for that.
        restarts: how often it was started again.
        exit_codes: of all its deaths.
        epitaph: what is to be reported of the last death.
    """

    name: str
    command: list[str]
    log: Path | None = None
    process: subprocess.Popen[bytes] | None = None
    due: float | None = None
    restarts: int = 0
    exit_codes: list[int] = field(default_factory=list)
    epitaph: str = ""

    @property
    def running(self) -> bool:
        """Whether the process is alive."""
        return self.process is not None and self.process.poll() is None

    def start(self) -> None:
        """Start the process; it dies with this one."""
        output: IO[bytes] | None = self.log.open("ab") if self.log else None
        try:
            self.process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=output or sys.stderr,
                stderr=output or sys.stderr,
                preexec_fn=_begin_node if EXECUTABLE in self.command else _begin,
            )
        finally:
            if output is not None:
                output.close()

    def last_words(self, lines: int = 5) -> str:
        """Return the end of the log."""
        if self.log is None or not self.log.exists():
            return ""
        text = self.log.read_text(errors="replace").strip().splitlines()
        return "\n".join(text[-lines:])


class Supervisor:
    """Starts named processes, restarts those that die, and stops all on leaving the context.

    Args:
        logs: folder for one log per process; inherited standard error if None.
        respawn: whether a process that ends by itself is started again, as `Respawns` allows.
    """

    def __init__(self, logs: Path | None = None, respawn: bool = True) -> None:
        self.members: dict[str, Member] = {}
        self._logs = logs
        self._respawns = Respawns() if respawn else None
        if logs is not None:
            logs.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self, name: str, command: Sequence[str]) -> Member:
        """Start a process under a name."""
        log = self._logs / f"{name}.log" if self._logs else None
        member = Member(name, list(command), log)
        self.members[name] = member
        member.start()
        return member

    @property
    def abandoned(self) -> bool:
        """Whether no process is left and none is going to be started again."""
        return not any(m.process or m.due is not None for m in self.members.values())

    def watch(self) -> list[Member]:
        """Start again what has been dead long enough; return what was newly found dead."""
        now = time.monotonic()
        dead = []
        for member in self.members.values():
            if member.process is not None and not member.running:
                self._bury(member, member.process.returncode, now)
                dead.append(member)
            elif member.due is not None and now >= member.due:
                member.due = None
                member.restarts += 1
                member.start()
        return dead

    def _bury(self, member: Member, code: int, now: float) -> None:
        """Note a death and whether the process is started again."""
        member.exit_codes.append(code)
        member.process = None
        member.epitaph = f"{member.name} ended with {code}"
        if self._respawns is not None:
            verdict = self._respawns.note_death(member.name, code, now)
            member.epitaph = verdict.sentence
            member.due = now + RESPAWN_DELAY if verdict.again else None

    def stop(self, names: Sequence[str] | None = None) -> dict[str, int]:
        """Stop processes (all if None), gently first; return their exit codes."""
        chosen = [m for n, m in self.members.items() if names is None or n in names]
        for signal_name, patience in PATIENCE:
            for member in chosen:
                if member.running and member.process is not None:
                    member.process.send_signal(getattr(signal, signal_name))
            deadline = time.monotonic() + patience
            while any(m.running for m in chosen) and time.monotonic() < deadline:
                time.sleep(0.02)
        codes = {m.name: m.process.returncode for m in chosen if m.process is not None}
        for member in chosen:
            self.members.pop(member.name, None)
        return codes


def _begin_node() -> None:
    """Begin as every process does; a node answers requests to stop once it can."""
    _begin()
    hold_requests()


def _begin() -> None:
    """Leave the terminal's process group, and get a signal when the parent dies."""
    os.setpgid(0, 0)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def node_command(
    node: str,
    parameter_file: Path | None = None,
    parameters: Mapping[str, object] | None = None,
    namespace: str = "",
) -> list[str]:
    """Return the command that runs one node.

    Args:
        node: name of the executable.
        parameter_file: in ROS' format.
        parameters: single ones, which win over those of the file.
        namespace: of the node; empty for the root.
    """
    arguments = ["--ros-args", *enclave_of(node)]
    if namespace:
        arguments += ["-r", f"__ns:={namespace}"]
    if parameter_file is not None:
        arguments += ["--params-file", str(parameter_file)]
    for name, value in (parameters or {}).items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{name}:={text}"]
    return [sys.executable, "-P", "-m", EXECUTABLE, node, *arguments]


def start_view(supervisor: Supervisor, port: int | None, say: Callable[[str], None]) -> None:
    """Start the live page where one is wanted, and say where it is.

    Args:
        supervisor: that starts it.
        port: of the page; None: no page.
        say: prints a line for people.
    """
    if port:
        token = os.environ.setdefault(TOKEN_VARIABLE, secrets.token_urlsafe(16))
        supervisor.start("view", verb_command("view", "--port", str(port), "--control"))
        say(f"live page: http://127.0.0.1:{port}/?token={token}")
