"""Tables of other people's programs: read right, or asked about, never read wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from scipy.signal import savgol_filter

from benchmarks.layouts import ASKS, RIGHT, WRONG, judge_layout
from benchmarks.support.layouts import LAYOUTS, UNSEEN, UNTOLD, WristLog
from benchmarks.support.layouts.wrist_log import GRAVITY_W, INERTIA_PER_MASS
from benchmarks.support.layouts.writing import axes, write_table
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
from tactile_dynamics_ros.recording.importers.guess import Answers, guess_tables

SECONDS = 6.0


EVERY = LAYOUTS | UNSEEN | UNTOLD
MAYBE = "vectors_without_names"
"""A layout that may be asked about: an angle of three numbers beside a place of three, unnamed."""


@pytest.mark.parametrize("name", list(EVERY))
def test_a_layout_is_read_right_or_asked_about(name, tmp_path):
    verdict, why = judge_layout(name, EVERY[name], 31, tmp_path, SECONDS)
    expected = (ASKS,) if name in UNTOLD else (RIGHT, ASKS) if name == MAYBE else (RIGHT,)
    assert verdict in expected, why


def test_the_judge_sees_what_is_wrong(tmp_path):
    def swapped(log, folder):
        names = ["t", *axes("p"), *axes("q", "xyzw"), *axes("f"), *axes("m")]
        mixed = log.torque[:, [1, 0, 2]]
        columns = [log.time, log.position, log.quaternion, log.force, mixed]
        return [write_table(folder / "swapped.csv", names, columns)]

    assert judge_layout("swapped", swapped, 3, tmp_path, SECONDS) == (WRONG, "torque")


@pytest.fixture
def table(tmp_path):
    """Write a log as a table whose names say nothing of time and angles."""
    log = WristLog.draw(5, SECONDS)

    def write(**changes):
        columns = {"time": log.time, "position": log.position, "force": -log.force} | changes
        names = ["time", *axes("p"), *axes("q", "xyzw"), *axes("f"), *axes("m")]
        parts = [columns["time"], columns["position"], log.quaternion, columns["force"]]
        path = write_table(tmp_path / "table.csv", names, [*parts, -log.torque])
        path.with_suffix(".mapping.yaml").unlink(missing_ok=True)
        return path

    return log, write


def test_import_guess_shows_units_rates_frames_and_writes_a_mapping(table, capsys):
    log, write = table
    path = write()
    assert main(["import", str(path), "--guess"]) == 0
    text = capsys.readouterr().out
    for part in ("time in s: 100 Hz, 5.99 s", "px .. pz in m", "qx .. qw: quaternion"):
        assert part in text
    assert "fx .. fz in N, axes of the sensor; it is the load on the sensor" in text
    assert "first row" in text and "N in world axes" in text
    mapping = path.with_suffix(".mapping.yaml")
    assert yaml.safe_load(mapping.read_text())["contacts"]["wrist"]["force"]["scale"] == -1.0
    bag = str(path.with_name("bag.mcap"))
    assert main(["import", "csv", str(mapping), bag]) == 0
    capsys.readouterr()
    assert main(["estimate", bag, "--effects", "force_bias", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert abs(found["mass"]["value"] - log.mass) < 4.0 * found["mass"]["std"]
    truth = {"com": log.com, "inertia_com": log.mass * INERTIA_PER_MASS}
    for name, value in truth.items():
        error = np.abs(np.array(found[name]["value"]) - value)
        assert np.all(error < 4.0 * np.array(found[name]["std"])), name


def test_a_mapping_is_not_overwritten_and_a_file_alone_is_no_form(table, capsys):
    path = table[1]()
    assert main(["import", str(path), "--guess", "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)) >= {"mapping", "understood", "first_row"}
    assert main(["import", str(path), "--guess"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["import", str(path)]) == 2
    assert "add --guess" in capsys.readouterr().err
    assert main(["import", "misspelt", "a", "b"]) == 2
    assert "'misspelt' is unknown" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("column", "factor", "question"),
    [
        ("position", 10.0, "the position is"),
        ("position", 1e-3, "tell masses that differ by a factor"),
        ("time", 500.0, "tell masses that differ by a factor"),
        ("time", 0.1, "rises by 0.001 per row: which unit has it"),
        ("force", 0.0, "show no weight under any reading"),
    ],
)
def test_what_cannot_be_told_is_asked_in_a_line(table, capsys, column, factor, question):
    log, write = table
    path = write(**{column: factor * getattr(log, column)})
    assert main(["import", str(path), "--guess"]) == 2
    [line] = [x for x in capsys.readouterr().err.splitlines() if x.startswith("error: ")]
    assert question in line
    assert not path.with_suffix(".mapping.yaml").exists()


def test_an_answer_settles_the_question(table):
    log, write = table
    path = write(time=500.0 * log.time)
    guess = guess_tables([path], Answers({"time_unit": "ms", "position_unit": "m"}))
    assert "differ by a factor" in guess.question
    path = write(position=100.0 * log.position)
    assert "the position is" not in guess_tables([path], Answers({"position_unit": "cm"})).question
    mapping = guess_tables([path], Answers({"position_unit": "cm"})).mapping
    assert mapping["object_pose"]["position"]["unit"] == "cm"


def test_unknown_answers_are_refused(table, capsys):
    path = str(table[1]())
    for word, message in (
        ("speed=3", "unknown; expected one of"),
        ("speed", "expected KEY=VALUE"),
        ("orientation=sideways", "expected one of quaternion"),
    ):
        assert main(["import", path, "--guess", "--say", word]) == 2
        assert message in capsys.readouterr().err


def test_rows_without_time_take_a_rate(tmp_path):
    log = WristLog.draw(6, SECONDS)
    paths = UNTOLD["no_time"](log, tmp_path)
    assert "how many are there per second" in guess_tables(paths).question
    found = guess_tables(paths, Answers({"rate_hz": "100"}))
    assert found.mapping["object_pose"]["time"] == {"rate_hz": 100.0}


def imu_table(folder, signs=(1.0, 1.0, 1.0), unit=1.0):
    """A log without positions, and what an accelerometer reads whose axes have other signs."""
    log = WristLog.draw(7, SECONDS)
    moved = savgol_filter(log.position, 25, 5, deriv=2, delta=log.time[1], axis=0)
    measured = log.rotation.inv().apply(moved - GRAVITY_W) * signs / unit
    names = ["t", *axes("q", "xyzw"), *axes("imu_acc_"), *axes("gyro_"), *axes("f"), *axes("m")]
    columns = [log.time, log.quaternion, measured, 0.0 * measured, -log.force, -log.torque]
    return log, write_table(folder / "imu.csv", names, columns)


@pytest.mark.parametrize(("name", "unit"), [("m/s^2", 1.0), ("g", 9.80665)])
def test_accelerations_of_an_imu_stand_for_positions(tmp_path, name, unit):
    log, path = imu_table(tmp_path, unit=unit)
    guess = guess_tables([path])
    assert guess.question == ""
    assert guess.mapping["object_imu"]["specific_force"]["unit"] == name
    assert "object_pose" not in guess.mapping
    streams = read_mapping(guess.mapping, tmp_path, "imu.csv").streams
    assert streams.pose is None
    measured = streams.contacts["wrist"].force - log.mass * np.einsum(
        "nij,nj->ni", streams.imu.rotation, streams.imu.specific_force
    )
    in_sensor = np.einsum("nji,nj->ni", streams.imu.rotation, measured)
    assert np.all(np.std(in_sensor, axis=0) < 0.05 * log.mass * 9.81)


def test_an_imu_in_other_axes_is_asked_about(tmp_path):
    _, path = imu_table(tmp_path, signs=(1.0, -1.0, -1.0))
    assert "do not read gravity in the axes of the orientation" in guess_tables([path]).question


def test_joint_angles_are_no_orientation(tmp_path):
    log = WristLog.draw(8, SECONDS)
    angles = 0.3 * np.sin(log.time[:, None] + np.arange(6))
    columns = [log.time, angles, -log.force, -log.torque]
    for names, question in (
        ([f"q_{k}" for k in range(6)], "joint angles with the URDF of an arm make one"),
        ([f"position[{k}]" for k in range(6)], "joint angles need a yaml file with a URDF"),
    ):
        header = ["t", *names, *axes("f"), *axes("m")]
        path = write_table(tmp_path / "joints.csv", header, columns)
        assert question in guess_tables([path]).question
