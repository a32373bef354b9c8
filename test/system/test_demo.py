"""The demo as a user runs it, shortened."""

import json
import subprocess

import psutil
import pytest

from tactile_dynamics_ros.cli.supervisor import verb_command
from tactile_dynamics_ros.recording import Recording


@pytest.mark.timeout(560)
def test_demo_leaves_recording_report_and_no_process(tmp_path):
    out = tmp_path / "demo"
    words = ["demo", "--object", "box_0", "--seed", "1", "--duration", "6", "--out", str(out)]
    done = subprocess.run(
        verb_command(*words, "--json"), capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
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
    left = [p for p in psutil.process_iter(["cmdline"]) if str(out) in str(p.info["cmdline"])]
    assert left == []
