"""The verdict `convention`: in documents, on the command line, never where nothing is mistaken."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.conventions import OF_IMU, mistaken
from benchmarks.support.tables import WristOptions, wrist_table
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import (
    diagnosis_document,
    explanation_document,
    explanation_sentence,
)
from tactile_dynamics_ros.core.discrepancy.explanation import explain
from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def wrist(seed, mistake="", form=0, **options):
    table, body = wrist_table(seed, WristOptions(imu=mistake in OF_IMU, **options))
    return (mistaken(table, mistake, form) if mistake else table).streams(), body


def as_bag(streams, path):
    return str(Recording(streams, "test", {}, 1_700_000_000_000_000_000).to_bag(path))


@pytest.mark.parametrize("mistake", ["torque_unit", "time_unit"])
def test_a_mistaken_convention_is_the_verdict(mistake):
    streams, _ = wrist(21, mistake, duration=12.0)
    document = diagnosis_document(diagnose(question(streams)))
    assert document["verdict"] == "convention"
    assert document["effect"] is None and document["candidates"] == []
    found = document["convention"]
    assert found["name"] == mistake and mistake not in found["others"]
    assert found["error_after"] < 1.1 < document["error"]["before"]
    assert f"--assume {mistake}" in document["sentence"]


def test_equal_readings_are_told_beside_the_first():
    """Torques in kgf cm are as many times too large as forces in kgf are too small, nearly."""
    streams, body = wrist(22, "torque_unit", 2, duration=12.0)
    found = diagnosis_document(diagnose(question(streams)))["convention"]
    assert {found["name"], *found["others"]} == {"torque_unit", "force_unit"}


def test_noise_of_a_slow_motion_does_not_choose_the_unit():
    """Positions in cm leave more noise of accelerations than if they were in mm."""
    slow = {"band_hz": (0.08, 0.3), "position_std": 3e-4, "duration": 12.0}
    streams, _ = wrist(30, "position_unit", 1, **slow)
    found = diagnose(question(streams)).convention
    assert found.change == "positions are in cm, not m"
    assert found.error_after < 1.1


def test_nothing_is_read_otherwise_that_fits():
    streams, _ = wrist(23, duration=12.0)
    model = question(streams)
    document = diagnosis_document(diagnose(model))
    assert (document["verdict"], document["convention"]) == ("adequate", None)
    assert model.convention() is None


@pytest.mark.parametrize(("effect", "size"), [("viscous_drag", 3.0), ("force_bias", 3.0)])
def test_an_effect_is_no_convention(effect, size):
    made = generate(24, {effect: size}, ScenarioOptions(duration=12.0, physics_rate_hz=100.0))
    assert question(made.streams).convention() is None


def test_explain_reads_right_first_and_then_names_the_effect():
    streams, _ = wrist(25, "gravity_direction", 0, effects=(("viscous_drag", 3.0),))
    found = explain(question(streams))
    document = explanation_document(found)
    assert document["steps"][1]["added"].startswith("read as gravity_direction (gravity acts up")
    assert document["effects"] == ["viscous_drag"]
    assert document["convention"]["name"] == "gravity_direction"
    assert document["verdict"] == "adequate"
    assert document["sentence"].startswith("Read as gravity_direction: ")
    unsure = explanation_sentence(replace(found, verdict="unexplained"))
    assert unsure.startswith("Read as gravity_direction (in doubt, since something remains): ")
    errors = [step["error"] for step in document["steps"]]
    assert errors[0] > errors[1] > errors[2]


def two(first, second, seed):
    table, _ = wrist_table(seed, WristOptions(duration=12.0))
    return explain(question(mistaken(mistaken(table, first, seed), second, seed).streams()))


def test_two_conventions_are_read_one_after_the_other():
    found = two("torque_unit", "quaternion_order", 40)
    assert [one.name for one in found.conventions] == ["quaternion_order", "torque_unit"]
    assert (found.verdict, found.effects) == ("adequate", ())


def test_unit_and_sign_of_torques_are_one_reading():
    found = two("torque_unit", "torque_sign", 42)
    assert [one.name for one in found.conventions] == ["torque_unit"]
    assert found.conventions[0].change == "torques are in kgf cm, not N m, and negated"
    assert (found.verdict, found.effects) == ("adequate", ())


def test_gravity_and_a_sign_are_two_conventions():
    """Lengths in mm, by which accelerations count for nothing, look better than the recording."""
    found = two("gravity_direction", "force_sign", 40)
    assert [one.name for one in found.conventions] == ["force_sign", "gravity_direction"]
    assert (found.verdict, found.effects) == ("adequate", ())


def test_a_diagnosis_says_that_more_than_one_convention_may_be_wrong():
    table, _ = wrist_table(40, WristOptions(duration=12.0))
    table = mistaken(mistaken(table, "torque_unit", 40), "quaternion_order", 40)
    document = diagnosis_document(diagnose(question(table.streams())))
    assert document["convention"]["name"] == "quaternion_order"
    remains = document["error"]["after"] / document["error"]["noise_floor"]
    assert f"{remains:.1f} times the noise. More may be wrong" in document["sentence"]
    assert "Correct the recording" not in document["sentence"]


def test_a_sign_beside_a_drag_is_read_right_before_the_drag_is_named():
    """The right reading leaves much less, and still less beside the drag."""
    streams, _ = wrist(12, "torque_sign", 12, effects=(("viscous_drag", 2.0),))
    found = explain(question(streams))
    assert [one.name for one in found.conventions] == ["torque_sign"]
    assert (found.verdict, found.effects) == ("adequate", ("viscous_drag",))


def test_three_conventions_are_not_believed():
    table, _ = wrist_table(41, WristOptions(duration=12.0))
    for name in ("gravity_direction", "force_sign", "torque_unit"):
        table = mistaken(table, name, 41)
    found = explain(question(table.streams()))
    assert len(found.conventions) == 3
    assert (found.verdict, found.effects) == ("unexplained", ())
    document = explanation_document(found)
    assert document["convention"] is None and len(document["steps"]) == 1
    assert document["error"]["after"] == document["error"]["before"]
    assert document["sentence"].startswith("Several readings of the numbers fit in turn (")


def test_a_recording_is_read_as_assumed(tmp_path, capsys):
    streams, body = wrist(26, "torque_unit", 0, duration=12.0)
    bag = as_bag(streams, tmp_path / "bag")
    assert main(["estimate", bag, "--assume", "torque_unit", "--json"]) == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert "read as torque_unit: torques are in N mm, not N m" in printed.err
    assert found["mass"]["value"] == pytest.approx(body.mass, abs=4.0 * found["mass"]["std"])
    deviation = (np.array(found["com"]["value"]) - body.com) / found["com"]["std"]
    assert np.all(np.abs(deviation) < 4.0)
    assert main(["compare", bag, "--assume", "nothing"]) == 2
    assert "--assume nothing: expected one of force_sign" in capsys.readouterr().err


def test_the_report_tells_the_convention(tmp_path, capsys):
    streams, _ = wrist(27, "torque_unit", 0, duration=12.0)
    bag = as_bag(streams, tmp_path / "bag")
    assert main(["diagnose", bag, "--out", str(tmp_path / "report")]) == 0
    assert "(torque_unit): torques are in N mm, not N m" in capsys.readouterr().out
    page = (tmp_path / "report" / "report.html").read_text()
    assert "torques are in N mm, not N m" in page


def test_accelerations_in_g_are_refused_by_estimate_and_read_if_assumed(tmp_path, capsys):
    streams, body = wrist(28, "acceleration_unit", 0, duration=12.0)
    bag = as_bag(streams, tmp_path / "bag")
    assert main(["estimate", bag]) == 2
    assert "--assume acceleration_unit" in capsys.readouterr().err
    assert main(["diagnose", bag, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["convention"]["name"] == "acceleration_unit"
    assert main(["estimate", bag, "--assume", "acceleration_unit", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["mass"]
    assert found["value"] == pytest.approx(body.mass, abs=4.0 * found["std"])


def test_forces_in_millinewton_are_not_dropped_as_absurd(tmp_path):
    streams, _ = wrist(29, "force_unit", 1, duration=6.0)
    assert np.abs(streams.contacts["wrist"].force).max() > 1.1e4
    bag = as_bag(streams, tmp_path / "bag")
    assert len(Recording.from_bag(bag).streams.contacts["wrist"].time) == len(streams.pose.time)
