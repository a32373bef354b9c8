"""Arrays that numpy and MATLAB save are tables like those in text."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from benchmarks.support.layouts import WristLog
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
from tactile_dynamics_ros.recording.importers.guess import guess_tables
from tactile_dynamics_ros.recording.importers.tables import read_tables


@pytest.fixture
def log() -> WristLog:
    """Return a load on a wrist."""
    return WristLog.draw(21, 6.0)


def _require_load(path, log):
    guess = guess_tables([path])
    assert guess.question == ""
    recording = read_mapping(guess.mapping, path.parent, "mapping")
    pose, wrist = recording.streams.pose, recording.streams.contacts["wrist"]
    assert (Rotation.from_matrix(pose.rotation).inv() * log.rotation).magnitude().max() < 1e-5
    np.testing.assert_allclose(wrist.force, log.rotation.apply(log.force), atol=0.1)
    assert len(wrist.time) == len(log.time)


def test_arrays_by_name(log, tmp_path):
    wrench = -np.hstack([log.force, log.torque])
    arrays = {"time": log.time, "position": log.position, "quat": log.quaternion, "wrench": wrench}
    np.savez_compressed(tmp_path / "log.npz", **arrays, gains=np.eye(6), comment="a run")
    _require_load(tmp_path / "log.npz", log)


def test_arrays_of_two_rates(log, tmp_path):
    poses = {"t_pose": log.time[::2], "R": log.rotation[::2].as_matrix(), "p": log.position[::2]}
    forces = {"t_ft": log.time, "force": -log.force, "torque": -log.torque}
    np.savez(tmp_path / "log.npz", **poses, **forces)
    short = WristLog(
        log.time[::2],
        log.position[::2],
        log.rotation[::2],
        log.force[::2],
        log.torque[::2],
        log.mass,
        log.com,
    )
    guess = guess_tables([tmp_path / "log.npz"])
    assert guess.question == ""
    streams = read_mapping(guess.mapping, tmp_path, "mapping").streams
    np.testing.assert_allclose(streams.pose.time, short.time, atol=1e-9)
    wrist = streams.contacts["wrist"]
    assert len(wrist.time) > 2 * len(short.time) - 3
    np.testing.assert_allclose(wrist.force[::2], short.rotation.apply(short.force), atol=0.1)


@pytest.mark.parametrize("names", [True, False])
def test_one_array_with_and_without_names(log, tmp_path, names):
    columns = [log.time[:, None], log.position, log.quaternion, -log.force, -log.torque]
    values = np.hstack(columns)
    if names:
        words = ["t", *(f"p{a}" for a in "xyz"), *(f"q{a}" for a in "xyzw")]
        words += [f"f{a}" for a in "xyz"] + [f"m{a}" for a in "xyz"]
        values = np.rec.fromarrays(values.T, names=words)
    np.save(tmp_path / "log.npy", values)
    _require_load(tmp_path / "log.npy", log)


def test_structures_of_matlab_with_samples_along_the_last_axis(log, tmp_path):
    matrices = np.tile(np.eye(4), (len(log.time), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = log.rotation.as_matrix(), log.position
    log_ = {"time": log.time[None], "tcpPose": np.moveaxis(matrices, 0, -1)}
    log_ |= {"force": -log.force.T, "torque": -log.torque.T}
    savemat(tmp_path / "log.mat", {"log": log_, "rate": 100.0}, do_compression=True)
    _require_load(tmp_path / "log.mat", log)


def test_what_holds_no_table_is_refused_in_one_line(tmp_path):
    np.savez(tmp_path / "a.npz", gain=np.float64(3.0))
    (tmp_path / "b.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(200))
    (tmp_path / "c.npy").write_bytes(b"no array")
    np.save(tmp_path / "d.npy", np.array([{}], dtype=object), allow_pickle=True)
    for name, words in (
        ("a.npz", "gain"),
        ("b.mat", "-v7, or"),
        ("c.npy", "c.npy"),
        ("d.npy", "d"),
    ):
        with pytest.raises(BadInputError, match=words):
            read_tables(tmp_path / name)
