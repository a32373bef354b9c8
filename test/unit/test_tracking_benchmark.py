"""What the tracking benchmark counts as an error."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tracking.page import render
from benchmarks.tracking.scores import measure, summarise
from benchmarks.tracking.tape import Moment, Tape
from benchmarks.tracking.trackers import Track
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.shape.object_shape import load_shape
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.share import object_file

STD = np.array([0.005] * 3 + [1e-3] * 3)


def turned(pose, turn):
    moved = pose.copy()
    moved[:3, :3] = exp_so3(np.asarray(turn, dtype=float)) @ pose[:3, :3]
    return moved


def still_tape(name, count=400):
    truth = np.eye(4)
    truth[:3, 3] = [0.5, 0.0, 0.3]
    moments = [Moment(0.01 * k, np.zeros(23), truth, True, {}, 0.0, None) for k in range(count)]
    camera = PinholeCamera(np.eye(3), 4, 4, np.eye(4))
    return Tape(name, 0, camera, moments, "done", None), truth


def test_stated_errors_have_the_nees_of_their_degrees_of_freedom():
    tape, truth = still_tape("gelatin_box")
    shape, rng, track = load_shape(object_file("gelatin_box")), np.random.default_rng(1), Track()
    for moment in tape.moments:
        error = STD * rng.normal(size=6)
        pose = turned(truth, error[:3])
        pose[:3, 3] += error[3:]
        track.add(moment.time, pose, np.diag(STD**2), False)
    summary = summarise([measure(tape, shape, track)])
    assert summary["nees"] == pytest.approx(6.0, abs=0.6)
    assert summary["nees_band_95"][0] < 6.0 < summary["nees_band_95"][1]
    assert summary["position_rms_mm"] == pytest.approx(np.sqrt(3.0), abs=0.2)


@pytest.mark.parametrize(
    ("name", "turn", "counts"),
    [
        ("soup_can", [0.0, 0.0, 0.4], False),
        ("soup_can", [np.pi, 0.0, 0.0], False),
        ("soup_can", [0.1, 0.0, 0.0], True),
        ("gelatin_box", [0.0, 0.0, np.pi], False),
        ("gelatin_box", [0.0, 0.0, np.pi / 2], True),
    ],
)
def test_turns_that_look_the_same_are_no_error(name, turn, counts):
    tape, truth = still_tape(name, 3)
    track = Track()
    for moment in tape.moments:
        track.add(moment.time, turned(truth, turn), np.diag(STD**2), False)
    found = measure(tape, load_shape(object_file(name)), track)
    assert (found.rotation.max() > 0.05) == counts
    assert (found.nees.max() > 1.0) == counts
    assert found.position.max() < 1e-9


def test_inertial_estimates_are_shown_as_medians_of_the_runs_that_gave_one():
    def scored(mass):
        return {"mass_percent": mass, "com_mm": 1.0, "trace_error": 2.0, "distance": 3.0}

    runs = [{"object": "box_0", "fused": scored(mass)} for mass in (9.0, 1.0, 2.0)]
    runs += [{"object": "box_0", "fused": {"error": "nothing is held"}}]
    lines = render({"inertia": runs}).splitlines()
    assert lines[2:] == ["| box_0 | 3 | fused | 2.00 | 1.00 | 2.00 | 3.00 |"]
    pairs = [
        {"object": "box_0", "fused": scored(mass), "kinematic_only": scored(1.0)}
        for mass in (1.0, 2.0, 3.0)
    ]
    last = render({"inertia": pairs}).splitlines()[-1]
    assert last.startswith("Fused over kinematic only, mean of 3 runs: mass, % +1.00 ± 0.58,")
    fused = {"position_rms_mm": 0.5, "rotation_rms_deg": 0.12, "nees": 6.2}
    told = render({"inertia": pairs, "inertia_fused": fused | {"nees_band_95": [4.7, 7.5]}})
    assert told.endswith(
        "\n\nFused poses of these 3 runs: 0.50 mm and 0.12 deg RMS, NEES 6.2 (95 % band 4.7 - 7.5)."
    )
