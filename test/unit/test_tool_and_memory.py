"""Known bodies: tools that are taken out, objects that are remembered, and their files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from synthetic_recording import held_box

import tactile_dynamics_ros as td
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate, ModelError
from tactile_dynamics_ros.core.inertia.batch.knowledge import (
    nearest_body,
    with_memory,
    without_tool,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
    is_feasible,
)
from tactile_dynamics_ros.recording.yaml_files import read_body, write_body

TOOL = InertialParameters(0.9, np.array([0.0, 0.004, 0.05]), np.diag([3e-3, 2.5e-3, 1e-3]))
LOAD = InertialParameters(0.4, np.array([0.01, -0.006, 0.14]), np.diag([4e-4, 6e-4, 5e-4]))
STD = np.array([2e-3, *[1e-4] * 3, *[2e-5] * 6])


def estimate_of(phi, covariance, unknown=()):
    body = InertialParameters.from_dynamic_parameters(phi)
    return InertialEstimate(
        body, covariance, {}, ModelError(0.03, 1e-3, 1.0), unknown, 1000, 10.0, True
    )


def drawn(phi, rng, unknown=()):
    covariance = np.diag(STD**2)
    return estimate_of(phi + STD * rng.normal(size=10), covariance, unknown)


def test_a_load_without_its_tool_has_the_sum_of_both_covariances():
    rng, z = np.random.default_rng(3), []
    own = np.diag((0.5 * STD) ** 2)
    for _ in range(200):
        both = drawn(TOOL.dynamic_parameters + LOAD.dynamic_parameters, rng)
        tool = KnownBody(TOOL.dynamic_parameters + 0.5 * STD * rng.normal(size=10), own, "t")
        rest = without_tool(both, tool)
        z.append((rest.inertia.mass - LOAD.mass) / rest.parameter_std[0])
        np.testing.assert_allclose(rest.covariance, both.covariance + own)
    assert np.std(z) == pytest.approx(1.0, abs=0.15)


def test_what_is_left_can_exist_though_the_difference_cannot():
    light = InertialParameters(0.05, np.array([0.0, 0.0, 0.1]), np.diag([1e-6, 1e-6, 1e-6]))
    rng, met = np.random.default_rng(4), 0
    for _ in range(30):
        both = drawn(TOOL.dynamic_parameters + light.dynamic_parameters, rng)
        impossible = not is_feasible(both.inertia.dynamic_parameters - TOOL.dynamic_parameters)
        rest = without_tool(both, KnownBody.exact(TOOL, "t"))
        assert is_feasible(rest.inertia.dynamic_parameters)
        assert rest.inertia.mass == pytest.approx(0.05, abs=4 * STD[0])
        assert not impossible or "inertia_xx" in rest.not_excited
        met += impossible
    assert met > 10


def test_a_tool_that_weighs_more_than_what_was_carried_is_refused():
    light = estimate_of(LOAD.dynamic_parameters, np.diag(STD**2))
    with pytest.raises(BadInputError, match="cannot be part of what was carried"):
        without_tool(light, KnownBody.exact(TOOL, "gripper.urdf"))


def test_a_tool_is_taken_out_while_the_covariance_is_singular_to_rounding():
    """As in a grasp's first second, when the body is almost flat."""
    flat = np.zeros((10, 10))
    flat[0, 0], flat[1:4, 1:4] = STD[0] ** 2, np.diag(STD[1:4] ** 2)
    lever = np.random.default_rng(5).normal(size=(6, 4))
    flat[4:, 4:] = STD[4] ** 2 * (lever @ lever.T) - 1e-12 * STD[4] ** 2 * np.eye(6)
    scale = np.sqrt(np.diag(flat))
    assert np.linalg.eigvalsh(flat / np.outer(scale, scale))[0] < 0.0
    impossible = LOAD.dynamic_parameters.copy()
    impossible[9] = 1.001 * (impossible[4] + impossible[7])
    rest, distance = nearest_body(impossible, flat)
    assert is_feasible(rest.dynamic_parameters) and np.isfinite(distance)
    known = KnownBody(LOAD.dynamic_parameters, flat, "earlier")
    combined, comparison = with_memory(estimate_of(LOAD.dynamic_parameters, flat), known)
    assert not comparison.changed
    assert combined.parameter_std[0] == pytest.approx(STD[0] / np.sqrt(2.0), rel=1e-3)


def test_the_nearest_body_is_nearest_in_the_covariance():
    phi = LOAD.dynamic_parameters.copy()
    phi[9] = 3e-2  # I_zz above the sum of the others
    sure = np.diag(np.where(np.arange(10) == 9, 1e-4, 1e-9) ** 2)
    body, distance = nearest_body(phi, sure)
    assert distance > 0.0
    np.testing.assert_allclose(body.dynamic_parameters[:9], phi[:9], atol=1e-6)
    same, zero = nearest_body(LOAD.dynamic_parameters, sure)
    assert zero == 0.0
    np.testing.assert_allclose(same.dynamic_parameters, LOAD.dynamic_parameters)


def test_the_same_object_is_combined_and_another_is_not():
    rng = np.random.default_rng(5)
    known = KnownBody(LOAD.dynamic_parameters, np.diag(STD**2), "box", ("com_z", "mass"))
    doubted = 0
    for _ in range(300):
        both, comparison = with_memory(drawn(LOAD.dynamic_parameters, rng, ("com_z",)), known)
        doubted += bool(comparison.changed)
        if not comparison.changed:
            np.testing.assert_allclose(np.diag(both.covariance), 0.5 * STD**2, rtol=1e-6)
            assert both.not_excited == ("com_z",)
    assert doubted <= 2
    heavier = replace(LOAD, mass=LOAD.mass + 6 * np.sqrt(2.0) * STD[0])
    alone = estimate_of(heavier.dynamic_parameters, np.diag(STD**2))
    kept, comparison = with_memory(alone, known)
    assert comparison.changed == ["mass"]
    assert kept is alone


def test_a_body_is_read_as_it_was_written(tmp_path):
    known = KnownBody(LOAD.dynamic_parameters, np.diag(STD**2), "run", ("inertia_xz",), {}, 3)
    path = write_body(known, tmp_path / "box.yaml")
    found = read_body(path)
    np.testing.assert_array_equal(found.phi, known.phi)
    np.testing.assert_array_equal(found.covariance, known.covariance)
    assert (found.undetermined, found.recordings) == (("inertia_xz",), 3)
    assert write_body(known, path) == path
    (tmp_path / "other.txt").write_text("mine")
    with pytest.raises(BadInputError, match="no file of a body"):
        write_body(known, tmp_path / "other.txt")
    document = yaml.safe_load(path.read_text()) | {"dynamic_parameters": [1, 2]}
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(BadInputError, match="dynamic_parameters: expected finite numbers"):
        read_body(path)


def test_a_urdf_with_turned_axes_and_several_links_is_read(tmp_path):
    link = (
        '<link name="{}"><inertial><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/>'
        '<mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/>'
        "</inertial></link>"
    )
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="r">{link.format("a")}{link.format("b")}</robot>')
    known = read_body(f"{path}#b")
    body = InertialParameters.from_dynamic_parameters(known.phi)
    np.testing.assert_allclose(body.inertia_com, np.diag([2.0, 1.0, 2.5]), atol=1e-12)
    assert known.is_exact
    with pytest.raises(BadInputError, match="FILE#LINK; found a, b"):
        read_body(path)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return str(held_box(seconds=4.0).to_bag(tmp_path_factory.mktemp("bags") / "box.mcap"))


def test_the_command_remembers_an_object_and_notices_another(bag, tmp_path, capsys):
    file = str(tmp_path / "box.yaml")
    assert main(["estimate", bag, "--save", file]) == 0
    second = str(held_box(seconds=4.0, seed=1).to_bag(tmp_path / "again.mcap"))
    capsys.readouterr()
    assert main(["estimate", second, "--prior", file, "--save", file, "--json"]) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["prior"]["changed"] == []
    assert "together with 1 recordings" in err
    assert found["mass"]["std"] < td.estimate(td.read(second)).found.parameter_std[0]
    assert read_body(file).recordings == 2

    known = read_body(file)
    heavier = KnownBody(1.2 * known.phi, known.covariance, known.name, (), {}, 1)
    write_body(heavier, file)
    assert main(["estimate", second, "--prior", file, "--save", file]) == 2
    err = capsys.readouterr().err
    assert "mass" in err and "differ from" in err and "file of another object" in err
    np.testing.assert_allclose(read_body(file).phi, heavier.phi)


def test_the_command_takes_a_tool_out(bag, tmp_path, capsys):
    whole = td.estimate(td.read(bag))
    part = replace(whole.found.inertia, mass=0.3, inertia_com=0.7 * whole.found.inertia.inertia_com)
    file = write_body(KnownBody.exact(part, "part"), tmp_path / "tool.yaml")
    main(["estimate", bag, "--tool", str(file), "--json"])
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["mass"]["value"] == pytest.approx(whole.found.inertia.mass - 0.3, abs=1e-9)
    assert found["tool"]["mass"] == pytest.approx(0.3)
    assert "0.3 kg of" in err and "known exactly" in err
    assert main(["estimate", bag, "--tool", str(file), "--out", str(tmp_path / "r")]) == 2


def negative(document):
    document["covariance"][2][2] = -1e-6


def tilted(document):
    document["covariance"][0][1] = document["covariance"][1][0] = 1.0


def lopsided(document):
    document["covariance"][0][1] = 0.5 * document["covariance"][0][0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (negative, "covariance: a variance is -1e-06, expected none below zero"),
        (tilted, "covariance: a combination of values has a negative variance"),
        (lopsided, "covariance: is not symmetric"),
        ({"effects": 5}, "effects: '5', expected names with their parameters"),
        ({"effects": {"drag": 1}}, "effects: .*expected names with their parameters"),
        ({"recordings": "abc"}, "recordings: 'abc', expected a whole number"),
        ({"recordings": True}, "recordings: 'True', expected a whole number"),
        ({"undetermined": "mass"}, "undetermined: 'mass', expected a list of names"),
        ({"undetermined": [1]}, "undetermined: .*expected a list of names"),
        ({"lasting_covariance": [[0.0]]}, "lasting_covariance: expected"),
        ({"dynamic_parameters": [1e300] * 10}, "dynamic_parameters: expected finite numbers"),
    ],
)
def test_a_memory_is_checked_whole_and_refused_in_one_line(tmp_path, change, words):
    known = KnownBody(LOAD.dynamic_parameters, np.diag(STD**2), "before", (), {}, 2)
    file = write_body(known, tmp_path / "box.yaml")
    assert read_body(file).recordings == 2
    document = yaml.safe_load(file.read_text())
    change(document) if callable(change) else document.update(change)
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(BadInputError, match=f"box.yaml: {words}") as caught:
        read_body(file)
    assert "\n" not in str(caught.value)
