"""What the demo of a table leaves: estimates beside the truth, and the page."""

import argparse

import numpy as np
import pytest
from matplotlib.colors import to_hex

from tactile_dynamics_ros.cli.demo_planar import table_parameters
from tactile_dynamics_ros.cli.explore import describe, why_unknown
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.report.exploration import (
    COLOURS,
    _history,
    _map,
    compare_properties,
    write_exploration,
)

BOX = [[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]]
WAY = [[0.5, 0.1 * t, 0.1 * t, t] for t in np.linspace(0.0, 1.0, 20)]


@pytest.fixture
def told():
    action = {
        "kind": "push",
        "point": [0.45, 0.0],
        "direction": [1.0, 0.0],
        "speed": 0.2,
        "expected_gain": 9.5,
        "chosen_because": "push it: tells its centre of mass",
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
        "parts": [{"footprint": BOX, "path": WAY}],
        "goal_from": 0.5,
        "goal_to": 1.0,
        "changed": None,
        "why_unknown": [],
        "stopped": [],
        "broken": "",
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
    for words in (
        "tells its centre of mass",
        "support_tilt",
        "near enough",
        "1.2 mm",
        "undetermined",
    ):
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


def test_a_story_that_was_stopped_has_a_page_that_says_what_happened(told, tmp_path):
    told["explored"] = {"actions": [], "properties": {"links": [], "undetermined": []}}
    told["why_unknown"] = why_unknown(told["explored"]["properties"])
    told |= {"pushed": None, "truth": None, "compared": [], "broken": "robot_sim ended with -9"}
    told["stopped"] = ["no pusher/pose for 5 s"]
    page = write_exploration(told, tmp_path).read_text()
    for words in (
        "robot_sim ended with -9",
        "no pusher/pose for 5 s",
        "not pushed to the goal",
        "truth was not revealed",
        "there is no estimate",
    ):
        assert words in page


def test_the_picture_shows_pushes_on_both_parts_with_their_numbers_inside_the_axes(told):
    beside = [[x + 0.1, y + 0.05, yaw, t] for x, y, yaw, t in WAY]
    told["parts"].append({"footprint": BOX, "path": beside})
    first = told["explored"]["actions"][0]
    actions = [
        first | {"part": 1},
        first | {"part": 2, "point": [0.62, 0.2], "direction": [0.0, -1.0]},
    ]
    figure = _map(told, (0.0, 1.0), actions)
    (axes,) = figure.axes
    figure.draw_without_rendering()
    frame = axes.get_window_extent()
    numbers = {text.get_text(): text.get_window_extent() for text in axes.texts if text.get_text()}
    assert set(numbers) == {"1", "2"}
    for box in numbers.values():
        assert frame.x0 <= box.x0 <= box.x1 <= frame.x1
        assert frame.y0 <= box.y0 <= box.y1 <= frame.y1
    arrows = [text.arrow_patch for text in axes.texts if hasattr(text, "arrow_patch")]
    assert [to_hex(arrow.get_edgecolor()) for arrow in arrows] == list(COLOURS)
    drawn = {to_hex(line.get_color()) for line in axes.lines}
    assert drawn == set(COLOURS)  # outlines of both


@pytest.mark.parametrize(
    ("told_of", "words"),
    [
        ({"error": 5.17}, "does not fit these pushes (error 5.17 times the noise)"),
        ({"refused": "slides too little"}, "no fit to all pushes: slides too little"),
        ({"links": []}, "there is no estimate"),
        ({"structure": "undecided", "error": 0.8}, "moved as one body"),
        ({"structure": "rigid", "error": 0.8}, "take them apart and push or lift each"),
    ],
)
def test_it_says_in_plain_words_why_nothing_is_known(told, told_of, words):
    properties = {"links": [{}, {}], "undetermined": ["link_1.mass", "link_2.mass"], "said": ["-"]}
    told["explored"]["actions"] = []
    told["explored"]["properties"] = properties | told_of
    assert words in describe(told["explored"])
    told["explored"]["properties"] = properties | {"structure": "jointed", "error": 0.8}
    lines = describe(told["explored"]).splitlines()
    assert lines[-2:] == ["-", "stopped: all parameters are known to the wanted width"]


def test_a_push_that_was_stopped_says_so(told, tmp_path):
    why = "the contact bears 30.0 N, more than 25 N"
    told["explored"]["actions"][0]["stopped"] = why
    assert f"stopped: {why}" in describe(told["explored"]).splitlines()[0]
    assert why in write_exploration(told, tmp_path).read_text()


def test_what_was_explored_is_told_in_lines(told):
    lines = describe(told["explored"]).splitlines()
    assert lines[0].startswith("1. push it: tells its centre of mass; at (0.450, 0.000) m")
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
