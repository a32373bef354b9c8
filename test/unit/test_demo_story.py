"""What the demo tries when the diagnosis is not certain."""

import argparse

import pytest

pytest.importorskip("rclpy")

from tactile_dynamics_ros.cli.demo import add_parser, run  # noqa: E402
from tactile_dynamics_ros.cli.demo_story import _worth_trying  # noqa: E402
from tactile_dynamics_ros.core.errors import BadInputError  # noqa: E402


def document(verdict, expected):
    candidates = [{"name": "hanging_cable", "predicted_whitened_rms": expected}]
    return {"verdict": verdict, "candidates": candidates, "error": {"before": 4.0}}


def test_a_candidate_that_promises_much_is_tried_and_others_are_not():
    assert _worth_trying(document("unexplained", 1.7)) == "hanging_cable"
    assert _worth_trying(document("unexplained", 3.5)) is None
    assert _worth_trying(document("adequate", 0.1)) is None
    assert _worth_trying({"verdict": "none"}) is None


def test_a_recording_that_exists_is_refused_before_anything_starts(tmp_path):
    (tmp_path / "recording").mkdir()
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    with pytest.raises(BadInputError, match="exists already"):
        run(parser.parse_args(["demo", "--out", str(tmp_path)]))
    assert not (tmp_path / "logs").exists()
