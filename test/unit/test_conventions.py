"""Recordings that break a convention of the contract are read, and the user is told which."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_recording import held_box

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.recording import Recording


@pytest.fixture(scope="module")
def streams() -> Streams:
    """Return what is measured of a box of 0.4 kg held by four fingers."""
    return held_box(seconds=3.0).streams


def _lines(streams: Streams) -> list[str]:
    return Recording(streams, "test").problem_lines()


def _with_contacts(streams: Streams, change) -> Streams:
    return replace(streams, contacts={n: change(c) for n, c in streams.contacts.items()})


def _in_other_world(streams: Streams, turn: np.ndarray) -> Streams:
    """The same measurements in a world whose axes are turned."""
    pose = replace(
        streams.pose,
        position=streams.pose.position @ turn.T,
        rotation=turn @ streams.pose.rotation,
    )
    turned = _with_contacts(
        streams,
        lambda c: replace(
            c, force=c.force @ turn.T, position=c.position @ turn.T, rotation=turn @ c.rotation
        ),
    )
    return replace(turned, pose=pose)


def test_nothing_is_said_of_a_recording_to_the_contract(streams):
    assert _lines(streams) == []


def test_forces_on_the_fingers_are_noticed(streams):
    [line] = _lines(_with_contacts(streams, lambda c: replace(c, force=-c.force)))
    assert "4 N along (0.0, 0.0, -1.0)" in line
    assert "negate them" in line


def test_a_world_whose_y_axis_is_up_is_noticed(streams):
    to_y_up = Rotation.from_euler("x", -90, degrees=True).as_matrix()
    [line] = _lines(_in_other_world(streams, to_y_up))
    assert "(0.0, 1.0, 0.0)" in line
    assert "z of the world" in line


def test_millimetres_are_noticed(streams):
    pose = replace(streams.pose, position=1e3 * streams.pose.position)
    large = _with_contacts(streams, lambda c: replace(c, position=1e3 * c.position))
    [line] = _lines(replace(large, pose=pose))
    assert "metres" in line


def test_positions_of_two_world_frames_are_noticed(streams):
    moved = _with_contacts(streams, lambda c: replace(c, position=c.position + [0.0, 5.0, 0.0]))
    [line] = _lines(moved)
    assert "contact index is 5.02 m from" in line


def test_poses_in_no_order_are_noticed(streams):
    mixed = np.random.default_rng(0).permutation(len(streams.pose.time))
    turns = Rotation.random(len(mixed), random_state=0).as_matrix()
    pose = replace(streams.pose, position=streams.pose.position[mixed], rotation=turns)
    [line] = _lines(replace(streams, pose=pose))
    assert "from one sample to the next" in line


def test_a_tracker_that_stands_still_is_noticed(streams):
    pose = streams.pose
    still = replace(
        pose,
        position=np.broadcast_to(pose.position[0], pose.position.shape),
        rotation=np.broadcast_to(pose.rotation[0], pose.rotation.shape),
    )
    [line] = _lines(replace(streams, pose=still))
    assert "never changes (300 equal samples)" in line


def test_a_part_beyond_the_end_is_refused(streams, tmp_path, capsys):
    path = str(Recording(streams, "test").to_bag(tmp_path / "box.mcap"))
    assert main(["estimate", path, "--between", "10,20"]) == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert "--between 10,20: nothing was recorded then" in line
    assert "lasts from 0 to 3.0 s" in line


def test_the_command_says_in_one_line_that_no_contact_pushes(streams, tmp_path, capsys):
    idle = _with_contacts(streams, lambda c: replace(c, force=0.0 * c.force))
    path = Recording(idle, "test").to_bag(tmp_path / "idle.mcap")
    assert main(["estimate", str(path)]) == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert "no contact has a usable force" in line
