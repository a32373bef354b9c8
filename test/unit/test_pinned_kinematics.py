"""Kinematics of arm and right hand against numbers from before the robot was read from a URDF."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics

PINNED = json.loads((Path(__file__).parent / "pinned_kinematics.json").read_text())


def test_names_and_their_order():
    kinematics = HandKinematics()
    assert list(kinematics.joint_names) == PINNED["joints"]
    assert list(kinematics.fingers) == PINNED["fingers"]


@pytest.mark.parametrize("posture", PINNED["postures"])
def test_poses_and_jacobians_to_rounding(posture):
    kinematics = HandKinematics()
    positions = np.array(posture["positions"])
    where = kinematics.locate(positions)
    assert_allclose(where.palm, posture["palm"], rtol=0, atol=1e-12)
    assert_allclose(where.sensors, posture["sensors"], rtol=0, atol=1e-12)
    rows = zip(kinematics.fingers, posture["points"], posture["jacobians"], strict=True)
    for finger, point, jacobian in rows:
        found = kinematics.jacobian(finger, positions, np.array(point))
        assert_allclose(found, jacobian, rtol=0, atol=1e-12)
