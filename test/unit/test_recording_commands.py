"""The offline commands: JSON on stdout, one line on stderr, exit codes."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from synthetic_recording import COM, INERTIA_COM, MASS, held_box

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.pushed import recorded_model
from tactile_dynamics_ros.report.numbers import with_uncertainty


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> str:
    """Return a clean recording of ten seconds."""
    folder = tmp_path_factory.mktemp("bags")
    return str(held_box(seconds=10.0).to_bag(folder / "box.mcap"))


def test_estimate_prints_the_promised_json(bag, capsys):
    assert main(["estimate", bag, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    promised = {
        "samples",
        "duration_s",
        "mass",
        "com",
        "inertia_com",
        "pseudo_inertia_eigenvalues",
        "dynamic_parameters",
        "effects",
        "error",
        "undetermined",
    }
    assert promised <= set(document)
    assert set(document["error"]) == {"force_rms_n", "torque_rms_nm", "whitened_rms"}
    assert document["mass"]["value"] == pytest.approx(MASS, rel=0.005)
    np.testing.assert_allclose(document["com"]["value"], COM, atol=5e-4)
    inertia, std = (np.array(document["inertia_com"][key]) for key in ("value", "std"))
    assert np.all(np.abs(inertia - INERTIA_COM) < 4.0 * std)
    assert min(document["pseudo_inertia_eigenvalues"]) > 0.0
    assert np.shape(document["dynamic_parameters"]["covariance"]) == (10, 10)
    assert document["error"]["whitened_rms"] == pytest.approx(1.0, abs=0.1)


def test_estimate_speaks_to_people(bag, capsys):
    assert main(["estimate", bag]) == 0
    text = capsys.readouterr().out
    assert re.search(r"mass +0\.40\d+ +0\.000\d+ +kg", text)
    assert "contacts index, middle, ring, thumb" in text
    assert "times the stated sensor noise" in text


def test_estimate_adds_effects_by_name(bag, capsys):
    assert main(["estimate", bag, "--effects", "viscous_drag", "--json"]) == 0
    effects = json.loads(capsys.readouterr().out)["effects"]
    (parameter,) = effects["viscous_drag"].values()
    assert abs(parameter["value"]) < 5.0 * parameter["std"]
    assert parameter["unit"]


def test_estimate_reads_remapped_topics(bag, tmp_path, capsys):
    assert main(["estimate", bag, "--remap", "/nowhere:=/object/pose"]) == 2
    assert "/nowhere is not in" in capsys.readouterr().err
    assert main(["estimate", bag, "--remap", "typo"]) == 2
    assert "expected /recorded/topic:=/meant/topic" in capsys.readouterr().err


def test_one_topic_may_stand_for_several(bag, capsys):
    twice = ["--remap", "/object/pose:=/object/pose", "--remap", "/object/pose:=/contact/box/pose"]
    assert main(["estimate", bag, *twice, "--json"]) == 0
    assert "/contact/box/pose: no force topic beside it" in capsys.readouterr().err


def test_estimate_uses_only_a_part_where_asked(bag, capsys):
    assert main(["estimate", bag, "--between", "2,8", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["duration_s"] == pytest.approx(6.0, abs=0.1)
    for wrong in ("2", "8,2", "a,b"):
        assert main(["estimate", bag, "--between", wrong]) == 2
        assert f"--between: '{wrong}', expected" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["estimate", "/no/such.mcap"], "no such file or directory"),
        (["estimate", "BAG", "--effects", "magic"], "effect 'magic' is unknown"),
        (["estimate", "BAG", "--effects", "viscous_drag,viscous_drag"], "named twice"),
        (["import", "csv", "/no/such.yaml", "/tmp/never.mcap"], "no such file"),
        (["import", "unheard", "a", "b"], "'unheard' is unknown"),
    ],
)
def test_bad_input_is_one_line_and_code_two(bag, arguments, message, capsys):
    arguments = [bag if a == "BAG" else a for a in arguments]
    assert main([*arguments, *(["--json"] if arguments[0] == "estimate" else [])]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ") and message in captured.err
    assert captured.err.count("\n") == 1


def test_a_motionless_recording_names_what_it_leaves_open(tmp_path, capsys):
    still = held_box(seconds=4.0, motion=0.0).to_bag(tmp_path / "still.mcap")
    assert main(["estimate", str(still), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert {"inertia_xx", "inertia_yy", "inertia_zz"} <= set(document["undetermined"])
    assert document["mass"]["value"] == pytest.approx(MASS, rel=0.02)
    assert main(["estimate", str(still)]) == 0
    assert "* undetermined by this recording: " in capsys.readouterr().out


def test_numbers_of_a_model_that_does_not_fit_are_no_answer(tmp_path, capsys):
    recording = held_box(seconds=4.0)
    for contact in recording.streams.contacts.values():
        contact.force[:] = contact.force[:, [1, 2, 0]]
    assert main(["estimate", str(recording.to_bag(tmp_path / "axes.mcap")), "--json"]) == 3
    captured = capsys.readouterr()
    assert "mass" in json.loads(captured.out)
    assert "the model does not fit: the error is " in captured.err
    assert "`tactile-dynamics diagnose`" in captured.err


def test_problems_of_a_recording_are_told_on_stderr(tmp_path, capsys):
    recording = held_box(seconds=4.0)
    recording.streams.contacts["ring"].force[10] = np.nan
    path = recording.to_bag(tmp_path / "box.mcap")
    main(["estimate", str(path), "--json"])
    captured = capsys.readouterr()
    json.loads(captured.out)
    assert "note: /contact/ring/force: sample is not finite (dropped): 1" in captured.err


def test_import_writes_a_recording_and_tells_what_is_in_it(tmp_path, capsys):
    rows = "\n".join(f"{0.01 * k},0,0,0.5,0,0,0,1,0,0,4" for k in range(100))
    (tmp_path / "all.csv").write_text(f"t,x,y,z,qx,qy,qz,qw,fx,fy,fz\n{rows}\n")
    (tmp_path / "map.yaml").write_text(
        "object_pose: {file: all.csv, time: {columns: t}, position: {columns: [x, y, z]},"
        " quaternion: {columns: [qx, qy, qz, qw]}}\n"
        "contacts: {palm: {file: all.csv, time: {columns: t}, force: {columns: [fx, fy, fz]},"
        " position: {columns: [x, y, z]}}}\n"
    )
    out = tmp_path / "out.mcap"
    assert main(["import", "csv", str(tmp_path / "map.yaml"), str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["poses"] == 100 and summary["contacts"] == {"palm": 100}
    assert Recording.from_bag(out).streams.contacts["palm"].force[0, 2] == 4.0
    assert main(["import", "csv", str(tmp_path / "map.yaml"), str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.27574, 0.000109, ("0.27574", "0.00011")),
        (223.4, 11.2, ("223", "11")),
        (-3.4959, 0.0387, ("-3.496", "0.039")),
        (5.0, 0.0996, ("5.00", "0.10")),
        (2.0, 0.0, ("2", "0")),
        (3.1e7, 2e6, ("3.1000e+07", "2.0e+06")),
    ],
)
def test_values_are_rounded_to_their_uncertainty(value, std, text):
    assert with_uncertainty(value, std) == text


@pytest.mark.parametrize(
    "words", [("held", "--duration", "3"), ("pushed", "--count", "1")], ids=lambda words: words[0]
)
def test_a_name_that_ends_in_mcap_is_one_file_with_its_truth_beside_it(words, tmp_path):
    form, *options = words
    assert main(["synthetic", form, str(tmp_path / "run.mcap"), *options]) == 0
    assert main(["synthetic", form, str(tmp_path / "other"), *options]) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["other", "other.truth.json", "run.mcap", "run.truth.json"]
    with AnyReader([tmp_path / "run.mcap"]) as file, AnyReader([tmp_path / "other"]) as folder:
        assert file.message_count == folder.message_count > 0
        assert {c.topic for c in file.connections} == {c.topic for c in folder.connections}
    assert recorded_model(tmp_path / "run.mcap") == form
