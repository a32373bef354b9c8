"""Faults of those who use the nodes: parameters, start arguments, service calls, signals."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial

from benchmarks.replay.player import DIAGNOSE, RESET, STATUS, executable
from benchmarks.replay.rig import Rig, Row, require_recovery
from tactile_dynamics_ros.cli.supervisor import verb_command

ESTIMATOR = "inertial_estimator"
CALLS, DIAGNOSES, IN_A_ROW = 100, 20, 6
FLAT = 1.1
"""Memory after six diagnoses over that after the first: what an allocator keeps, and no more."""
UP = 30.0
"""By then a node listens, or has refused its arguments, s."""

CommandFault = Callable[[Rig], Row]


def set_effects(value: object, rig: Rig) -> Row:
    """Give `effects` a value that is none: refused with a reason, and nothing happens."""

    def act(row: Row) -> None:
        answer = rig.player.answer_of(rig.player.set_parameter(ESTIMATOR, "effects", value))
        if answer is None:
            row.failures.append("no answer")
        elif answer.successful or not answer.reason:
            row.failures.append("taken" if answer.successful else "refused without a reason")
        else:
            row.said.append(answer.reason)

    return _during(rig, act)


def start_with(node: str, argument: str, rig: Rig) -> Row:
    """Start a node with an argument of the wrong type: one line and exit code 2, or understood.

    It runs in a namespace of its own, so that it disturbs nobody.
    """
    row = Row("")
    name, _, value = argument.partition(":=")
    command = [*executable(node, {name: value}), "-r", "__ns:=/aside"]

    def listens(topic: str) -> bool:
        return rig.player.node.count_subscribers(f"/aside/{topic}") > 0

    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        rig.player.listen_while(lambda: process.poll() is None and not listens("object/pose"), UP)
        rig.player.listen_while(lambda: process.poll() is None, 1.0)
        letters = name == "contacts" and listens(f"contact/{value[0]}/force")
    finally:
        ran = process.poll() is None
        process.terminate()
        complaint = process.communicate(timeout=20.0)[1].decode(errors="replace").strip()
    row.said = complaint.splitlines()[-1:]
    row.note = "runs" if ran else f"exit {process.returncode}"
    if "Traceback" in complaint:
        row.failures.append("traceback")
    if ran and (letters or name != "contacts"):
        row.failures.append("split into letters" if letters else "taken")
    if not ran and process.returncode != 2:
        row.failures.append(f"exit {process.returncode}")
    return row


def call_pipelined(service: str, count: int, rig: Rig, timeout: float = 120.0) -> Row:
    """Call a service many times without waiting: every call is answered, and the nodes recover."""

    def act(row: Row) -> None:
        began = time.monotonic()
        answers = rig.player.call(service, count, timeout)
        answered = sum(answer is not None for answer in answers)
        row.note = f"{answered} of {count} answered in {time.monotonic() - began:.1f} s"
        if answered < count:
            row.failures.append(f"{count - answered} calls not answered")

    return _during(rig, act)


def diagnose_in_a_row(rig: Rig) -> Row:
    """Diagnose six times, one after the other, in a new process: memory stays."""
    rig.player.restart("model_check")
    rig.play(rig.record(rig.lead))

    def act(row: Row) -> None:
        used = []
        for _ in range(IN_A_ROW):
            if rig.player.call(DIAGNOSE, 1, 120.0) == [None]:
                row.failures.append("not answered")
                break
            used.append(rig.player.memory().get("model_check", 0.0))
        row.note = "model_check " + " ".join(f"{megabytes:.0f}" for megabytes in used) + " MB"
        if used and used[-1] > FLAT * used[0]:
            row.failures.append(f"memory grew {used[-1] / used[0]:.2f} times")

    return _during(rig, act)


def terminate_echo(rig: Rig) -> Row:
    """End `tactile-dynamics echo` by SIGTERM once it prints: it goes without a traceback."""
    rig.prepare(1.0)
    row = Row("")
    with tempfile.TemporaryFile() as printed:
        command = verb_command("echo", STATUS, "--json")
        process = subprocess.Popen(command, stdout=printed, stderr=subprocess.PIPE)
        try:
            deadline = time.monotonic() + UP
            while not os.fstat(printed.fileno()).st_size and time.monotonic() < deadline:
                rig.play(rig.record(1.0))
            if not os.fstat(printed.fileno()).st_size:
                row.failures.append("printed nothing before")
            process.send_signal(signal.SIGTERM)
            complaint = process.communicate(timeout=10.0)[1].decode()
        except subprocess.TimeoutExpired:
            row.failures.append("did not end within 10 s")
            return row
        finally:
            process.kill()
            process.wait()
    row.note = f"exit {process.returncode}"
    row.said = complaint.strip().splitlines()[-1:]
    if "Traceback" in complaint:
        row.failures.append("traceback")
    return row


def _during(rig: Rig, act: Callable[[Row], None]) -> Row:
    """Do something between clean data; the estimate must be right afterwards."""
    begun = rig.prepare(rig.lead)
    start, done = rig.now, Row("")
    act(done)
    rig.recover()
    row = rig.judge("", begun, start, start)
    row.failures, row.note = done.failures, done.note
    row.said = [*done.said, *row.said]
    row.withheld = 0.0
    if row.died:
        row.failures.append(f"died: {', '.join(row.died)}")
    require_recovery(row)
    return row


def _started(nodes: Sequence[str], arguments: Sequence[str]) -> dict[str, CommandFault]:
    return {
        f"start_{node}_{argument}": partial(start_with, node, argument)
        for node in nodes
        for argument in arguments
    }


COMMAND_FAULTS: dict[str, CommandFault] = {
    "set_effects_5": partial(set_effects, 5),
    "set_effects_[1,2]": partial(set_effects, [1, 2]),
    "set_effects_twice": partial(set_effects, ["viscous_drag", "viscous_drag"]),
    **_started([ESTIMATOR], ["effects:=5", "contacts:=left"]),
    **_started(["model_check"], ["contacts:=left"]),
    "100_resets": partial(call_pipelined, RESET, CALLS),
    "6_diagnoses_memory": diagnose_in_a_row,
    "20_diagnoses": partial(call_pipelined, DIAGNOSE, DIAGNOSES),
    "sigterm_echo": terminate_echo,
}
