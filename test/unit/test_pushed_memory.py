"""Pushed objects that were pushed before: combined, unless something differs; kept in files."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.core.planar.memory.combination import known_of, with_memory
from tactile_dynamics_ros.core.planar.properties import estimate as properties
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.recording.pushed.known_files import read_known, write_known

TRUTH = np.array([np.log(3.0), np.log(1.5), 0.01, -0.005])
STD = np.array([0.02, 0.1, 1e-3, 2e-3])
BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])


def estimated(values=TRUTH, std=STD, undetermined=()):
    force, mass = np.exp(values[:2])
    told = {
        "mass": (mass, mass * std[1]),
        "friction": (force / mass / 9.81, force / mass / 9.81 * np.hypot(std[0], std[1])),
        "friction_force_n": (force, force * std[0]),
        "com_x": (values[2], std[2]),
        "com_y": (values[3], std[3]),
        "friction_radius_m": (0.04, 1e-3),
        "inertia_zz": (1e-3, 1e-4),
    }
    return PushedEstimate(100, 2.0, told, tuple(undetermined), np.diag(np.square(std)), 1.0)


def test_the_same_object_is_combined_and_hardly_ever_doubted():
    rng, doubted, z = np.random.default_rng(3), 0, []
    for _ in range(300):
        first, second = (estimated(TRUTH + STD * rng.normal(size=4)) for _ in range(2))
        both, changed = with_memory(first, known_of(second, "before"))
        doubted += bool(changed)
        if not changed:
            assert_allclose(np.diag(both.covariance), 0.5 * STD**2)
            z.append((np.log(both.values["mass"][0]) - TRUTH[1]) / (STD[1] / np.sqrt(2.0)))
            force, mass = both.values["friction_force_n"][0], both.values["mass"][0]
            assert both.values["friction"][0] == pytest.approx(force / mass / 9.81)
    assert doubted <= 2
    assert np.std(z) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize(
    ("row", "name"), [(0, "friction force"), (1, "mass"), (3, "centre of mass")]
)
def test_what_differs_is_named_and_not_averaged(row, name):
    other = TRUTH.copy()
    other[row] += 7.0 * STD[row]
    found = estimated(other)
    kept, changed = with_memory(found, known_of(estimated(), "before"))
    assert changed == [name]
    assert kept is found


def test_what_one_recording_does_not_tell_comes_from_the_other():
    wide = np.array([0.02, 0.6, 1e-3, 2e-3])
    shifted = TRUTH + [0.0, 0.5, 0.0, 0.0]
    lacking = ("mass", "friction", "inertia_zz")
    both, changed = with_memory(estimated(shifted, wide, lacking), known_of(estimated(), "before"))
    assert changed == []
    assert both.values["mass"] == pytest.approx((1.5, 0.15), rel=1e-6)
    assert both.undetermined == ("inertia_zz",)
    neither, _ = with_memory(
        estimated(shifted, wide, lacking), known_of(estimated(TRUTH, wide, lacking), "before")
    )
    assert neither.undetermined == lacking
    assert neither.values["mass"][1] / neither.values["mass"][0] == pytest.approx(0.6)
    assert_allclose(neither.covariance[0, 0], 0.5 * STD[0] ** 2)


def test_an_object_is_read_as_it_was_written(tmp_path):
    known = KnownPushed(TRUTH, np.diag(STD**2), "run", ("mass",), 3)
    found = read_known(write_known(known, tmp_path / "block.yaml"))
    assert_allclose(found.values, known.values)
    assert_allclose(found.covariance, known.covariance)
    assert (found.undetermined, found.recordings) == (("mass",), 3)
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(BadInputError, match="no file of an object"):
        write_known(known, tmp_path / "mine.txt")
    with pytest.raises(BadInputError, match="expected a file"):
        read_known(tmp_path / "mine.txt")


@pytest.fixture
def bag(tmp_path):
    """A recording of a push; what it tells is put in by the tests."""
    time = np.arange(0.0, 1.0, 0.1)
    pose = np.column_stack([0.5 + 0.01 * time, np.zeros((len(time), 2))])
    point = np.column_stack([pose[:, 0] - 0.05, np.zeros(10), np.full(10, 0.02)])
    touch = (
        time,
        np.tile([2.0, 0.0, 0.0], (10, 1)),
        None,
        time,
        point,
        np.eye(3)[np.zeros(10, int)],
    )
    streams = PushedStreams(
        (LinkStream(time, pose, None, BLOCK),), {"pusher": PushContact("pusher", *touch)}
    )
    return PushedRecording(streams, "made").to_bag(tmp_path / "push")


def test_a_second_recording_starts_where_the_first_ended(bag, tmp_path, monkeypatch, capsys):
    found = [estimated()]
    monkeypatch.setattr(
        properties, "estimate_with_fit", lambda recording, effects: (found[0], None)
    )
    file = tmp_path / "block.yaml"
    assert main(["estimate", str(bag), "--save", str(file)]) == 0
    assert read_known(file).recordings == 1
    arguments = ["estimate", str(bag), "--prior", str(file), "--save", str(file), "--json"]
    assert main(arguments) == 0
    told = capsys.readouterr()
    document = json.loads(told.out.splitlines()[-1])
    assert document["prior"] == {"name": str(file), "recordings": 1, "changed": []}
    assert document["links"][0]["mass"]["std"] == pytest.approx(0.15 / np.sqrt(2.0))
    assert read_known(file).recordings == 2
    found[0] = estimated(TRUTH + [0.0, 0.8, 0.0, 0.0])
    before = file.read_text()
    assert main(arguments) == 2
    assert "another object or table: mass differ" in capsys.readouterr().err
    assert file.read_text() == before


def test_a_mass_that_nothing_told_begins_at_the_usual_friction():
    """Where a fit left it, on ice or on glue, is no knowledge; product and centre are."""
    spread = np.diag(np.square([0.05, 0.6, 1e-3, 2e-3]))
    told = KnownPushed(np.array([0.0, 3.0, 0.01, 0.0]), spread, "before")
    mean, root = told.beforehand(usual=3.0, spread=0.5)
    assert_allclose(mean, told.values)
    assert_allclose(np.linalg.inv(root.T @ root), spread)
    mean, root = replace(told, undetermined=("mass",)).beforehand(usual=3.0, spread=0.5)
    assert_allclose(mean, [0.0, -np.log(3.0), 0.01, 0.0])
    covariance = np.linalg.inv(root.T @ root)
    assert_allclose(np.diag(covariance)[[0, 2, 3]], np.diag(spread)[[0, 2, 3]])
    assert covariance[1, 1] == pytest.approx(0.05**2 + 0.5**2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"covariance": np.diag([1.0, 1.0, -1e-9, 1.0]).tolist()}, "covariance: a variance is"),
        ({"covariance": np.diag([1.0, 1.0, 0.0, 1.0]).tolist()}, "covariance: singular"),
        ({"values": [900.0, 0.0, 0.0, 0.0]}, "values: no object is like that"),
        ({"recordings": "abc"}, "recordings: 'abc', expected a whole number"),
        ({"undetermined": 5}, "undetermined: '5', expected a list of names"),
    ],
)
def test_a_memory_of_pushes_is_checked_whole(tmp_path, change, words):
    known = KnownPushed(TRUTH, np.diag(STD**2), "before", (), 2)
    file = write_known(known, tmp_path / "block.yaml")
    document = yaml.safe_load(file.read_text()) | change
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(BadInputError, match=f"block.yaml: {words}"):
        read_known(file)
