"""Every numeric option of every verb has a range, and every path to write to is tried first."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactile_dynamics_ros.cli.demo import DURATION
from tactile_dynamics_ros.cli.live import MAGNITUDE, PACE
from tactile_dynamics_ros.cli.main import build_parser, main
from tactile_dynamics_ros.core.manipulation.excitation import ExcitationConfig
from tactile_dynamics_ros.core.options import (
    COUNT,
    FINITE,
    POSITIVE,
    SEED,
    Number,
    Numbers,
    file_to_write,
    folder_to_write,
    path_to_write,
    span,
)

TEXT_OPTIONS = {
    "effects": "names of effects",
    "effect": "names of effects",
    "hidden": "an effect, none or random",
    "object": "an object by name or number: the scene decides",
    "without": "names of nodes",
    "scene": "hand or table, checked where the object is",
    "simulate": "true or false",
    "config": "a file to read",
    "namespace": "a name",
    "robot": "a name or a file to read",
    "remap": "names of topics",
    "world_frame": "a name",
    "assume": "a name",
    "effect_file": "a file to read",
    "export": "a format",
    "tool": "a file to read",
    "shape": "a file to read",
    "prior": "a file to read",
    "wrist": "a file to read",
    "reference": "a topic (calibrate)",
    "finger": "a name",
    "host": "an address",
    "scheduler": "an address",
    "say": "an answer",
    "urdf": "a file to read",
    "push": "a name in a data set",
    "bag": "a recording to read",
    "clouds": "files to read",
    "source": "a file to read",
    "files": "files to read",
    "topics": "names",
    "topic": "a name",
    "service": "a name",
    "node": "a name",
    "parameter": "a name",
    "value": "any yaml",
    "name": "a name",
    "arguments": "those of ROS",
}
"""Options without a range, by name: what they hold instead of a number."""
SIGNED = {
    "push --goal",
    "push --from",
    "push --to",
    "estimate --shape-pose",
    "excite --arm",
    "shape --support",
    "import kuka-ft-imu --imu-delay",
}
"""Options for which a negative number means something."""
ZERO_MEANS = SIGNED | {
    "synthetic held --magnitude",
    "synthetic held --contact-breaks",
    "synthetic held --pose-gaps",
    "synthetic pushed --magnitude",
    "synthetic pushed --variation",
    "demo --magnitude",
    "sim --magnitude",
    "excite --rotation",
    "excite --translation",
    "view --port",
    "import goal-pushes-zhou2017 --log",
    "import pushes-zhou2016 --pushes",
}
"""Options for which 0 means something; seeds beside them."""
WRITERS = {"out", "save", "keep", "logs"}
"""Options that say where something is written."""


def options(
    parser: argparse.ArgumentParser | None = None, words: str = ""
) -> Iterator[tuple[str, argparse.Action]]:
    """Options of every verb and of every form that a verb has, with what is typed before them."""
    for action in (parser or build_parser())._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, form in action._name_parser_map.items():
                yield from options(form, f"{words} {name}".strip())
        elif action.nargs != 0 and words and not isinstance(action, argparse._HelpAction):
            yield f"{words} {(action.option_strings or [action.dest])[-1]}", action


NUMERIC = [
    (name, action)
    for name, action in options()
    if action.type is not None
    and not action.choices
    and action.dest not in WRITERS | {"clouds", "between"}
]


def refuses(action: argparse.Action, text: str) -> bool:
    try:
        action.type(text)
    except argparse.ArgumentTypeError:
        return True
    return False


def test_an_option_without_a_range_is_named_with_its_reason():
    loose = [
        name
        for name, action in options()
        if action.type in (int, float)
        or (action.type in (None, Path) and not action.choices and action.dest not in TEXT_OPTIONS)
    ]
    assert loose == []


def test_the_walk_meets_the_options_of_forms_too():
    names = {name for name, _ in NUMERIC}
    assert {"synthetic held --duration", "view --port", "train --units", "excite --arm"} <= names
    assert len(names) > 50


@pytest.mark.parametrize(("name", "action"), NUMERIC, ids=[name for name, _ in NUMERIC])
def test_a_numeric_option_takes_numbers_of_its_range_only(name, action):
    for text in ("nan", "inf", "-inf", "1e999", "many", "", "1,many"):
        assert refuses(action, text), text
    assert refuses(action, "-1") is (name not in SIGNED)
    zero = name in ZERO_MEANS or name.endswith("--seed")
    assert refuses(action, "0") is not zero
    if isinstance(action.default, int | float) and not isinstance(action.default, bool):
        assert not refuses(action, str(action.default))


def test_an_option_that_names_a_place_to_write_is_tried_before_any_work():
    types = {file_to_write, folder_to_write, path_to_write}
    for name, action in options():
        if action.dest in WRITERS:
            own = name == "shape --out"  # its ending says the format as well
            assert own or action.type in types, name
            assert refuses(action, "/proc/x.ply"), name


@pytest.mark.parametrize(
    ("number", "good", "bad", "words"),
    [
        (POSITIVE, "1e-3", "0", "a number above 0"),
        (COUNT, "7", "7.5", "a whole number of at least 1"),
        (SEED, "0", str(2**31), "a whole number from 0 to 2147483647"),
        (SEED, "1", "9" * 400, "a whole number from 0 to"),
        (FINITE, "-1e9", "-inf", "a finite number"),
        (Number(high=3.0), "-5", "3.1", "a number of at most 3"),
        (Number(1.0, 2.0, above=True), "1.5", "1", "a number from 1 to 2, not 1 itself"),
        (Numbers(FINITE), "-1,2", "1,,2", "numbers with commas between them"),
        (Numbers(POSITIVE, 2), "1,2", "1", "2 numbers with commas between them"),
    ],
)
def test_a_refused_number_is_told_with_what_was_expected(number, good, bad, words):
    number(good)
    with pytest.raises(argparse.ArgumentTypeError) as refused:
        number(bad)
    assert str(refused.value).startswith(f"'{bad}', expected {words}")


def test_a_span_has_an_order_and_may_be_open():
    assert span("2,inf") == (2.0, math.inf)
    for text in ("5,2", "nan,2", "1,nan", "1", "-inf,2", "2,2"):
        with pytest.raises(argparse.ArgumentTypeError, match="START"):
            span(text)


def test_paths_to_write_are_refused_for_what_lies_there(tmp_path):
    file = tmp_path / "file"
    file.touch()
    for type_of, text, words in (
        (file_to_write, str(tmp_path), "is a folder"),
        (folder_to_write, str(file), "is a file"),
        (folder_to_write, str(file / "below"), "Not a directory"),
        (file_to_write, "", "is empty"),
    ):
        with pytest.raises(argparse.ArgumentTypeError, match=words):
            type_of(text)
    assert file_to_write(str(tmp_path / "new" / "deep.json")) == str(tmp_path / "new" / "deep.json")
    assert os.listdir(tmp_path) == ["file"]


def test_a_number_with_a_minus_is_the_value_of_an_option(capsys):
    assert main(["excite", "--object", "box_0", "--arm", "-1,2"]) == 2
    assert "--arm goes with a recording" in capsys.readouterr().err


def test_commands_and_nodes_refuse_the_same_numbers():
    from tactile_dynamics_ros.ros.pacing import PaceConfig
    from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobotConfig

    for config, field, number in (
        (SimulatedRobotConfig, "hidden_magnitude", MAGNITUDE),
        (PaceConfig, "real_time_factor", PACE),
        (ExcitationConfig, "duration", DURATION),
    ):
        metadata = config.__dataclass_fields__[field].metadata
        assert (metadata["minimum"], metadata["maximum"]) == (number.low, number.high)
