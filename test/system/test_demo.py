"""The demo as a user runs it, shortened, to its last line."""

import json
import subprocess

import psutil
import pytest

from tactile_dynamics_ros.cli.supervisor import verb_command
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.sim.hidden_effects import CATALOGUED

VERDICTS = {"adequate", "missing_effect", "ambiguous", "convention", "unexplained"}


def play(out, *words, timeout=1000.0):
    """Play the demo to its end and return its document and what it said."""
    command = verb_command("demo", "--object", "box_0", "--out", str(out), *words, "--json")
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
    assert done.returncode == 0, done.stderr
    left = [p for p in psutil.process_iter(["cmdline"]) if str(out) in str(p.info["cmdline"])]
    assert left == []
    return json.loads(done.stdout)


def check_revealed(result, out, hidden):
    """Check that what was hidden is revealed, explained and reported, whatever was found."""
    page = (out / "report.html").read_text()
    assert result["truth"]["hidden_effect"]["name"] == hidden
    assert f"Hidden effect: {hidden}" in page
    assert f"--hidden {hidden}" in page
    assert result["diagnosis"]["verdict"] in VERDICTS
    assert result["explanation"]["sentence"] in page.replace("&#39;", "'")
    assert (out / "explain" / "report.html").stat().st_size > 10_000


@pytest.mark.timeout(1100)
def test_demo_leaves_recording_report_and_no_process(tmp_path):
    out = tmp_path / "demo"
    result = play(out, "--seed", "1", "--duration", "6")
    assert result["truth"]["object"] == "box_0"
    assert result["offline"]["samples"] > 500
    assert abs(result["offline"]["mass"]["value"] / result["truth"]["mass"] - 1) < 0.25
    assert abs(result["live"]["value"][0] / result["truth"]["mass"] - 1) < 0.25
    assert (out / "report.html").stat().st_size > 10_000
    assert set(Recording.from_bag(out / "recording").streams.contacts) == {
        "index",
        "middle",
        "ring",
        "thumb",
    }


@pytest.mark.timeout(1100)
def test_a_hidden_effect_is_diagnosed_explained_and_revealed(tmp_path):
    out, hidden = tmp_path / "demo", "viscous_drag"
    words = ["--hidden", hidden, "--magnitude", "3", "--seed", "3", "--duration", "12"]
    result = play(out, *words)
    check_revealed(result, out, hidden)
    assert result["diagnosis"]["effect"] is not None, result["diagnosis"]["sentence"]
    assert result["explanation"]["error"]["after"] < result["explanation"]["error"]["before"]


@pytest.mark.timeout(400)
def test_an_arm_weighs_and_tells_its_controller(tmp_path):
    pytest.importorskip("tactile_dynamics_msgs")
    out = tmp_path / "weighed"
    result = play(out, "--weigh", "--seed", "4", "--duration", "6", timeout=300.0)
    for name in ("tool", "load"):
        mass, truth = result["weighed"][name]["mass"], result["truth"][name]["mass"]
        assert abs(mass["value"] - truth) < 5.0 * mass["std"]
    assert result["doubts"] == [] and result["handed_over"]
    assert result["sag_m"]["known"] < 0.1 * result["sag_m"]["load"]
    assert (out / "report" / "report.html").stat().st_size > 10_000


@pytest.mark.long
@pytest.mark.timeout(1300)
@pytest.mark.parametrize("hidden", CATALOGUED)
def test_every_hidden_effect_is_played_to_its_end(hidden, tmp_path):
    out = tmp_path / "demo"
    check_revealed(play(out, "--hidden", hidden, "--seed", "1", timeout=1200.0), out, hidden)
