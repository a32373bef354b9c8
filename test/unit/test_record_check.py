"""`record --check`: what is said of a recording while it grows."""

from concurrent.futures import Future
from types import SimpleNamespace

import pytest
from synthetic_recording import held_box

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.cli.record_check import RecordCheck, Said, check_so_far
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.ros import background


def test_a_file_that_still_grows_is_checked_in_words(tmp_path):
    whole = held_box(seconds=2.0, motion=0.1).to_bag(tmp_path / "run")
    said = check_so_far(str(whole), None)
    assert not said.ready
    assert "inertia" in said.text or "centre of mass" in said.text
    assert said.relative["mass"] < said.relative["inertia_xx"]
    empty = check_so_far(str(tmp_path / "nothing"), None)
    assert not empty.ready
    assert empty.text.startswith("nothing to say yet: ")


class Process:
    """Stands in for the process beside the recorder."""

    def __init__(self):
        self.futures, self.closed = [], False

    def submit(self, work, *arguments):
        assert (work, arguments) == (check_so_far, ("run", None))
        self.futures.append(Future())
        return self.futures[-1]

    def close(self):
        self.closed = True


def test_one_check_runs_at_a_time_and_news_are_told(monkeypatch, capsys):
    process, told = Process(), []
    monkeypatch.setattr(background, "Background", lambda: process)
    recorder = SimpleNamespace(faults=SimpleNamespace(tell=lambda *words: told.append(words)))
    check = RecordCheck(recorder, "run", None, 0.0, quiet=False)
    for _ in range(3):
        check.advance()
    assert len(process.futures) == 1
    process.futures[0].set_result(Said(False, "turn about x", {"mass": 0.02}))
    check.advance()
    assert told[0] == (
        "check",
        "turn about x",
        {"ready": False, "mass_relative_std": 0.02},
        DiagnosticStatus.WARN,
    )
    for answer in (Said(False, "turn about x", {}), Said(True, "ready", {})):
        check.advance()
        process.futures[-1].set_result(answer)
        check.advance()
    check.advance()
    process.futures[-1].set_exception(NotIdentifiableError("out of memory"))
    check.advance()
    assert [words[3] for words in told] == [
        DiagnosticStatus.WARN,
        DiagnosticStatus.WARN,
        DiagnosticStatus.OK,
        DiagnosticStatus.WARN,
    ]
    printed = capsys.readouterr().err.splitlines()
    assert printed == ["check: turn about x", "check: ready", "check: out of memory"]
    check.close()
    assert process.closed


def test_a_period_that_is_none_is_refused_before_anything_is_written(tmp_path, capsys):
    assert main(["record", str(tmp_path / "run"), "--check", "-1"]) == 2
    assert "expected a number above 0" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
