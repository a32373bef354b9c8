"""Heavy work in a process of its own: answers, errors, ends."""

import os
import signal
import subprocess
import time

import psutil
import pytest

from tactile_dynamics_ros.core.effects import create_effects
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.ros.background import WORKER, Background, abandon_all
from tactile_dynamics_ros.stopping import StopRequest


@pytest.fixture
def background():
    made = Background()
    yield made
    made.close()


def test_a_function_is_computed_in_another_process_at_low_priority(background):
    assert background.submit(os.getpid).result(30) not in (os.getpid(), background._process.pid)
    assert background.submit(os.nice, 0).result(30) >= 10
    assert not background.busy


def test_an_error_of_ours_comes_back_as_it_was_raised(background):
    with pytest.raises(BadInputError, match="more than once"):
        background.submit(create_effects, ["force_bias", "force_bias"]).result(30)


def test_another_error_is_told_in_a_line_and_the_process_goes_on(background):
    with pytest.raises(TactileDynamicsError, match="ZeroDivisionError"):
        background.submit(divmod, 1, 0).result(30)
    assert background.submit(divmod, 7, 2).result(30) == (3, 1)


def test_a_job_that_dies_is_one_answer(background):
    with pytest.raises(TactileDynamicsError, match="ended before it was done"):
        background.submit(os._exit, 3).result(30)
    assert background.submit(divmod, 7, 2).result(30) == (3, 1)


def test_a_process_that_was_killed_is_started_again(background):
    background.submit(divmod, 7, 2).result(30)
    os.kill(background._process.pid, signal.SIGKILL)
    with pytest.raises(TactileDynamicsError, match="ended"):
        background.submit(divmod, 7, 2).result(30)
    assert background.submit(divmod, 7, 2).result(30) == (3, 1)


def test_what_nobody_wants_any_longer_is_not_waited_for(background):
    background.drop()  # nothing runs
    assert background.submit(divmod, 7, 2).result(30) == (3, 1)
    unwanted = background.submit(time.sleep, 60)
    while not unwanted.running():
        time.sleep(0.01)
    time.sleep(0.5)
    background.drop()
    assert background.submit(divmod, 9, 2).result(30) == (4, 1)
    assert isinstance(unwanted.exception(0), TactileDynamicsError)


def test_closing_ends_what_runs():
    background = Background()
    background.submit(divmod, 7, 2).result(30)
    running = background.submit(time.sleep, 60)
    deadline = time.monotonic() + 30.0
    while not running.running() and time.monotonic() < deadline:
        time.sleep(0.01)
    started = time.monotonic()
    background.close()
    assert time.monotonic() - started < 20.0
    with pytest.raises(TactileDynamicsError):
        running.result(1)


def test_closing_does_not_wait_for_what_it_ended(monkeypatch):
    """A process that was killed may need seconds to end where others compute."""
    background, kill = Background(), os.killpg
    background.submit(divmod, 7, 2).result(30)
    background.submit(time.sleep, 60)
    while not psutil.Process(background._process.pid).children():
        time.sleep(0.01)
    monkeypatch.setattr(os, "killpg", lambda *_: None)  # as if it took long to end
    background.close()
    assert background._process.poll() is None
    kill(background._process.pid, signal.SIGKILL)
    background._process.wait(30)


def test_a_request_to_stop_ends_at_once_what_runs(background):
    """Before files are written: what is killed needs seconds to end on a busy machine."""
    running = background.submit(time.sleep, 60)
    while not psutil.Process(background._process.pid).children():
        time.sleep(0.01)
    with StopRequest(at_once=abandon_all):
        os.kill(os.getpid(), signal.SIGINT)
        assert isinstance(running.exception(30), TactileDynamicsError)
    assert background.closed


def test_nothing_is_started_again_once_it_is_closed():
    """The thread may find the process dead just when the node ends."""
    background = Background()
    background.close()
    ended = background._process
    background._start_again()
    assert background._process is ended


def test_a_worker_whose_node_is_gone_before_it_looks_ends():
    orphan = subprocess.Popen([*WORKER, "0"], stdin=subprocess.PIPE)
    assert orphan.wait(30) == 0
