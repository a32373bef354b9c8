"""What the demo of a table leaves: estimates beside the truth, and the page."""

import argparse

import numpy as np
import pytest

from tactile_dynamics_ros.cli.demo_planar import table_parameters
from tactile_dynamics_ros.cli.explore import describe
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.report.exploration import (
    _history,
    compare_properties,
    write_exploration,
)


@pytest.fixture
def told():
    action = {
        "kind": "push",
        "point": [0.45, 0.0],
        "direction": [1.0, 0.0],
        "speed": 0.2,
        "expected_gain": 9.5,
        "chosen_because": "it narrows com_y most, 3.0 times, of all that fit",
    }
    link = {
        "friction_force_n": {"value": 2.1, "std": 0.1},
        "mass": {"value": 0.7, "std": 0.05},
        "com": {"value": [0.001, -0.004], "std": [0.001, 0.001]},
    }
    truth = {"friction_force_n": 2.0, "mass": 0.9, "friction": 0.22, "com": [0.002, -0.004]}
    properties = {"links": [link], "undetermined": ["mass"]}
    made = {
        "explored": {
            "actions": [action],
            "properties": properties,
            "stopped_because": "all parameters are known to the wanted width",
        },
        "pushed": {
            "reached": True,
            "error_m": 0.0012,
            "error_rad": 0.01,
            "pushes": 3,
            "duration_s": 17.0,
            "stopped_because": "near enough",
        },
        "truth": {"links": [truth], "hidden_effect": {"name": "support_tilt"}},
        "goal": [0.5, 0.1, 0.0],
        "path": [[0.5, 0.1 * t, 0.1 * t, t] for t in np.linspace(0.0, 1.0, 20)],
        "goal_from": 10,
        "footprint": [[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]],
        "history": [{"time": t, "mass": 0.8, "mass_std": 0.1} for t in (1.0, 2.0)],
    }
    return made | {"compared": compare_properties(properties, made["truth"])}


def test_estimates_stand_beside_the_truth_with_what_is_undetermined(told):
    rows = {row["name"]: row for row in told["compared"]}
    assert set(rows) == {"friction_force_n", "mass", "com_x", "com_y"}
    for name in ("friction_force_n", "mass"):
        row = rows[name]
        assert row["off_by_std"] == pytest.approx(abs(row["value"] - row["truth"]) / row["std"])
    assert rows["mass"]["undetermined"]
    assert rows["com_x"]["truth"] == 0.002


def test_the_page_tells_pushes_estimates_and_the_way(told, tmp_path):
    page = write_exploration(told, tmp_path).read_text()
    for words in ("narrows com_y most", "support_tilt", "near enough", "1.2 mm", "undetermined"):
        assert words in page
    assert {file.stem for file in tmp_path.glob("*.png")} == {"actions", "estimates", "goal"}


def test_the_band_over_time_is_one_standard_deviation_and_the_page_says_so(told, tmp_path):
    band = _history(told).axes[1].collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == (pytest.approx(0.7), pytest.approx(0.9))
    assert "Bands are ± one standard deviation" in write_exploration(told, tmp_path).read_text()


def test_a_run_without_estimates_has_a_page_too(told, tmp_path):
    told["explored"]["properties"] = {"links": [], "undetermined": []}
    told |= {"compared": [], "history": []}
    assert write_exploration(told, tmp_path).exists()


def test_what_was_explored_is_told_in_lines(told):
    lines = describe(told["explored"]).splitlines()
    assert lines[0].startswith("1. push at (0.450, 0.000) m")
    assert "mass: 0.7 ± 0.05 (undetermined)" in lines
    assert lines[-1] == "stopped: all parameters are known to the wanted width"


@pytest.mark.parametrize(("given", "number"), [("7", 7), ("random", 0), ("box_0", 121)])
def test_objects_of_the_table_are_numbers(given, number):
    args = argparse.Namespace(
        object=given, seed=3, hidden="none", magnitude=1.0, real_time_factor=1.0
    )
    assert table_parameters(args)["object_number"] == number
    args.object = "mug"
    with pytest.raises(BadInputError, match="number"):
        table_parameters(args)
