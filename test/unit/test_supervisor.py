"""Processes are restarted, stopped, and do not outlive their supervisor."""

import os
import signal
import subprocess
import sys
import time

import psutil

from tactile_dynamics_ros.cli.bringup import MOST_RESPAWNS, RESPAWN_DELAY
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command

SLEEP = [sys.executable, "-c", "import time; print('up', flush=True); time.sleep(600)"]
STUBBORN = [
    sys.executable,
    "-c",
    "import signal, time\n"
    "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
    "print('up', flush=True)\n"
    "time.sleep(600)",
]


def wait_for(condition, timeout=20.0):
    """Wait until a condition holds."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def is_alive(pid):
    return psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE


def test_dead_process_is_started_again_after_the_pause_and_logged(tmp_path):
    with Supervisor(tmp_path) as supervisor:
        member = supervisor.start("sleeper", SLEEP)
        wait_for(lambda: "up" in member.last_words())
        os.kill(member.process.pid, signal.SIGKILL)
        wait_for(supervisor.watch)
        died = time.monotonic()
        assert (member.running, supervisor.abandoned) == (False, False)
        wait_for(lambda: supervisor.watch() or member.restarts)
        assert time.monotonic() - died > 0.9 * RESPAWN_DELAY
        assert member.restarts == 1
        assert member.exit_codes == [-signal.SIGKILL]
        assert member.running


def test_process_that_keeps_dying_is_given_up_and_said_so_once(tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_dynamics_ros.cli.supervisor.RESPAWN_DELAY", 0.05)
    told = []
    with Supervisor(tmp_path) as supervisor:
        member = supervisor.start("quick", [sys.executable, "-c", "raise SystemExit(7)"])
        wait_for(lambda: told.extend(m.epitaph for m in supervisor.watch()) or supervisor.abandoned)
        time.sleep(0.2)
        assert supervisor.watch() == []
    assert member.exit_codes == [7] * (MOST_RESPAWNS + 1)
    assert len(told) == MOST_RESPAWNS + 1
    assert [("not started again" in line) for line in told] == [False] * MOST_RESPAWNS + [True]


def test_without_respawn_death_is_only_told(tmp_path):
    with Supervisor(tmp_path, respawn=False) as supervisor:
        member = supervisor.start("quick", [sys.executable, "-c", "raise SystemExit('bad news')"])
        found = []
        wait_for(lambda: found.extend(supervisor.watch()) or found)
        assert found == [member]
        assert not member.running
        assert supervisor.abandoned
        assert "bad news" in member.last_words()


def test_leaving_the_context_ends_even_what_ignores_signals(tmp_path, monkeypatch):
    patience = (("SIGINT", 0.3), ("SIGTERM", 0.3), ("SIGKILL", 5.0))
    monkeypatch.setattr("tactile_dynamics_ros.cli.supervisor.PATIENCE", patience)
    with Supervisor(tmp_path) as supervisor:
        members = [supervisor.start("a", SLEEP), supervisor.start("b", STUBBORN)]
        wait_for(lambda: all("up" in m.last_words() for m in members))
        pids = [m.process.pid for m in members]
    assert not any(is_alive(pid) for pid in pids)


def test_processes_end_with_a_killed_supervisor(tmp_path):
    program = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from tactile_dynamics_ros.cli.supervisor import Supervisor\n"
        f"with Supervisor(Path({str(tmp_path)!r})) as s:\n"
        f"    print(s.start('sleeper', {SLEEP!r}).process.pid, flush=True)\n"
        "    time.sleep(600)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    assert is_alive(child)
    parent.kill()
    parent.wait(timeout=10)
    wait_for(lambda: not is_alive(child))


def test_node_command_passes_parameters_as_ros_reads_them():
    words = node_command("robot_sim", None, {"seed": 3, "noise": False, "world.object_name": "mug"})
    assert words[-6:] == ["-p", "seed:=3", "-p", "noise:=false", "-p", "world.object_name:=mug"]


def test_node_command_puts_the_node_into_its_namespace():
    words = node_command("robot_sim", None, namespace="/left")
    assert words[-2:] == ["-r", "__ns:=/left"]


def test_a_node_that_is_stopped_before_its_interpreter_runs_ends_with_0():
    with Supervisor() as supervisor:
        node = supervisor.start("node", node_command("contact_state"))
        assert supervisor.stop() == {"node": 0}
        assert not node.running
