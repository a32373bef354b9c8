"""Importers: tables of others become recordings with the right signs, axes, units and clocks."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.recording.importers import IMPORTERS
from tactile_dynamics_ros.recording.importers.kuka_ft_imu import Calibration
from tactile_dynamics_ros.recording.importers.tables import read_table

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
BY_NAME = {importer.name: importer for importer in IMPORTERS}
GRAVITY = np.array([0.0, 0.0, -9.81])
MASS, COM = 0.8, np.array([0.01, -0.02, 0.05])
BIAS = np.array([4.0, -3.0, 2.0, 0.3, -0.2, 0.1])
R_SI = Rotation.from_euler("xyz", [90.0, 1.0, 90.0], degrees=True).as_matrix()
ACCELEROMETER_BIAS = np.array([0.05, -0.1, 0.7])


def _shared(folder: str) -> Path:
    if not (DATA / folder).exists():
        pytest.skip(f"../shared/data/{folder} is not on this machine")
    return DATA / folder


def _read(name, source, **options):
    return BY_NAME[name].read(Path(source), Namespace(**options))


@pytest.fixture
def kuka_folder(tmp_path) -> Path:
    """Return tables of a load on a wrist sensor that also turns, with known bias and axes."""
    random = np.random.default_rng(0)
    static = Rotation.random(20, random_state=1)
    _write_static(tmp_path / "0-calibration_fts-accel.csv", static, random)
    time = np.arange(0.0, 4.0, 0.01)
    turning = Rotation.from_rotvec(np.stack([np.sin(time), 0.8 * np.cos(2 * time), time], axis=1))
    start = 1_708_857_503_000_000
    _write_csv(
        tmp_path / "run_orientations.csv",
        ["t", *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))],
        [start + 1e6 * time, *turning.as_matrix().reshape(-1, 9).T],
    )
    wrench, accelerations = _readings(turning, random)
    _write_csv(
        tmp_path / "run_wrench.csv",
        ["t", "fx", "fy", "fz", "tx", "ty", "tz"],
        [start + 1e6 * time + 3000, *wrench.T],
    )
    _write_csv(
        tmp_path / "run_accel.csv", ["t", "ax", "ay", "az"], [start + 1e6 * time, *accelerations.T]
    )
    return tmp_path


def _readings(rotation, random):
    gravity = rotation.inv().apply(GRAVITY)
    force = MASS * gravity
    wrench = np.concatenate([force, np.cross(COM, force)], axis=1) + BIAS
    wrench += random.normal(size=wrench.shape) * [0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4]
    specific = (-gravity) @ R_SI + ACCELEROMETER_BIAS
    return wrench, (specific + 0.02 * random.normal(size=gravity.shape)) / 9.80665


def _write_static(path, rotation, random):
    wrench, accelerations = _readings(rotation, random)
    columns = ["fx", "fy", "fz", "tx", "ty", "tz", "ax", "ay", "az"]
    columns += [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    _write_csv(path, columns, [*wrench.T, *accelerations.T, *rotation.as_matrix().reshape(-1, 9).T])


def _write_csv(path, names, columns):
    rows = "\n".join(",".join(f"{v:.17g}" for v in row) for row in np.array(columns).T)
    path.write_text(f"  {','.join(names)}\n{rows}\n")


def test_static_poses_give_axes_and_biases(kuka_folder):
    table = read_table(kuka_folder / "0-calibration_fts-accel.csv")
    calibration = Calibration.from_static_poses(table)
    np.testing.assert_allclose(calibration.R_SI, R_SI, atol=5e-3)
    np.testing.assert_allclose(calibration.accelerometer_bias, ACCELEROMETER_BIAS, atol=0.02)
    np.testing.assert_allclose(calibration.wrench_bias[:3], BIAS[:3], atol=0.03)
    np.testing.assert_allclose(calibration.wrench_bias[3:], BIAS[3:], atol=1e-3)
    assert calibration.wrench_rms[0] == pytest.approx(0.02, rel=0.4)


def test_the_load_pulls_down_and_its_reaction_on_the_sensor_is_turned_round(kuka_folder):
    recording = _read("kuka-ft-imu", kuka_folder / "run", tare=True, imu_delay=0.0)
    wrist = recording.streams.contacts["wrist"]
    assert wrist.carries_torque
    np.testing.assert_allclose(wrist.force.mean(axis=0), [0, 0, 9.81 * MASS], atol=0.05)
    up = np.einsum(
        "nij,nj->ni", recording.streams.imu.rotation, recording.streams.imu.specific_force
    )
    np.testing.assert_allclose(up.mean(axis=0), [0, 0, 9.81], atol=0.05)
    raw = _read("kuka-ft-imu", kuka_folder / "run", tare=False, imu_delay=0.0)
    shift = np.einsum(
        "nji,nj->ni", wrist.rotation, raw.streams.contacts["wrist"].force - wrist.force
    )
    np.testing.assert_allclose(shift.mean(axis=0), -BIAS[:3], atol=0.03)


def test_stamps_are_kept_and_a_known_delay_is_taken_off(kuka_folder):
    plain = _read("kuka-ft-imu", kuka_folder / "run", tare=False, imu_delay=0.0).streams
    early = _read("kuka-ft-imu", kuka_folder / "run", tare=False, imu_delay=0.02).streams
    assert plain.contacts["wrist"].time[0] - plain.imu.time[0] == pytest.approx(0.003, abs=1e-5)
    np.testing.assert_allclose(
        early.imu.specific_force[:5], plain.imu.specific_force[2:7], atol=1e-12
    )


@pytest.mark.parametrize("run", ["run", "0-calibration"])
def test_the_load_is_estimated_from_imported_tables(kuka_folder, run):
    recording = _read("kuka-ft-imu", kuka_folder / run, tare=True, imu_delay=0.0)
    body = estimate_body(recording.streams).to_estimate().inertia
    assert body.mass == pytest.approx(MASS, rel=0.01)
    np.testing.assert_allclose(body.com, COM, atol=1.5e-3)


def test_the_measured_payload_agrees_with_its_reference():
    folder = _shared("kuka_ft_imu")
    calibration = Calibration.from_static_poses(read_table(folder / "0-calibration_fts-accel.csv"))
    np.testing.assert_allclose(calibration.wrench_bias[:3], [9.077, -1.018, 9.985], atol=1e-3)
    np.testing.assert_allclose(calibration.wrench_bias[3:], [0.4325, -0.6916, -0.157], atol=1e-3)
    for run in ("1-baseline", "2-vibrations"):
        recording = _read("kuka-ft-imu", folder / run, tare=True, imu_delay=0.0084)
        body = estimate_body(recording.streams).to_estimate().inertia
        assert body.mass == pytest.approx(0.9333, rel=0.02)
        np.testing.assert_allclose(body.com, [0.0003, 0.0001, 0.0439], atol=1e-3)


def test_a_toss_is_stored_scalar_first(tmp_path):
    turned = Rotation.from_rotvec([0.1, 0.2, 0.3])
    row = [*np.roll(turned.as_quat(), 1), 0.1, 0.2, 0.3, *np.zeros(6)]
    np.savez(tmp_path / "cube_tosses_550.npz", toss_000=np.tile(row, (20, 1)))
    pose = _read("contactnets-cube-tosses", tmp_path / "toss_000").streams.pose
    np.testing.assert_allclose(pose.rotation[0], turned.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(pose.position[0], [0.1, 0.2, 0.3])


def test_a_tossed_cube_has_poses_and_no_contacts(tmp_path):
    folder = _shared("contactnets_cube_tosses")
    recording = _read("contactnets-cube-tosses", folder / "toss_017")
    pose = recording.streams.pose
    assert recording.streams.contacts == {}
    assert recording.problems == {"pose: pose leaps away and back (dropped)": 1}
    assert _read("contactnets-cube-tosses", folder / "toss_018").problems == {}
    assert np.median(np.diff(pose.time)) == pytest.approx(1 / 148, rel=1e-3)
    assert 0.04 < pose.position[:, 2].min() < 0.12
    path = recording.to_bag(tmp_path / "toss.mcap")
    back = type(recording).from_bag(path, contacts_required=False)
    assert len(back.streams.pose.time) == len(pose.time)
    with pytest.raises(BadInputError, match="not 'toss_999'"):
        _read("contactnets-cube-tosses", folder / "toss_999")


def test_a_slide_is_read_from_its_archive():
    folder = _shared("biotac_slide_iiwa")
    recording = _read("biotac-slide", folder / "slides_20mat_x4.tar.gz" / "mat17_3")
    finger = recording.streams.contacts["biotac"]
    assert 0.15 < np.ptp(finger.position[:, 0]) < 0.25
    np.testing.assert_array_equal(recording.streams.pose.position, 0.0)
    with pytest.raises(BadInputError, match="holds no mat99_1_cw.csv"):
        _read("biotac-slide", folder / "slides_20mat_x4.tar.gz" / "mat99_1")


MAPPING = """
contact_frame: object
object_pose:
  file: pose.csv
  time: {columns: ms, unit: ms}
  position: {columns: [x, y, z], unit: mm}
  quaternion: {columns: [qx, qy, qz, qw]}
  position_std: {constant: 0.5, unit: mm}
  rotation_std: {constant: 0.2, unit: deg}
contacts:
  palm:
    file: palm.csv
    delay: 0.25
    time: {columns: t}
    force: {columns: [fx, fy, fz], scale: -1.0}
    force_std: 0.05
    position: [0.0, 0.0, 0.1]
    normal: [0.0, 0.0, -1.0]
"""


@pytest.fixture
def own_tables(tmp_path) -> Path:
    """Return a mapping file with two tables of different separators beside it."""
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    turned = np.sqrt(0.5)
    rows = [f"{10 * k};{k};0;500;0;0;{turned};{turned}" for k in range(200)]
    (tmp_path / "pose.csv").write_text("\n".join(["ms;x;y;z;qx;qy;qz;qw", *rows]) + "\n")
    rows = [f"{0.01 * k + 0.25:.6f},-1,-2,{'' if k == 3 else -3}," for k in range(200)]
    (tmp_path / "palm.csv").write_text("\n".join(["t,fx,fy,fz,", *rows]) + "\n")
    return tmp_path / "mapping.yaml"


def test_a_mapping_turns_own_tables_into_a_recording(own_tables):
    recording = _read("csv", own_tables)
    palm = recording.streams.contacts["palm"]
    assert recording.problems == {"contacts.palm: sample is not finite (dropped)": 1}
    np.testing.assert_allclose(palm.force, np.tile([-2.0, 1.0, 3.0], (199, 1)), atol=1e-12)
    np.testing.assert_allclose(palm.position[100], [0.1, 0.0, 0.6], atol=1e-9)
    np.testing.assert_allclose(palm.force_std, 0.05)
    assert palm.time[0] == pytest.approx(0.0, abs=1e-12)
    covariance = recording.streams.pose.covariance[0].diagonal()
    np.testing.assert_allclose(covariance, [np.radians(0.2) ** 2] * 3 + [2.5e-7] * 3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("object_pose:", "object_psoe:", "unknown key 'object_psoe'"),
        ("file: pose.csv", "file: poses.csv", "poses.csv: no such file"),
        ("columns: [x, y, z]", "columns: [x, y, zz]", "pose.csv: no column 'zz'; it has ms, x"),
        ("columns: [x, y, z]", "columns: [x, y]", "object_pose.position: 2 columns; expected 3"),
        ("unit: ms", "unit: minutes", "unit 'minutes'; expected one of s, ms, us, ns"),
        ("scale: -1.0", "scale: minus", "'minus'; expected a number"),
        ("force_std: 0.05", "froce_std: 0.05", "froce_std: unknown field"),
        ("object: ", "object: [", None),
        ("contact_frame: object", "contact_frame: hand", "expected 'world' or 'object'"),
    ],
)
def test_a_wrong_mapping_is_refused_with_the_place(own_tables, old, new, message):
    if message is None:
        own_tables.write_text("contacts: [")
        message = "not valid yaml"
    else:
        own_tables.write_text(own_tables.read_text().replace(old, new))
    with pytest.raises(BadInputError, match=message) as error:
        _read("csv", own_tables)
    assert "\n" not in str(error.value)


def test_tables_without_rows_or_numbers_are_refused(tmp_path):
    for name, text in {"empty": "", "header": "a,b\n", "words": "a,b\nx,y\n"}.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(BadInputError, match="expected"):
            read_table(tmp_path / name)
