"""Tables of an arm's joints: names of columns, damaged rows, currents and their gains."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.conventions import in_common_units
from tactile_dynamics_ros.core.joints.estimate import estimate
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams
from tactile_dynamics_ros.recording.joints import JointRecording
from tactile_dynamics_ros.synthetic.joints import JointOptions, Payload, generate

IIWA = load_robot("allegro_iiwa").urdf
CURRENTS = np.array([0.08, 0.085, 0.1, 0.095, 0.2, 0.22, 0.3])
"""Amperes per N m of each drive."""


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    """File of the arm's URDF."""
    file = tmp_path_factory.mktemp("arm") / "arm.urdf"
    file.write_text(IIWA)
    return file


@pytest.fixture(scope="module")
def short():
    """Four seconds of an arm."""
    return generate(IIWA, 5, {}, JointOptions(duration=4.0, rate_hz=125.0)).streams


def columns_of(streams, friction=0.0):
    """Table of time, positions, currents, and what the controller wanted, which adds friction."""
    arm = Arm.from_urdf(IIWA, streams.names, "test")
    speed = np.gradient(streams.position, streams.time, axis=0)
    motion = arm.motion(streams.position, speed, np.zeros_like(speed))
    torque = arm.torque(motion, arm.inertia)
    wanted = (torque + friction * np.sign(speed)) * CURRENTS
    parts = [streams.time, streams.position, streams.effort * CURRENTS, wanted, torque]
    return np.column_stack(parts)


def write(path, table, head=""):
    """Write a table as loggers do."""
    np.savetxt(path, table, "%.9g", ",", header=head, comments="")
    return path


@pytest.mark.parametrize(
    ("time", "position", "effort", "first"),
    [
        ("timestamp", "actual_q_{}", "joint_torque_{}", 0),
        ("time_s", "q_{}", "tau_J_{}", 0),
        ("t", "state.q[{}]", "state.tau_J[{}]", 0),
        ("time", "q{}", "tau{}", 1),
        ("__time", "/joint_states/{}/position", "/joint_states/{}/effort", None),
    ],
)
def test_columns_are_known_by_the_names_that_robots_give(
    short, urdf, tmp_path, time, position, effort, first
):
    keys = short.names if first is None else [first + k for k in range(7)]
    head = [time, *(f.format(key) for f in (position, effort) for key in keys)]
    table = np.column_stack([short.time + 9.0, short.position, short.effort])
    read = JointRecording.read(write(tmp_path / "run.csv", table, ",".join(head)), urdf)
    assert read.streams.names == short.names and read.streams.gains is None
    np.testing.assert_allclose(read.streams.effort, short.effort, rtol=1e-6)
    np.testing.assert_allclose(read.streams.time, short.time, atol=1e-6)


def test_columns_without_names_are_named_by_remap_and_damaged_rows_left_out(short, urdf, tmp_path):
    table = np.column_stack([short.time + 3000.0, short.position, short.effort])
    damaged = table[:3].copy()
    damaged[0, 0], damaged[1, 3], damaged[2, 0] = 2.7e148, -1e120, 0.8
    file = write(tmp_path / "run.csv", np.concatenate([table[:1], damaged, table[1:]]))
    with pytest.raises(BadInputError, match="without names; say what they are"):
        JointRecording.read(file, urdf)
    remap = {"1": "time", "2-8": "position", "9-15": "effort"}
    read = JointRecording.read(file, urdf, remap=remap)
    np.testing.assert_allclose(read.streams.position, short.position, atol=1e-7)
    assert any("left out): 3" in line for line in read.problem_lines())
    for wrong, match in (({"1": "thyme"}, "expected time"), ({"90": "time"}, "no such column")):
        with pytest.raises(BadInputError, match=match):
            JointRecording.read(file, urdf, remap=wrong)
    with pytest.raises(BadInputError, match="one of each"):
        JointRecording.read(
            file, urdf, remap=remap | {"9-15": "position", "2-8": "effort", "3": "effort"}
        )
    milliseconds = write(tmp_path / "ms.csv", table * np.append(1e3, np.ones(14)))
    with pytest.raises(BadInputError, match="a time in s"):
        JointRecording.read(milliseconds, urdf, remap=remap)


def test_currents_take_the_gains_of_the_controller_that_recorded_them(short, urdf, tmp_path):
    names = ("actual_q", "actual_current", "target_current", "target_moment")
    head = ["timestamp", *(f"{name}_{k}" for name in names for k in range(7))]
    file = write(tmp_path / "run.csv", columns_of(short, friction=0.5), ",".join(head))
    read = JointRecording.read(file, urdf).streams
    np.testing.assert_allclose(read.gains, 1.0 / CURRENTS, rtol=0.05)
    np.testing.assert_allclose(read.effort / read.gains, short.effort * CURRENTS, rtol=1e-6)
    assert read.gain_std.max() < 0.1, "better known than by the URDF"
    by_urdf = JointRecording.read(
        write(tmp_path / "less.csv", columns_of(short)[:, :15], ",".join(head[:15])), urdf
    ).streams
    assert by_urdf.gain_std.min() > 2.0 * read.gain_std.max()


def test_a_payload_by_currents_of_unknown_gains_is_no_narrower_than_their_scale():
    load = Payload.draw(2.5, 3)
    options = JointOptions(duration=15.0, rate_hz=125.0, payload=load)
    full = generate(IIWA, 31, {"rotor_inertia": 1.0}, options).streams
    empty = generate(IIWA, 31, {"rotor_inertia": 1.0}, replace(options, payload=None)).streams
    read = [
        JointStreams(s.names, s.time, s.position, s.effort, IIWA, np.ones(7), np.full(7, 0.3))
        for s in (full.scaled(np.full(7, 0.6)), empty.scaled(np.full(7, 0.6)))
    ]
    payload = estimate(read[0], (), read[1]).payload
    assert payload.std[0] > 0.25 * payload.body.mass
    assert abs(payload.body.mass - 2.5) < 2.5 * payload.std[0]
    np.testing.assert_allclose(payload.body.com, load.com, atol=5e-3)


def test_stated_gains_are_taken_for_both_recordings(urdf, tmp_path, capsys):
    load = Payload.draw(2.5, 3)
    options = JointOptions(duration=15.0, rate_hz=125.0, payload=load)
    files = []
    for name, one in (("full", options), ("empty", replace(options, payload=None, repeat=1))):
        streams = generate(IIWA, 31, {}, one).streams
        table = np.column_stack([streams.time, streams.position, streams.effort * CURRENTS])
        files.append(str(write(tmp_path / f"{name}.csv", table)))
    gains = ",".join(f"{1.0 / one:.5g}" for one in CURRENTS)
    asked = ["estimate", files[0], "--without", files[1], "--urdf", str(urdf), "--json"]
    remap = ["--remap=1:=time", "--remap=2-8:=position", "--remap=9-15:=current"]
    assert main([*asked, *remap, "--assume", f"drive_units={gains}"]) == 0
    told = json.loads(capsys.readouterr().out)
    mass = told["payload"]["mass"]
    assert abs(mass["value"] - 2.5) < 0.1 < 3.0 * mass["std"] < 0.6
    for gain, true in zip(told["drive_gains"].values(), 1.0 / CURRENTS, strict=True):
        assert abs(gain["value"] / true - 1.0) < 0.1
    assert main([*asked, *remap, "--assume", "drive_units=1,2"]) == 2
    assert "a number, not zero, for each of" in capsys.readouterr().err


PERCENT = [f"joint_{k}_torque_%" for k in range(1, 8)]
RATED = np.array([176.0, 176.0, 110.0, 110.0, 60.0, 40.0, 40.0])
"""Rated torque of each drive, N m."""


def test_per_cent_of_rated_torque_get_gains_by_a_known_load(urdf, tmp_path, capsys):
    load = Payload.draw(2.5, 3)
    options = JointOptions(duration=15.0, rate_hz=125.0, payload=load)
    head = ",".join(["time", *(f"q_{k}" for k in range(1, 8)), *PERCENT])
    files = []
    for name, one in (("full", options), ("empty", replace(options, payload=None, repeat=1))):
        streams = generate(IIWA, 9405, {}, one).streams
        table = np.column_stack([streams.time, streams.position, 100.0 * streams.effort / RATED])
        files.append(str(write(tmp_path / f"{name}.csv", table, head)))
    read = JointRecording.read(files[0], urdf)
    assert any("drive_units" in line for line in read.problem_lines())
    asked = ["estimate", files[0], "--without", files[1], "--urdf", str(urdf), "--json"]
    assert main([*asked, "--known-load", "2.5"]) == 0
    told = json.loads(capsys.readouterr().out)
    for gain, rated in zip(told["drive_gains"].values(), RATED, strict=True):
        assert abs(gain["value"] - 0.01 * rated) < 3.0 * gain["std"] < 0.002 * rated
    np.testing.assert_allclose(told["payload"]["com"]["value"], load.com, atol=2e-3)


def test_two_recordings_of_currents_are_in_the_units_of_the_first(short):
    first = short.scaled(1.0 / np.arange(1.0, 8.0)).scaled(np.arange(1.0, 8.0), np.full(7, 0.05))
    second = short.scaled(1.0 / np.arange(1.0, 8.0)).scaled(np.full(7, 3.0), np.full(7, 0.05))
    _, other = in_common_units(first, second)
    np.testing.assert_allclose(other.effort, short.effort)
    both = JointStreams.join([first, second])
    np.testing.assert_allclose(both.effort[len(short.time) :], short.effort)
