"""Frames of tf: chains, times between those that were said, what is not known."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.frame_tree import FrameTree
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3


def pose(x=0.0, turn=0.0):
    made = np.eye(4)
    made[0, 3], made[:3, :3] = x, exp_so3(np.array([0.0, 0.0, turn]))
    return made


@pytest.fixture
def arm():
    """A base on a table, a flange that turns and moves, a sensor on it."""
    tree = FrameTree()
    tree.add("table", "base", 0.0, pose(1.0), static=True)
    tree.add("flange", "sensor", 0.0, pose(0.1), static=True)
    for time in (1.0, 1.2, 1.1):
        tree.add("base", "flange", time, pose(time, time - 1.0))
    return tree


def test_a_chain_is_followed_and_times_between_are_found(arm):
    found = arm.at("base", "sensor", 1.05)
    np.testing.assert_allclose(found, pose(1.05, 0.05) @ pose(0.1), atol=1e-12)
    np.testing.assert_allclose(
        arm.at("table", "sensor", 1.2), pose(1.0) @ pose(1.2, 0.2) @ pose(0.1)
    )
    np.testing.assert_allclose(arm.at("sensor", "base", 1.05), np.linalg.inv(found), atol=1e-12)


def test_before_and_after_what_was_said_nothing_is_known(arm):
    assert arm.at("base", "sensor", 0.99) is None
    assert arm.at("base", "sensor", 1.21) is None
    assert arm.at("flange", "sensor", 99.0) is not None
    arm.clear()
    with pytest.raises(BadInputError, match="not connected"):
        arm.at("base", "sensor", 1.0)


def test_unknown_and_unconnected_frames_are_named(arm):
    with pytest.raises(BadInputError, match="'sensr' is not in /tf.*did you mean 'sensor'"):
        arm.at("base", "sensr", 1.0)
    arm.add("elsewhere", "camera", 0.0, pose(), static=True)
    with pytest.raises(BadInputError, match="'base' and 'camera' are not connected"):
        arm.at("base", "camera", 1.0)
    arm.add("sensor", "table", 0.0, pose(), static=True)
    with pytest.raises(BadInputError, match="its own ancestor"):
        arm.at("base", "sensor", 1.0)


def test_old_frames_are_let_go(arm):
    for time in np.arange(2.0, 20.0, 0.5):
        arm.add("base", "flange", time, pose(time))
    assert arm.at("base", "sensor", 1.1) is None
    assert len(arm._links["flange"].times) <= 21
