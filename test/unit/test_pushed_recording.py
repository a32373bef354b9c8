"""Recordings of pushed objects: written, read, told from held ones."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.pushed import PushedRecording, recorded_model
from tactile_dynamics_ros.synthetic import pushed

SHORT = pushed.PushOptions(
    kind="jointed", actions=pushed.ActionOptions(count=2, travel=0.03, duration=0.4)
)


@pytest.fixture(scope="module")
def streams():
    return pushed.generate([5], options=SHORT)[0].streams


@pytest.mark.parametrize("tilt", [0.0, 0.1])
def test_what_is_written_is_read(streams, tilt, tmp_path):
    gravity = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    leaning = replace(streams, gravity=gravity)
    path = PushedRecording(leaning, "made").to_bag(tmp_path / "push")
    read = PushedRecording.from_bag(path).streams
    np.testing.assert_allclose(read.gravity, gravity, atol=1e-9)
    start = streams.links[0].time[0]
    for wanted, found in zip(streams.links, read.links, strict=True):
        np.testing.assert_allclose(found.time, wanted.time - start, atol=1e-8)
        np.testing.assert_allclose(found.pose[:, :2], wanted.pose[:, :2], atol=1e-9)
        apart = np.exp(1j * found.pose[:, 2]) - np.exp(1j * wanted.pose[:, 2])
        assert np.abs(apart).max() < 1e-9
        np.testing.assert_allclose(found.pose_std, wanted.pose_std, rtol=1e-6)
        np.testing.assert_allclose(found.footprint, wanted.footprint, atol=1e-6)
    wanted, found = streams.contacts["pusher"], read.contacts["pusher"]
    for name in ("force", "point", "normal"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), atol=1e-8)
    np.testing.assert_allclose(found.force_std, wanted.force_std)
    assert found.point_std == pytest.approx(wanted.point_std)


def test_the_model_is_told_by_the_topics(streams, tmp_path):
    path = PushedRecording(streams, "made").to_bag(tmp_path / "push")
    assert recorded_model(path) == "pushed"
    time = np.arange(50) / 50.0
    pose = {"time": time, "position": np.zeros((50, 3)), "quaternion": [0.0, 0.0, 0.0, 1.0]}
    held = Recording.from_arrays(
        {"thumb": {"time": time, "force": np.ones((50, 3)), "position": np.zeros(3)}}, pose
    )
    assert recorded_model(held.to_bag(tmp_path / "held")) == "held"
    with pytest.raises(BadInputError, match="footprint is missing"):
        PushedRecording.from_bag(tmp_path / "held")


def test_a_path_without_forces_and_sparse_poses_are_kept(streams, tmp_path):
    link, contact = streams.links[0], streams.contacts["pusher"]
    ends = [0, len(link.time) // 2, -1]
    sparse = replace(link, time=link.time[ends], pose=link.pose[ends])
    silent = replace(contact, time=np.zeros(0), force=np.zeros((0, 3)))
    thin = replace(streams, links=(sparse,), contacts={"pusher": silent})
    read = PushedRecording.from_bag(PushedRecording(thin, "made").to_bag(tmp_path / "sparse"))
    assert len(read.streams.links[0].time) == 3
    assert len(read.streams.contacts["pusher"].time) == 0
    assert len(read.streams.contacts["pusher"].point) == len(contact.point)


def test_the_command_writes_a_recording_and_its_truth(tmp_path, capsys):
    out = tmp_path / "push"
    words = ["synthetic", "pushed", "--effect", "support_tilt", "--count", "1", "--speed"]
    assert main([*words, "0.1", "0.2", "--json", str(out)]) == 0
    written = json.loads(capsys.readouterr().out)
    truth = json.loads(Path(written["truth"]).read_text())
    assert truth["effects"]["support_tilt"]["parameters"]["angle"] == pytest.approx(np.radians(2))
    assert PushedRecording.from_bag(out).streams.contacts["pusher"].force.any()
    assert main(["synthetic", "pushed", "--effect", "ghost", str(tmp_path / "none")]) == 2


def test_slow_pushes_of_others_press_into_the_block_along_their_way(tmp_path, capsys):
    folder = Path(__file__).resolve().parents[3] / "shared" / "data" / "pushes_zhou2016"
    if not folder.exists():
        pytest.skip("../shared/data/pushes_zhou2016 is not on this machine")
    out, source = tmp_path / "zhou", folder / "hardboard_3pts_30_90.npz"
    assert main(["import", "pushes-zhou2016", str(source), str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["poses"] == 100
    contact = PushedRecording.from_bag(out).streams.contacts["pusher"]
    along = np.sum(
        contact.force[::50]
        * contact.normal[
            np.searchsorted(contact.pose_time, contact.time[::50]).clip(
                max=len(contact.pose_time) - 1
            )
        ],
        axis=1,
    )
    assert 1.5 < np.median(along) < 5.0
