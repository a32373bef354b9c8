"""One request to stop: what it interrupts, what it leaves alone, and how a process ends."""

import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from tactile_dynamics_ros.cli import main
from tactile_dynamics_ros.stopping import Stopped, StopRequest


def test_the_first_request_is_remembered_and_others_do_nothing():
    before = signal.getsignal(signal.SIGTERM)
    with StopRequest() as stop:
        assert not stop.requested
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
        assert stop.requested
    assert signal.getsignal(signal.SIGTERM) is before


def test_what_starts_is_left_at_once_through_every_handler_of_errors():
    with pytest.raises(Stopped), StopRequest(patience=0.0):
        try:
            signal.raise_signal(signal.SIGINT)
        except Exception:
            pytest.fail("a handler of errors caught the request")


def test_what_runs_is_left_after_the_patience_alone():
    with StopRequest(patience=0.2) as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.requested
        with pytest.raises(Stopped):
            time.sleep(10.0)


def test_what_ends_is_not_interrupted_any_longer():
    with StopRequest(patience=0.05) as stop:
        signal.raise_signal(signal.SIGINT)
        stop.patience = float("inf")
        time.sleep(0.2)
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


LEAVING = """
import sys, threading, time
from tactile_dynamics_ros.stopping import leave
threading.Thread(target=time.sleep, args=[60.0]).start()  # an interpreter would wait for it
print("said")
leave(3)
"""


def test_leaving_waits_for_no_thread_and_loses_no_word():
    done = subprocess.run([sys.executable, "-c", LEAVING], capture_output=True, timeout=30.0)
    assert (done.returncode, done.stdout, done.stderr) == (3, b"said\n", b"")


def test_a_stop_that_a_library_caught_lets_nothing_else_begin():
    with StopRequest(patience=0.0), pytest.raises(Stopped):
        with suppress(Stopped):  # as a library that loads does
            signal.raise_signal(signal.SIGINT)
        with StopRequest():
            pytest.fail("something began")


HANGING = """
import ctypes, os, signal, sys
from tactile_dynamics_ros.stopping import StopRequest
with StopRequest(limit=1.0) as stop:
    os.kill(os.getpid(), signal.SIGINT)
    if sys.argv[1:]:
        stop.work_done()
    ctypes.PyDLL(None).sleep(60)  # keeps the lock of the interpreter, as deleting a node does
"""


@pytest.mark.parametrize(("done", "code"), [([], 1), (["done"], 0)], ids=["at work", "done"])
def test_what_hangs_is_a_fault_until_the_work_is_done(done, code):
    ended = subprocess.run([sys.executable, "-c", HANGING, *done], capture_output=True, timeout=30)
    assert ended.returncode == code
    assert (b"Timeout" in ended.stderr) is bool(code)


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_a_node_is_stopped_while_it_loads_its_libraries(by):
    """Without a node's modules: the first of them asks to stop, and would never be loaded."""
    program = (
        "import signal, sys, time\n"
        "from importlib.abc import MetaPathFinder\n"
        "class Slow(MetaPathFinder):\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'tactile_dynamics_ros.nodes':\n"
        f"            signal.raise_signal({int(by)})\n"
        "            time.sleep(60.0)\n"
        "sys.meta_path.insert(0, Slow())\n"
        "from tactile_dynamics_ros.ros.executable import explorer\n"
        "explorer()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=30.0)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.parametrize(("verb", "code"), [("up", 0), ("run", 0), ("estimate", 130)])
def test_a_verb_that_runs_nodes_ends_with_0_while_it_loads(monkeypatch, verb, code):
    monkeypatch.setattr(main, "build_parser", lambda _: signal.raise_signal(signal.SIGINT))
    assert main.main([verb]) == code


LOADING = """
import os, signal
from tactile_dynamics_ros.ros import executable

class Node:
    main = staticmethod(lambda: print("ran") or 7)

def load(name):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except BaseException:
        {answer}
    return Node

executable.importlib.import_module = load
executable.start("any")
"""


@pytest.mark.parametrize("answer", ["pass", "raise ImportError('initialization failed')"])
def test_a_library_that_catches_the_stop_changes_nothing(answer):
    words = [sys.executable, "-c", LOADING.format(answer=answer)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
