"""Loads that are held still: mass, centre of mass and bias show, the inertia does not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.golden.recordings import RECORDINGS
from benchmarks.support.live_replay import replay_streams
from benchmarks.support.static_poses import StaticLoad, hold_poses, weigh_poses
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.numerics.local_polynomial import (
    Window,
    local_polynomial,
    typical_period,
)
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.importers.csv_mapping import load_yaml, read_mapping
from tactile_dynamics_ros.recording.rates import rests_between_gaps

INERTIAS = list(PARAMETER_NAMES[4:])


def _json(capsys, *arguments):
    code = main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def _within(found, load, sigmas=4.0):
    assert abs(found["mass"]["value"] - load.mass) < sigmas * found["mass"]["std"]
    error = np.abs(np.array(found["com"]["value"]) - load.com)
    assert np.all(error < sigmas * np.array(found["com"]["std"]))
    assert max(found["com"]["std"]) < 1e-3


@pytest.mark.parametrize(("poses", "seed"), [(7, 0), (7, 1), (20, 2), (20, 110)])
@pytest.mark.parametrize("pause", [0.3, 1.0])
def test_poses_held_with_pauses_tell_all_but_the_inertia(tmp_path, capsys, poses, seed, pause):
    load = StaticLoad.draw(seed)
    bag = Recording(hold_poses(load, poses, seed, pause=pause), "held").to_bag(tmp_path / "b.mcap")
    code, found = _json(capsys, "estimate", str(bag), "--effects", "force_bias")
    assert code == 0
    assert found["undetermined"] == INERTIAS
    _within(found, load)
    widths = np.diag(found["inertia_com"]["std"])
    assert np.all(widths > np.diag(found["inertia_com"]["value"]))
    bias = [found["effects"]["force_bias"][f"wrist_b_{axis}"] for axis in "xyz"]
    for entry, truth in zip(bias, load.force_bias, strict=True):
        assert abs(entry["value"] - truth) < 4.0 * entry["std"]


@pytest.mark.parametrize(("rows", "seed"), [(3, 0), (6, 1), (24, 2), (300, 3)])
def test_a_table_of_static_poses_needs_no_time(rows, seed):
    load = StaticLoad.draw(seed)
    table = weigh_poses(load, rows, seed)
    recording = Recording.from_static_poses(table.force, table.torque, rotation=table.rotation)
    assert recording.problem_lines() == []
    found = estimate(recording, [create_effect("force_bias")]).to_estimate()
    _within(found.to_json(), load)
    assert list(found.not_excited) == INERTIAS
    assert found.error.whitened_rms == pytest.approx(1.0, abs=0.1)


def _least_std(table, force_std):
    """Standard deviation of the mass in a least-squares fit of weight and bias to the rows."""
    up = np.swapaxes(table.rotation, 1, 2) @ [0.0, 0.0, 9.81]
    rows = np.concatenate([up[:, :, None], np.tile(np.eye(3), (len(up), 1, 1))], axis=2)
    flat = rows.reshape(-1, 4)
    return force_std * np.sqrt(np.linalg.inv(flat.T @ flat)[0, 0])


@pytest.mark.parametrize("rows", [12, 192])
def test_a_table_weighs_as_much_as_its_rows(rows):
    table = weigh_poses(StaticLoad.draw(5), rows, 6)
    recording = Recording.from_static_poses(
        table.force, table.torque, rotation=table.rotation, force_std=0.05, torque_std=0.003
    )
    found = estimate(recording, [create_effect("force_bias")]).to_estimate()
    assert found.parameter_std[0] == pytest.approx(_least_std(table, 0.05), rel=0.3)


def test_orientations_may_be_quaternions_of_any_length():
    table = weigh_poses(StaticLoad.draw(1), 6, 1)
    named = 16384.0 * Rotation.from_matrix(table.rotation).as_quat()
    by_name, by_matrix = (
        Recording.from_static_poses(table.force, table.torque, **orientation)
        for orientation in ({"quaternion": named}, {"rotation": table.rotation})
    )
    np.testing.assert_allclose(
        by_name.streams.pose.rotation, by_matrix.streams.pose.rotation, atol=1e-9
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": np.zeros((2, 3))}, "force 2, torque 6, orientation 6 rows"),
        ({"force": np.zeros((6, 2))}, "force has shape"),
        ({"rotation": None}, "expected either rotation"),
        ({"force": np.full((6, 3), np.nan)}, "0 usable rows of 6; expected at least 3"),
    ],
)
def test_unusable_tables_are_refused_in_a_line(change, message):
    table = weigh_poses(StaticLoad.draw(1), 6, 1)
    arrays = {"force": table.force, "torque": table.torque, "rotation": table.rotation} | change
    with pytest.raises(BadInputError, match=message) as error:
        Recording.from_static_poses(**arrays)
    assert "\n" not in str(error.value)


def test_a_row_that_is_not_finite_is_left_out_and_counted():
    table = weigh_poses(StaticLoad.draw(1), 6, 1)
    table.torque[2, 1] = np.nan
    recording = Recording.from_static_poses(table.force, table.torque, rotation=table.rotation)
    assert recording.problem_lines() == ["static poses: row 3 is not finite (left out): 1"]


def test_wrong_rows_are_left_out_by_their_numbers():
    load = StaticLoad.draw(3)
    table = weigh_poses(load, 24, 3)
    table.force[19], table.torque[19] = table.force[3], table.torque[3]
    table.rotation[10:12] *= 1.2
    recording = Recording.from_static_poses(table.force, table.torque, rotation=table.rotation)
    assert recording.problem_lines() == [
        "static poses: row 11, 12 has no rotation (left out): 2",
        "static poses: row 20 does not fit the others, as a mistyped one would not (left out): 1",
    ]
    found = estimate(recording, [create_effect("force_bias")]).to_estimate()
    _within(found.to_json(), load)
    assert found.error.whitened_rms == pytest.approx(1.0, abs=0.15)


def test_tables_without_a_wrong_row_keep_all():
    lost = 0
    for seed in range(60):
        table = weigh_poses(StaticLoad.draw(seed), 12, seed)
        recording = Recording.from_static_poses(table.force, table.torque, rotation=table.rotation)
        lost += bool(recording.problem_lines())
    assert lost <= 1


@pytest.mark.parametrize("change", ["inverse", "mirrored", "turned"])
def test_a_table_that_no_load_explains_is_no_noisy_one(change):
    table = weigh_poses(StaticLoad.draw(4), 24, 4)
    rotation, force = table.rotation, table.force
    if change == "inverse":
        rotation = np.swapaxes(rotation, 1, 2)
    elif change == "mirrored":
        force = force * [1.0, -1.0, 1.0]
    else:
        rotation = rotation @ np.diag([-1.0, -1.0, 1.0])
    recording = Recording.from_static_poses(force, table.torque, rotation=rotation)
    assert recording.problem_lines() == []
    found = estimate(recording, [create_effect("force_bias")]).to_estimate()
    assert found.error.whitened_rms > 3.0


def test_wrenches_in_world_axes_weigh_the_same():
    table = weigh_poses(StaticLoad.draw(5), 12, 5)
    turned = [np.einsum("nij,nj->ni", table.rotation, x) for x in (table.force, table.torque)]
    by_world = Recording.from_static_poses(
        *turned, rotation=table.rotation, contact_frame="world"
    ).streams.contacts["wrist"]
    by_sensor = Recording.from_static_poses(
        table.force, table.torque, rotation=table.rotation
    ).streams.contacts["wrist"]
    np.testing.assert_allclose(by_world.force, by_sensor.force, atol=1e-9)
    np.testing.assert_allclose(by_world.torque, by_sensor.torque, atol=1e-9)


@pytest.mark.parametrize("frame", ["object", "world"])
def test_a_mapping_says_the_axes_of_the_wrenches(tmp_path, frame):
    table = weigh_poses(StaticLoad.draw(5), 12, 5)
    rows = [table.force, table.torque]
    if frame == "world":
        rows = [np.einsum("nij,nj->ni", table.rotation, x) for x in rows]
    columns = np.concatenate([table.rotation.reshape(-1, 9), *rows], axis=1)
    names = [*(f"r{k}" for k in range(9)), "fx", "fy", "fz", "tx", "ty", "tz"]
    np.savetxt(tmp_path / "a.csv", columns, delimiter=",", header=",".join(names), comments="")
    section = (
        "{file: a.csv, rotation: {columns: [r0, r1, r2, r3, r4, r5, r6, r7, r8]}, "
        "force: {columns: [fx, fy, fz]}, torque: {columns: [tx, ty, tz]}}"
    )
    (tmp_path / "a.yaml").write_text(f"static_poses: {section}\ncontact_frame: {frame}\n")
    read = read_mapping(load_yaml(tmp_path / "a.yaml"), tmp_path, "a.yaml")
    found = read.streams.contacts["wrist"].force.reshape(12, -1, 3).mean(axis=1)
    read_force = np.einsum("nij,nj->ni", table.rotation, table.force)
    np.testing.assert_allclose(found, read_force, atol=0.02)
    (tmp_path / "b.yaml").write_text(f"static_poses: {section}\nobject_imu: {{file: a.csv}}\n")
    with pytest.raises(BadInputError, match="'object_imu' beside static_poses"):
        read_mapping(load_yaml(tmp_path / "b.yaml"), tmp_path, "b.yaml")


def test_a_torque_that_was_not_given_tells_no_centre_of_mass():
    """The one contact that holds a body bears a torque: zero is none that was measured."""
    streams = hold_poses(StaticLoad.draw(2), 9, 2)
    wrist = streams.contacts["wrist"]
    silent = replace(wrist, torque=np.zeros_like(wrist.torque), carries_torque=False)
    recording = Recording(replace(streams, contacts={"wrist": silent}), "held")
    found = estimate(recording, [create_effect("force_bias")]).to_estimate()
    assert {"com_x", "com_y", "com_z"} <= set(found.not_excited)
    assert min(found.parameter_std[1:4]) > 0.01
    *_, live = replay_streams(recording.streams)
    assert min(live.parameter_std[1:4]) > 0.01


@pytest.mark.parametrize("pause", [0.25, 1.0, 30.0])
@pytest.mark.parametrize("window", [Window(0.07, 6, tapered=True), Window(0.16, 6)])
def test_no_window_reads_samples_beyond_a_gap(pause, window):
    time = (np.arange(6)[:, None] * (1.0 + pause) + np.arange(50) / 50.0).ravel()
    steps = np.repeat(np.arange(6.0), 50)[:, None]
    functional = local_polynomial(time, time, window)
    for order in (1, 2):
        slope = functional.apply(steps, order)[functional.valid]
        np.testing.assert_allclose(slope, 0.0, atol=1e-6)
    assert functional.valid.mean() > 0.8
    assert typical_period(time) == pytest.approx(0.02)


def test_stretches_shorter_than_a_window_are_read_by_what_they_have():
    time = (np.arange(20)[:, None] + np.arange(12) / 50.0).ravel()
    values = np.stack([np.sin(2.0 * time), 0.5 * time**2], axis=1)
    functional = local_polynomial(time, time, Window(0.16, 6))
    assert functional.valid.all()
    np.testing.assert_allclose(
        functional.apply(values, 1)[:, 0], 2.0 * np.cos(2.0 * time), atol=0.02
    )
    np.testing.assert_allclose(functional.apply(values, 2)[:, 1], 1.0, atol=1e-6)


def test_the_measured_payload_of_an_arm_agrees_with_its_documents(tmp_path, capsys):
    folder = Path(__file__).resolve().parents[3] / "shared" / "data" / "kuka_ft_imu"
    if not folder.exists():
        pytest.skip("../shared/data/kuka_ft_imu is not on this machine")
    table, bag = folder / "0-calibration_fts-accel.csv", str(tmp_path / "poses.mcap")
    assert main(["import", "static-poses", str(table), bag, "--reads", "load"]) == 0
    capsys.readouterr()
    code, found = _json(capsys, "estimate", bag, "--effects", "force_bias")
    assert code == 0
    assert found["mass"]["value"] == pytest.approx(0.9333, abs=1e-3)
    np.testing.assert_allclose(found["com"]["value"], [0.0003, 0.0001, 0.0439], atol=5e-4)
    bias = found["effects"]["force_bias"]
    read = [-bias[f"wrist_b_{axis}"]["value"] for axis in "xyz"]
    np.testing.assert_allclose(read, [9.077, -1.018, 9.985], atol=0.05)
    assert found["undetermined"] == INERTIAS


def test_pauses_between_poses_at_rest_are_no_loss_and_gaps_of_a_motion_are():
    poses = RECORDINGS["static"]().streams.pose
    assert rests_between_gaps(poses)
    moving = RECORDINGS["wrist_clean"]().streams.pose
    kept = np.ones(len(moving.time), dtype=bool)
    kept[100:150] = False
    gapped = replace(
        moving,
        time=moving.time[kept],
        position=moving.position[kept],
        rotation=moving.rotation[kept],
        covariance=None,
    )
    assert not rests_between_gaps(gapped) and not rests_between_gaps(moving)
