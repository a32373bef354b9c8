"""Processes of a running system: started together, watched, stopped together."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO

PATIENCE = (("SIGINT", 6.0), ("SIGTERM", 2.0), ("SIGKILL", 2.0))
RESPAWN_PAUSE = 1.0
PR_SET_PDEATHSIG = 1


def verb_command(*arguments: str) -> list[str]:
    """Return the command line that runs a verb of `tactile-dynamics` with this interpreter."""
    return [sys.executable, "-m", "tactile_dynamics_ros.cli.main", *arguments]


@dataclass
class Member:
    """One process: how to start it and how it fares."""

    name: str
    command: list[str]
    log: Path | None = None
    process: subprocess.Popen[bytes] | None = None
    started: float = 0.0
    restarts: int = 0
    exit_codes: list[int] = field(default_factory=list)

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
                preexec_fn=_separate_and_die_with_parent,
            )
        finally:
            if output is not None:
                output.close()
        self.started = time.monotonic()

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
        respawn: whether a process that ends by itself is started again.
    """

    def __init__(self, logs: Path | None = None, respawn: bool = True) -> None:
        self.members: dict[str, Member] = {}
        self._logs = logs
        self._respawn = respawn
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

    def watch(self) -> list[Member]:
        """Restart what has died; return the members that were found dead."""
        dead = []
        for member in self.members.values():
            if member.running or member.process is None:
                continue
            if time.monotonic() - member.started < RESPAWN_PAUSE:
                continue
            dead.append(member)
            member.exit_codes.append(member.process.returncode)
            member.process = None
            if self._respawn:
                member.restarts += 1
                member.start()
        return dead

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


def _separate_and_die_with_parent() -> None:
    """Leave the terminal's process group, and be told when the parent dies."""
    os.setpgid(0, 0)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def node_command(
    node: str, parameter_file: Path | None = None, parameters: Mapping[str, object] | None = None
) -> list[str]:
    """Return the command that runs one node with a parameter file and single parameters."""
    arguments = ["--ros-args"]
    if parameter_file is not None:
        arguments += ["--params-file", str(parameter_file)]
    for name, value in (parameters or {}).items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{name}:={text}"]
    return verb_command("run", node, *arguments)
