"""Forward kinematics against published values, Jacobians against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot

ROBOT = load_robot()

# BioTac origin (mm) at zero and at home, pad normal at home; palm frame
PUBLISHED = {
    "index": ((8.5, 59.4, 162.0), (68.8, 54.0, 100.2), (-0.174, -0.086, -0.981)),
    "middle": ((8.5, 1.6, 165.0), (68.8, 1.6, 103.0), (-0.174, 0.0, -0.985)),
    "ring": ((8.5, -56.3, 162.3), (77.5, -42.9, 87.7), (-0.341, 0.052, -0.939)),
    "thumb": (None, (118.6, 56.3, -5.5), (-0.816, -0.540, 0.205)),
}
HOME_DEG = [0, -10, 45, 45, 0, -10, 45, 45, 5, -5, 50, 45, 60, 25, 15, 45]


@pytest.fixture
def kinematics() -> HandKinematics:
    return HandKinematics()


def in_palm(kinematics: HandKinematics, positions: np.ndarray, finger: str) -> np.ndarray:
    where = kinematics.locate(positions)
    return np.linalg.inv(where.palm) @ where.sensors[kinematics.fingers.index(finger)]


@pytest.mark.parametrize("finger", list(PUBLISHED))
def test_sensor_frames_equal_published_values(kinematics, finger):
    at_zero, at_home, normal = PUBLISHED[finger]
    if at_zero is not None:
        pose = in_palm(kinematics, np.zeros(ROBOT.dof), finger)
        assert_allclose(1e3 * pose[:3, 3], at_zero, atol=0.06)
    home = np.concatenate([np.zeros(7), np.deg2rad(HOME_DEG)])
    pose = in_palm(kinematics, home, finger)
    assert_allclose(1e3 * pose[:3, 3], at_home, atol=0.06)
    assert_allclose(-pose[:3, 2], normal, atol=6e-4)


@pytest.mark.parametrize("finger", ["index", "thumb"])
def test_jacobian_equals_finite_differences(kinematics, finger):
    rng = np.random.default_rng(3)
    positions = rng.uniform(-1.0, 1.0, ROBOT.dof)
    pose = kinematics.sensor_pose(finger, positions).copy()
    local = np.array([0.004, -0.003, -0.006])
    jacobian = kinematics.jacobian(finger, positions, pose[:3, :3] @ local + pose[:3, 3])
    step = 1e-6
    for k in range(ROBOT.dof):
        moved = positions.copy()
        moved[k] += step
        after = kinematics.sensor_pose(finger, moved)
        turn = log_so3(after[:3, :3] @ pose[:3, :3].T) / step
        shift = (after - pose)[:3] @ np.append(local, 1.0) / step
        assert_allclose(jacobian[:, k], np.concatenate([turn, shift]), atol=2e-6)


def test_many_samples_equal_one_by_one(kinematics):
    positions = np.random.default_rng(1).uniform(-1.0, 1.0, (5, ROBOT.dof))
    together = kinematics.locate(positions).sensors
    for k in range(5):
        assert_allclose(together[k], kinematics.locate(positions[k]).sensors, atol=1e-12)


def test_base_pose_carries_everything(kinematics):
    base = np.eye(4)
    base[:3, 3] = [0.1, -0.2, 0.7]
    moved = HandKinematics(base_pose=base)
    positions = np.full(ROBOT.dof, 0.3)
    difference = moved.sensor_pose("ring", positions) - kinematics.sensor_pose("ring", positions)
    assert_allclose(difference, base - np.eye(4), atol=1e-12)


def test_joint_order_and_missing_joint(kinematics):
    names = list(reversed(kinematics.joint_names))
    assert_allclose(kinematics.order(names), np.arange(ROBOT.dof)[::-1])
    with pytest.raises(BadInputError, match="joint_15.0"):
        kinematics.order(names[1:])
    with pytest.raises(BadInputError, match="expected 23"):
        kinematics.locate(np.zeros(22))
    with pytest.raises(BadInputError, match="little"):
        kinematics.sensor_pose("little", np.zeros(ROBOT.dof))
