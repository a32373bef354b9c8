"""What the demo tries when the diagnosis is not certain."""

import argparse

import pytest

pytest.importorskip("rclpy")

from tactile_dynamics_ros.cli.demo import (  # noqa: E402
    STARTING,
    STILL,
    _require_progress,
    add_parser,
    run,
)
from tactile_dynamics_ros.cli.demo_story import _worth_trying  # noqa: E402
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError  # noqa: E402


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


@pytest.mark.parametrize(
    ("standing_still", "waited", "complaint"),
    [
        (None, STILL + 1.0, None),
        (None, STARTING + 1.0, "no simulated time within 401 s"),
        (1.0, STARTING + 1.0, None),
        (STILL + 1.0, STILL + 1.0, "stands still for 91 s"),
        (1.0, 5000.0, "not finished after 4500 s"),
    ],
)
def test_a_slow_start_is_no_fault_and_a_simulation_that_stops_is(standing_still, waited, complaint):
    monitor = argparse.Namespace(standing_still=standing_still, not_started="")
    if complaint is None:
        _require_progress(monitor, waited, limit=4500.0)
        return
    with pytest.raises(TactileDynamicsError, match=complaint):
        _require_progress(monitor, waited, limit=4500.0)
