"""Estimates and verdicts as typed messages; the package of their definitions."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from std_msgs.msg import Header
from synthetic_recording import MASS, held_box
from test_inertial_estimator import estimator, play, settled, status

import tactile_dynamics_ros
from tactile_dynamics_ros.recording.bag_files import read_messages
from tactile_dynamics_ros.ros.actions import interface
from tactile_dynamics_ros.ros.interface_build import PACKAGE, USES, main
from tactile_dynamics_ros.ros.recorder import Recorder
from tactile_dynamics_ros.ros.shell import LATCHED
from tactile_dynamics_ros.ros.typed_messages import effect_messages, verdict_message

__all__ = ["estimator"]
INTERFACES = Path(tactile_dynamics_ros.__file__).parents[1] / "interfaces"
ESTIMATE = "/inertial_estimator/estimate"
NEEDS = pytest.mark.skipif(
    interface("msg.Estimate") is None, reason="tactile_dynamics_msgs is not built; ./dev env"
)


def test_the_package_that_colcon_builds_has_every_definition():
    text = (INTERFACES / "CMakeLists.txt").read_text()
    generated = re.search(r"rosidl_generate_interfaces\((.*?)\)", text, re.DOTALL).group(1)
    files = {str(p.relative_to(INTERFACES)) for p in INTERFACES.glob("*/*.*")}
    assert {word for word in generated.split() if "/" in word} == files
    assert f"project({PACKAGE})" in text
    package = ElementTree.parse(INTERFACES / "package.xml").getroot()
    assert package.findtext("name") == PACKAGE
    depends = {entry.text for entry in package.findall("depend")}
    definitions = "".join((INTERFACES / file).read_text() for file in files)
    used = set(re.findall(r"^(\w+)/\w+", definitions, re.MULTILINE))
    assert depends == used | {"action_msgs"}
    assert set(USES) >= depends
    listed = generated.partition("DEPENDENCIES")[2].split()
    assert set(listed) == used
    assert used <= set(re.findall(r"find_package\((\w+) REQUIRED\)", text))


def test_without_a_compiler_the_build_ends_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr("shutil.which", lambda name: None if name == "g++" else f"/{name}")
    assert main() == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "cannot be built here; missing: g++" in said and "without actions" in said


@NEEDS
def test_the_estimate_of_a_held_box_is_published_and_recorded(estimator, tmp_path):
    estimates = estimator.follow(interface("msg.Estimate"), ESTIMATE, profile=LATCHED)
    recorder = Recorder(tmp_path / "run", [ESTIMATE])
    estimator.nodes.append(recorder)
    play(estimator, held_box(seconds=8.0).streams)
    estimator.until(lambda: settled(estimator, 700) and estimates and recorder.counts[ESTIMATE])
    newest, values = estimates[-1], status(estimator, "parameters")
    assert newest.inertia.m == pytest.approx(MASS, rel=0.01)
    covariance = np.reshape(newest.covariance, (10, 10))
    assert np.sqrt(covariance[0, 0]) == pytest.approx(float(values["mass_std"]), rel=0.05)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
    assert newest.header.frame_id == "object"
    assert newest.adequate and newest.error == pytest.approx(1.0, abs=0.15)
    assert list(newest.undetermined) == []
    recorder.close()
    assert len(list(read_messages(tmp_path / "run", ESTIMATE))) == recorder.counts[ESTIMATE]


DOCUMENT = {
    "verdict": "missing_effect",
    "effect": "viscous_drag",
    "group": [],
    "error": {"before": 2.0, "after": 1.0, "noise_floor": 1.1},
    "convention": None,
    "candidates": [
        {
            "name": "viscous_drag",
            "p_value": 1e-9,
            "parameters": {"c": {"value": 1.3, "std": 0.01, "unit": "N s/m"}},
        }
    ],
}


@NEEDS
def test_a_verdict_names_the_effect_and_its_remedy():
    verdict = verdict_message(DOCUMENT, "held", Header(frame_id="object"))
    assert (verdict.verdict, verdict.adequate) == ("missing_effect", False)
    assert (verdict.error, verdict.floor, verdict.effect) == (2.0, 1.1, "viscous_drag")
    assert verdict.remedy.startswith("Add it to the model, or move the object out of the liquid")
    (effect,) = effect_messages(DOCUMENT)
    assert (effect.name, list(effect.parameters), list(effect.units)) == (
        "viscous_drag",
        ["c"],
        ["N s/m"],
    )
    assert (list(effect.values), list(effect.stds), effect.p_value) == ([1.3], [0.01], 1e-9)


@NEEDS
def test_the_remedy_of_a_convention_is_how_to_read_the_numbers():
    read = {"name": "torque_unit", "change": "read torques in N mm"}
    document = DOCUMENT | {"verdict": "convention", "effect": None, "convention": read}
    verdict = verdict_message(document, "held", Header())
    assert (verdict.effect, verdict.remedy) == ("", "read torques in N mm")
