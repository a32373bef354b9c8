"""What a node or the recorder refuses, or cannot go on with, is one line and exit code 2."""

from __future__ import annotations

import errno
import signal

import pytest

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.nodes import biotac_force
from tactile_dynamics_ros.ros.startup import start_ros


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--foo"], r"'--foo' is unknown; a node takes --ros-args with -p NAME:=VALUE"),
        (["--ros-args", "-p", "a:=1", "--", "word"], "'word' is unknown"),
        (["--ros-args", "--bar"], "--ros-args --bar: not understood by ROS"),
        (["--ros-args", "-p", "a"], "--ros-args -p a: not understood by ROS"),
    ],
)
def test_words_that_ros_would_ignore_or_not_explain_are_refused(words, said):
    with pytest.raises(BadInputError, match=said):
        start_ros(words)


def test_a_parameter_file_that_is_missing_is_named_with_the_nearest(tmp_path):
    (tmp_path / "hand.yaml").touch()
    missing = tmp_path / "hands.yaml"
    with pytest.raises(BadInputError, match=f"{missing}: no such file; did you mean '.*hand.yaml'"):
        start_ros(["--ros-args", "--params-file", str(missing)])


@pytest.fixture
def handlers():
    """Signals are handled as before when the test has ended."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_node_ends_with_one_line_and_code_two(monkeypatch, capsys, handlers):
    monkeypatch.setattr("sys.argv", ["biotac_force", "--ros-args", "--params-file", "/no/x.yaml"])
    assert biotac_force.main() == 2
    assert capsys.readouterr().err == "error: --params-file /no/x.yaml: no such file\n"


def test_a_recording_on_a_full_disk_keeps_what_was_written(tmp_path, monkeypatch, capsys):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tactile_dynamics_ros.ros.shell.spin", full)
    out = tmp_path / "run"
    assert main(["record", str(out)]) == 2
    *_, said = capsys.readouterr().err.splitlines()
    assert said.startswith(f"error: {out}: No space left on device; free space there")
    assert "what was written before is kept" in said
    assert (out / "run.mcap").is_file()
