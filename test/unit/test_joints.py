"""Arms by their joint torques: bodies, friction, payload, effects by name, honest doubt."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.model.check import check_residual_model
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.conventions import assumed, in_common_units
from tactile_dynamics_ros.core.joints.effects import JOINT_EFFECT_NAMES
from tactile_dynamics_ros.core.joints.estimate import estimate, fit
from tactile_dynamics_ros.core.joints.excitation import JointLimits, design_motion
from tactile_dynamics_ros.core.joints.live import JointMonitor, KnownArm
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.joints.situation import Situation
from tactile_dynamics_ros.core.robot.kinematic_tree import read_tree
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams
from tactile_dynamics_ros.recording.joints import JointRecording
from tactile_dynamics_ros.recording.kinds import recorded_kind
from tactile_dynamics_ros.synthetic.joints import CATALOGUE, JointOptions, Payload, generate

IIWA = load_robot("allegro_iiwa").urdf
SLIDING = """<robot name="crane"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0.02 0.05" rpy="0.3 0 0.2"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0.002" iyz="-0.001"/></inertial></link>
<link name="slide"><inertial><origin xyz="0 0.1 0.3" rpy="0 0.1 0"/><mass value="1.5"/>
<inertia ixx="0.01" iyy="0.02" izz="0.015" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool0"><inertial><mass value="0.4"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
<origin xyz="0 0 0.3" rpy="1.2 0.1 0.4"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
<joint name="push" type="prismatic"><parent link="arm"/><child link="slide"/>
<origin xyz="0.2 0 0" rpy="0 0.4 0.3"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" effort="50" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="slide"/><child link="tool0"/>
<origin xyz="0 0 0.2" rpy="0.5 0 0"/></joint></robot>"""


@pytest.fixture(scope="module")
def clean():
    """An arm without anything that its model misses."""
    return generate(IIWA, 5, {}, JointOptions(duration=15.0))


@pytest.fixture(scope="module")
def fitted(clean):
    """Its model."""
    return fit(clean.streams)


@pytest.mark.parametrize("urdf", [SLIDING, IIWA], ids=["sliding", "iiwa"])
def test_torques_are_those_of_another_implementation(urdf, tmp_path):
    bullet = pytest.importorskip("pybullet")
    bare = re.sub(r"<(visual|collision)\b.*?</\1>", "", urdf, flags=re.DOTALL)
    (tmp_path / "arm.urdf").write_text(bare)
    client = bullet.connect(bullet.DIRECT)
    flags = bullet.URDF_USE_INERTIA_FROM_FILE
    body = bullet.loadURDF(str(tmp_path / "arm.urdf"), useFixedBase=True, flags=flags)
    bullet.setGravity(0, 0, -9.81)
    every = [bullet.getJointInfo(body, k) for k in range(bullet.getNumJoints(body))]
    moving = [info for info in every if info[2] != bullet.JOINT_FIXED]
    count = min(7, len(moving))
    arm = Arm.from_urdf(urdf, [info[1].decode() for info in moving[:count]], "test")
    q, dq, ddq = np.zeros((3, len(moving)))
    random = np.random.default_rng(1)
    q[:count], dq[:count], ddq[:count] = random.normal(size=(3, count))
    expected = bullet.calculateInverseDynamics(body, list(q), list(dq), list(ddq))[:count]
    bullet.disconnect(client)
    motion = arm.motion(q[None, :count], dq[None, :count], ddq[None, :count])
    np.testing.assert_allclose(arm.torque(motion, arm.inertia)[0], expected, atol=1e-9)
    by_columns = arm.regressor(motion)[0] @ arm.inertia.reshape(-1)
    np.testing.assert_allclose(by_columns, expected, atol=1e-9)


def test_a_force_on_the_flange_is_found_from_joint_torques(clean, fitted):
    arm, known = fitted.samples.arm, fitted.known
    streams = clean.streams
    motion = arm.motion(streams.position, *np.zeros((2, *streams.position.shape)))
    wrench = np.array([0.0, 0.0, 0.0, 12.0, -8.0, 5.0])
    measured = np.einsum("nai,a->ni", arm.flange_jacobian(motion), wrench)
    monitor, found = JointMonitor(arm, known), []
    for k in range(1000, 5000):
        monitor.add(streams.time[k], streams.position[k], streams.effort[k] - measured[k])
        if k % 50 == 0 and (told := monitor.latest()) is not None and not told.doubt:
            found.append(told)
    assert len(found) > 10
    away = [(told.wrench - wrench) / told.wrench_std for told in found]
    assert np.sqrt(np.mean(np.square(away))) < 2.0
    assert all(told.touched(4.0) for told in found)


def test_the_model_keeps_what_the_engine_relies_on(fitted):
    report = check_residual_model(fitted)
    assert not report.failures, report.failures


def test_noise_is_the_one_that_was_added(clean, fitted):
    size = 0.1 * 0.02 * np.array([100.0, 100.0, 60.0, 60.0, 25.0, 20.0, 10.0])
    np.testing.assert_allclose(
        fitted.effort_std, size / np.sqrt(fitted.samples.t.shape[1]), rtol=0.35
    )
    np.testing.assert_allclose(fitted.friction[0], clean.friction["coulomb"], rtol=0.03)


def test_nothing_is_missing_from_a_clean_recording(fitted):
    assert diagnose(fitted).verdict == "adequate"


@pytest.mark.parametrize("name", ["stribeck_friction", "backlash", "torque_delay", "link_cable"])
def test_a_hidden_effect_is_named(name):
    model = fit(generate(IIWA, 11, {name: 1.0}, JointOptions(duration=20.0)).streams)
    found = diagnose(model)
    assert found.effect == name or name in found.group
    assert found.after.rms < 1.1 * found.floor < found.before.rms


def test_a_named_effect_is_estimated_with_its_interval():
    made = generate(IIWA, 12, {"torque_delay": 1.0}, JointOptions(duration=20.0))
    entry = fit(made.streams, ["torque_delay"]).parameters()["torque_delay"]["d"]
    away = entry["value"] - made.hidden["torque_delay"]["delay"]
    assert abs(away) < 4.0 * entry["std"] < 1e-3


def test_every_name_has_a_law_of_the_generator():
    assert set(CATALOGUE) == set(JOINT_EFFECT_NAMES)


def test_intervals_of_a_payload_hold_alone_and_beside_the_empty_arm():
    alone, beside = [], []
    for seed in range(8):
        load = Payload.draw(2.0, seed)
        full = generate(IIWA, seed, {}, JointOptions(duration=15.0, payload=load)).streams
        empty = generate(IIWA, seed, {}, JointOptions(duration=15.0, repeat=1)).streams
        truth = np.append(load.mass, load.com)
        for without, away in ((None, alone), (empty, beside)):
            payload = estimate(full, (), without).payload
            value = np.append(payload.body.mass, payload.body.com)
            away.append((value - truth) / payload.std[:4])
    for away in (alone, beside):
        assert np.mean(np.abs(away) < 1.645) > 0.75
        assert np.abs(away).max() < 4.0
    spread = np.sqrt(np.mean(np.square(beside)))
    assert 0.6 < spread < 1.5, "neither wide for safety nor narrow"


@pytest.mark.parametrize("name", ["joint_elasticity", "rotor_inertia"])
def test_the_interval_of_a_pair_holds_what_its_model_misses(name):
    for seed in (20, 21):
        load = Payload.draw(2.0, seed)
        full = generate(IIWA, seed, {name: 1.0}, JointOptions(duration=15.0, payload=load))
        empty = generate(IIWA, seed, {name: 1.0}, JointOptions(duration=15.0, repeat=1))
        payload = estimate(full.streams, (), empty.streams).payload
        assert abs(payload.body.mass - 2.0) < 3.0 * payload.std[0] < 0.02


def test_windup_is_smoothed_up_to_a_gap_as_in_a_recording_of_its_own(clean):
    model = fit(JointStreams.join([clean.streams.between(0.0, 6.0), clean.streams]))
    samples = model.samples
    gap = int(np.flatnonzero(~samples.follows)[0]) + 1
    alone = JointSamples.from_streams(clean.streams.between(0.0, 6.0), samples.arm)
    parts = (model.link_bodies, model.payload, model.friction)
    expected = Situation(alone, *parts).wound_up
    np.testing.assert_allclose(Situation(samples, *parts).wound_up[:gap], expected, 1e-2, 0.1)
    assert np.abs(expected[-3:]).max() > 0.0


def test_what_the_arm_does_not_tell_is_undetermined(clean):
    found = estimate(clean.streams)
    assert "payload.com_x" in found.undetermined, "an empty flange has no centre"
    quiet = replace(clean.streams, position=clean.streams.position.copy())
    quiet.position[:, 2] = 0.3
    assert "lbr_iiwa_joint_3.coulomb" in estimate(quiet).undetermined


def test_an_estimate_that_does_not_fit_is_no_answer(tmp_path, capsys):
    out = tmp_path / "run.mcap"
    made = generate(IIWA, 2, {"friction_warming": 1.0}, JointOptions(duration=15.0))
    JointRecording(made.streams, "made").to_bag(out)
    assert main(["estimate", str(out), "--json"]) == 3
    assert "does not fit" in capsys.readouterr().err
    assert main(["estimate", str(out), "--effects", "friction_warming", "--json"]) == 0


def test_a_bag_is_recognised_and_read_as_it_was_written(clean, tmp_path):
    out = JointRecording(clean.streams, "made", epoch_ns=10**18).to_bag(tmp_path / "run.mcap")
    assert recorded_kind(out) == "joints"
    read = JointRecording.read(out)
    np.testing.assert_array_equal(read.streams.effort, clean.streams.effort)
    np.testing.assert_allclose(read.streams.time, clean.streams.time, atol=1e-6)
    assert read.streams.urdf == IIWA and read.streams.names == clean.streams.names


def test_a_table_is_read_by_its_columns(clean, tmp_path):
    streams = clean.streams.between(0.0, 3.0)
    head = ["time", *(f"q_{k}" for k in range(1, 8)), *(f"tau_{k}" for k in range(1, 8))]
    table = np.column_stack([streams.time, streams.position, streams.effort])
    file, urdf = tmp_path / "run.csv", tmp_path / "arm.urdf"
    np.savetxt(file, table, delimiter=",", header=",".join(head), comments="")
    urdf.write_text(IIWA)
    read = JointRecording.read(file, urdf)
    np.testing.assert_allclose(read.streams.effort, streams.effort)
    with pytest.raises(BadInputError, match="--urdf"):
        JointRecording.read(file)


def test_bad_input_is_said_in_a_line(clean):
    with pytest.raises(BadInputError, match="no URDF"):
        fit(replace(clean.streams, urdf=""))
    with pytest.raises(BadInputError, match="give the URDF of this arm"):
        fit(replace(clean.streams, urdf=SLIDING))
    with pytest.raises(NotIdentifiableError, match="record some seconds"):
        fit(clean.streams.between(0.0, 1.0))
    with pytest.raises(BadInputError, match="unknown of model joints"):
        fit(clean.streams, ["viscous_drag"])
    with pytest.raises(BadInputError, match="no such reading"):
        fit(clean.streams, ["stribeck_friction:elbow"])


def test_the_command_makes_names_and_prints(tmp_path, capsys):
    out = str(tmp_path / "run.mcap")
    making = ["synthetic", "joints", "--effect", "base_tilt", "--duration", "15", "--seed", "4"]
    assert main([*making, out]) == 0
    capsys.readouterr()
    assert main(["diagnose", out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["effect"] == "base_tilt"
    assert main(["estimate", out, "--effects", "base_tilt", "--json", "--out", out + ".d"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["model"] == "joints" and len(document["joints"]) == 7
    assert document["effects"]["base_tilt"].keys() == {"a", "b"}
    assert main(["compare", out, "--json"]) == 0
    places = json.loads(capsys.readouterr().out)["fails_where"]
    assert all(place["channel"].startswith("lbr_iiwa") for place in places)


def test_a_saved_model_reads_back(fitted):
    known = fit_with(fitted, "stribeck_friction").known
    again = KnownArm.from_document(json.loads(json.dumps(known.to_document())), "file")
    np.testing.assert_array_equal(again.bodies, known.bodies)
    assert again.effects[0][0] == known.effects[0][0]
    with pytest.raises(BadInputError, match="estimate --save"):
        KnownArm.from_document({"model": "held"}, "file")


def fit_with(model, name):
    """The same model with one more effect."""
    family = model.families([name])[1]
    return model.with_effect(family, np.zeros(len(family.kept)))


CURRENTS = np.array([0.08, 0.085, 0.1, 0.095, 0.2, 0.22, 0.3])
"""Amperes per N m of each drive."""
LAST_TWO = np.array([1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0])


@pytest.mark.parametrize(
    ("factors", "name", "words"),
    [
        (-np.ones(7), "torque_sign", "all joints"),
        (LAST_TWO, "torque_sign", "lbr_iiwa_joint_4, lbr_iiwa_joint_7"),
        (1e3 * np.ones(7), "torque_unit", "N mm"),
        (CURRENTS, "drive_units", "currents"),
    ],
)
def test_torques_that_mean_something_else_are_a_convention(factors, name, words):
    load = Payload.draw(2.5, 3)
    made = generate(IIWA, 31, {}, JointOptions(duration=15.0, payload=load))
    found = diagnose(fit(made.streams.scaled(factors)))
    assert found.verdict == "convention" and found.convention.name == name
    assert words in found.convention.change
    assert found.after.rms < 1.1
    streams, _ = assumed(made.streams.scaled(factors), name)
    assert diagnose(fit(streams)).verdict == "adequate"


def test_a_weighed_load_tells_the_gains_of_drives_that_report_currents():
    load = Payload.draw(2.5, 3)
    full = generate(IIWA, 31, {}, JointOptions(duration=15.0, payload=load)).streams
    empty = generate(IIWA, 31, {}, JointOptions(duration=15.0, repeat=1)).streams
    read, _ = assumed(full.scaled(CURRENTS), "drive_units")
    both = in_common_units(read, empty.scaled(CURRENTS))
    by_urdf, weighed = (estimate(both[0], (), both[1], known_load=m) for m in (None, 2.5))
    away = (by_urdf.payload.body.mass - 2.5) / by_urdf.payload.std[0]
    assert abs(away) < 3.0 and by_urdf.payload.std[0] > 0.01, "no better than the URDF's masses"
    np.testing.assert_allclose(weighed.payload.body.com, load.com, atol=1e-3)
    gains = weighed.table["torque_gain"].values()
    assert all(entry["std"] < 0.02 for entry in gains)


def test_degrees_are_refused(clean):
    with pytest.raises(BadInputError, match="degrees"):
        fit(replace(clean.streams, position=np.rad2deg(clean.streams.position)))


def test_a_designed_motion_keeps_its_limits_and_tells_what_is_not_known(clean, tmp_path, capsys):
    arm = Arm.from_urdf(IIWA, clean.streams.names, "test")
    limits = JointLimits(duration=10.0, floor=0.1)
    motion = design_motion(arm, limits)
    lower, upper = (np.array([getattr(j, end) for j in arm.joints]) for end in ("lower", "upper"))
    assert np.all(motion.position >= lower) and np.all(motion.position <= upper)
    speed = np.array([j.velocity for j in arm.joints])
    assert np.abs(motion.velocity / speed).max() <= limits.pace + 1e-6
    assert np.abs(motion.acceleration).max() <= limits.acceleration + 1e-6
    np.testing.assert_allclose(motion.velocity[[0, -1]], 0.0, atol=1e-3)
    numeric = np.gradient(motion.position, motion.time, axis=0)
    np.testing.assert_allclose(numeric[5:-5], motion.velocity[5:-5], atol=0.02)
    places = arm.motion(motion.position, *np.zeros((2, *motion.position.shape))).places
    assert min(p[:, 2].min() for p in places[2:]) > limits.floor - 1e-2
    known = design_motion(arm, limits, fit(clean.streams).learned)
    assert known.mass_std[1] <= known.mass_std[0] < motion.mass_std[0]
    (tmp_path / "arm.urdf").write_text(IIWA)
    asking = ["excite", "--urdf", str(tmp_path / "arm.urdf"), "--duration", "8", "--json"]
    assert main(asking) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["points"][-1]["time_from_start"] == {"sec": 8, "nanosec": 0}


def test_a_hand_and_silent_joints_are_no_joints_of_the_arm(clean, fitted):
    names = [joint.name for joint in read_tree(IIWA, "test") if joint.axis is not None]
    assert Arm.from_urdf(IIWA, names, "test").names == clean.streams.names
    quiet = clean.streams.effort.copy()
    quiet[:, 6] = 0.0
    assert fit(replace(clean.streams, effort=quiet)).joints == clean.streams.names[:6]
    with pytest.raises(BadInputError, match="all efforts are constant"):
        fit(replace(clean.streams, effort=0.0 * quiet))


def test_two_recordings_of_one_arm_tell_more_than_one(clean):
    other = generate(IIWA, 5, {}, JointOptions(duration=15.0, motion=1)).streams
    one, two = JointRecording(clean.streams, "one"), JointRecording(other, "two")
    both = fit(JointRecording.join([one, two]).streams)
    alone = fit(clean.streams)
    assert len(both.samples.time) > 1.9 * len(alone.samples.time)
    assert diagnose(both).verdict == "adequate"
    first = 3 * len(both.joints)
    spread = [np.sqrt(np.diag(m.covariance)[:first]) for m in (both, alone)]
    assert np.median(spread[0] / spread[1]) < 0.85


def test_the_demo_tells_the_story_from_the_error_to_the_payload(tmp_path, capsys):
    assert main(["demo", "--joints", "--out", str(tmp_path / "demo"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["explanation"]["effects"] == ["link_cable"]
    before, after = (told["payload"][key] for key in ("before", "with the effects"))
    assert not before["answer"] and abs(before["off_kg"]) > 0.05
    assert after["answer"] and abs(after["off_kg"]) < 3.0 * after["mass"]["std"] < 0.01
    wrong, right = told["live_error"].values()
    assert right < 1.2 < 0.5 * wrong, "the live model gets it while it watches"
    assert Path(told["report"]).is_file()
