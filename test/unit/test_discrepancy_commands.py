"""The verbs compare, diagnose and explain on recordings whose hidden effect is known."""

from __future__ import annotations

import json

import pytest

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.synthetic.recordings import generate_at_whitened_rms, write_bag
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

SCENARIO = ScenarioOptions(duration=12.0)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    cases = {"clean": {}, "drag": {"viscous_drag": 2.5}, "vibration": {"motor_vibration": 3.0}}
    truths = {}
    for name, effects in cases.items():
        recording = generate_at_whitened_rms(31, effects, SCENARIO)
        write_bag(recording.streams, folder / name)
        truths[name] = recording.truth()["effects"]
    return folder, truths


def run(capsys, *arguments):
    code = main([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_clean_recording_is_adequate_in_all_three_verbs(bags, capsys):
    folder, _ = bags
    code, compared = run(capsys, "compare", folder / "clean")
    assert code == 0
    assert compared["adequate"] is True
    assert compared["p_value"] > 0.01
    assert compared["error"]["whitened_rms"] == pytest.approx(1.0, abs=0.05)
    assert compared["fails_where"] == []
    _, diagnosed = run(capsys, "diagnose", folder / "clean")
    assert (diagnosed["verdict"], diagnosed["effect"]) == ("adequate", None)
    _, explained = run(capsys, "explain", folder / "clean")
    assert (explained["verdict"], explained["effects"]) == ("adequate", [])


def test_hidden_drag_is_seen_named_added_and_the_error_falls(bags, capsys):
    folder, truths = bags
    _, compared = run(capsys, "compare", folder / "drag")
    assert compared["adequate"] is False
    assert compared["error"]["whitened_rms"] > 1.5
    places = compared["fails_where"]
    common = {"channel", "condition", "share_of_error"}
    assert [set(place) - common for place in places] == [
        {"regime", "p_value"},
        *[set()] * (len(places) - 1),
    ]
    _, diagnosed = run(capsys, "diagnose", folder / "drag")
    assert diagnosed["verdict"] == "missing_effect"
    assert diagnosed["effect"] == "viscous_drag"
    assert diagnosed["candidates"][0]["name"] == "viscous_drag"
    assert "viscous" in diagnosed["sentence"]
    error = diagnosed["error"]
    assert error["after"] < 1.1 * error["noise_floor"] < error["before"]
    truth = truths["drag"]["viscous_drag"]["parameters"]["c"]["value"]
    code, estimate = run(capsys, "estimate", folder / "drag", "--effects", "viscous_drag")
    assert code == 0
    fitted = estimate["effects"]["viscous_drag"]["c"]
    assert abs(fitted["value"] - truth) < 4 * fitted["std"]


def test_explanation_writes_its_report(bags, capsys, tmp_path):
    folder, _ = bags
    code, explained = run(capsys, "explain", folder / "drag", "--out", tmp_path)
    assert code == 0
    assert [step["added"] for step in explained["steps"]] == [None, "viscous_drag"]
    assert explained["steps"][1]["error"] < explained["steps"][0]["error"]
    page = (tmp_path / "report.html").read_text()
    assert "The error falls" in page and "viscous_drag" in page
    assert (tmp_path / "steps.png").stat().st_size > 1000


def test_adding_the_named_effect_makes_the_model_adequate(bags, capsys):
    folder, _ = bags
    _, compared = run(capsys, "compare", folder / "drag", "--effects", "viscous_drag")
    assert compared["adequate"] is True


def test_vibration_is_not_given_a_name_but_a_frequency(bags, capsys):
    folder, truths = bags
    _, diagnosed = run(capsys, "diagnose", folder / "vibration")
    assert (diagnosed["verdict"], diagnosed["effect"]) == ("unexplained", None)
    hidden = truths["vibration"]["motor_vibration"]["signature"]
    assert diagnosed["unexplained"]["frequency_hz"] == pytest.approx(
        hidden["frequency_hz"], rel=0.02
    )


def test_unknown_effect_is_refused_in_one_line(bags, capsys):
    folder, _ = bags
    assert main(["diagnose", str(folder / "clean"), "--effects", "no_such_effect"]) == 2
    printed = capsys.readouterr().err.strip()
    assert "no_such_effect" in printed and "Traceback" not in printed
