"""The door of files: what would block, never end or fill the memory is refused in one line."""

import os
import tracemalloc

import numpy as np
import pytest

from tactile_dynamics_ros.cli.bringup import read_configuration
from tactile_dynamics_ros.core.effects.formula import load_effects
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.manipulation.excitation import OffsetTable
from tactile_dynamics_ros.core.planar.network.weights import GraphWeights
from tactile_dynamics_ros.core.reading import (
    open_arrays,
    parse_yaml,
    read_json,
    read_mesh,
    read_text,
    read_yaml,
    require_file,
)
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.shape.object_shape import load_shape
from tactile_dynamics_ros.core.tactile.calibration import ForceCalibration
from tactile_dynamics_ros.core.tactile.network.weights import NetworkWeights
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.clouds import read_clouds
from tactile_dynamics_ros.recording.importers.csv_mapping import load_yaml
from tactile_dynamics_ros.recording.importers.tables import read_table
from tactile_dynamics_ros.recording.pushed.known_files import read_known
from tactile_dynamics_ros.recording.yaml_files import read_body, write_body

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n"
    for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
"""Nine lines that stand for a billion words."""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LAUGHS, "more than 200000 values with aliases written out"),
        ("x: &x {a: 1}\ny: &y {<<: [*x, *y]}", "alias 'y' is not known"),
        ("&a [*a]", "alias 'a' is not known"),
        ("[" * 100_000, "more than 50 levels deep"),
        ("a: " + "1:" * 400_000 + "1", "a number of 800001 digits"),
        ("a: " + "9" * 6000, "a number of 6000 digits"),
        ("a: 2001-99-99", "not valid yaml: month must be in 1..12"),
        ("a: !!python/object:os.system x", "could not determine a constructor"),
        ("? [1]\n: 2", "found unhashable key"),
        ("a: \0", "unacceptable character"),
        ("x" * 1_000_001, "1000001 characters of yaml"),
    ],
)
def test_yaml_that_grows_or_is_none_is_refused_with_its_place(text, words):
    tracemalloc.start()
    with pytest.raises(BadInputError, match="given.yaml") as caught:
        parse_yaml(text, "given.yaml")
    memory = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert words in str(caught.value) and "\n" not in str(caught.value)
    assert memory < 20e6


def test_yaml_with_aliases_and_merges_is_read():
    found = parse_yaml("a: &a {k: 1}\nb: {<<: *a, l: [1e-3, 2.5]}\nc: 12:30:00", "given.yaml")
    assert found["b"] == {"k": 1, "l": ["1e-3", 2.5]}


@pytest.mark.parametrize(
    "read",
    [
        read_text,
        read_yaml,
        read_json,
        read_mesh,
        read_body,
        read_known,
        read_table,
        load_effects,
        load_yaml,
        load_shape,
        Recording.from_bag,
        ForceCalibration.load,
        OffsetTable.from_file,
        NetworkWeights.load,
        GraphWeights.load,
        read_configuration,
        lambda path: read_clouds([path]),
        lambda path: load_robot(str(path)),
    ],
)
@pytest.mark.parametrize("name", ["pipe.yaml", "pipe.mcap", "pipe.ply"])
def test_a_pipe_in_place_of_a_file_is_refused_at_once(tmp_path, read, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(BadInputError) as caught:
        read(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_what_a_file_is_instead_is_said(tmp_path):
    with pytest.raises(BadInputError, match="is a folder, expected a map"):
        require_file(tmp_path, "a map")
    with pytest.raises(BadInputError, match="no such file, expected a file"):
        require_file(tmp_path / "none")
    with pytest.raises(BadInputError, match="name too long"):
        require_file(tmp_path / ("x" * 5000))
    with pytest.raises(BadInputError, match="device"):
        read_text("/dev/zero")


def test_a_text_without_end_is_not_read_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_dynamics_ros.core.reading.LARGEST_TEXT", 1000)
    (tmp_path / "long").write_text("x" * 1001)
    with pytest.raises(BadInputError, match="more than 1000 bytes"):
        read_text(tmp_path / "long")


def test_brackets_without_end_in_json_are_refused(tmp_path):
    (tmp_path / "deep.json").write_text("[" * 100_000)
    with pytest.raises(BadInputError, match="recursion"):
        read_json(tmp_path / "deep.json")


def test_arrays_that_expand_beyond_the_memory_are_not_loaded(tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_dynamics_ros.core.reading.LARGEST_ARRAYS", 1_000_000)
    np.savez_compressed(tmp_path / "zeros.npz", points=np.zeros(200_000))
    assert (tmp_path / "zeros.npz").stat().st_size < 5000
    with (
        pytest.raises(BadInputError, match="bytes of arrays, at most 1000000"),
        open_arrays(tmp_path / "zeros.npz"),
    ):
        raise AssertionError("opened")


def test_a_missing_array_is_said_in_one_line(tmp_path):
    np.savez(tmp_path / "a.npz", other=np.zeros(3))
    with (
        pytest.raises(BadInputError, match="'mean is not a file in the archive', expected a net"),
        open_arrays(tmp_path / "a.npz", "a net") as arrays,
    ):
        arrays["mean"]


def test_a_pipe_is_not_written_over(tmp_path, monkeypatch):
    from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
        InertialParameters,
        KnownBody,
    )

    os.mkfifo(tmp_path / "pipe.yaml")
    body = InertialParameters(0.3, np.zeros(3), np.diag([3e-3, 2.5e-3, 1e-3]))
    with pytest.raises(BadInputError, match="exists and is no file of a body"):
        write_body(KnownBody.exact(body, "part"), tmp_path / "pipe.yaml")
