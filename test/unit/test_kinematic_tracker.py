"""The kinematic tracker follows a grasped object and knows how well."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics, JointUncertaintyConfig
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.tracking.kinematic_tracker import (
    KinematicTracker,
    KinematicTrackerConfig,
    pose_error,
)
from tactile_dynamics_ros.core.tracking.pose_fusion import average_poses

ROBOT = load_robot()

HAND = np.deg2rad([0, 30, 45, 45, 0, 30, 45, 45, 5, 30, 50, 45, 60, 25, 15, 45])
START = np.concatenate([[0.1, 0.5, -0.2, -1.2, 0.3, 0.7, 0.0], HAND])
FINGERS = ("index", "middle", "ring", "thumb")
HELD = {finger: np.array([3e-3, 0.0, -6.3e-3]) for finger in FINGERS}
"""A contact point of each fingertip, sensor frame."""


@pytest.fixture
def kinematics() -> HandKinematics:
    return HandKinematics()


def object_in_hand(kinematics: HandKinematics, positions: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(np.array([0.3, -0.2, 0.5]))
    pose[:3, 3] = kinematics.locate(positions).sensors[:, :3, 3].mean(axis=0)
    return pose


def test_object_moves_rigidly_with_the_arm(kinematics):
    tracker = KinematicTracker(kinematics)
    pose = object_in_hand(kinematics, START)
    tracker.initialise(pose, START, time=0.0)
    palm = kinematics.locate(START).palm.copy()
    moved = START.copy()
    moved[:7] += [0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.5]
    expected = kinematics.locate(moved).palm @ np.linalg.inv(palm) @ pose
    estimate, covariance = tracker.update(moved, 1.0, HELD)
    assert_allclose(estimate, expected, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


class Gears:
    """Four fingertips that spin about parallel axes around a ball, by the same angle."""

    fingers = FINGERS
    robot = ROBOT
    tip, ball = 7e-3, 30e-3
    around = np.deg2rad([0.0, 80.0, 170.0, 260.0])

    def locate(self, angle):
        sensors = np.tile(np.eye(4), (4, 1, 1))
        sensors[:, :3, :3] = exp_so3(np.array([0.0, 0.0, float(angle)]))
        sensors[:, 0, 3] = (self.tip + self.ball) * np.cos(self.around)
        sensors[:, 1, 3] = (self.tip + self.ball) * np.sin(self.around)
        return SimpleNamespace(sensors=sensors)

    def jacobian(self, fingers, angle, points):
        return np.zeros((len(points), 6, ROBOT.dof))

    def contacts(self, angle):
        toward = self.around + np.pi - angle
        points = self.tip * np.stack([np.cos(toward), np.sin(toward), 0.0 * toward], axis=1)
        return dict(zip(FINGERS, points, strict=True))


def test_ball_between_turning_fingertips_turns_like_a_gear():
    """The ball stays and turns by minus the ratio of radii; points that stick would not say so."""
    gears, steps = Gears(), np.linspace(0.0, 1.0, 101)
    tracker = KinematicTracker(gears)
    tracker.initialise(np.eye(4), steps[0], time=0.0)
    for angle in steps[1:]:
        pose, _ = tracker.update(angle, float(angle), gears.contacts(angle))
    turn = log_so3(pose[:3, :3])
    assert_allclose(turn, [0.0, 0.0, -gears.tip / gears.ball], atol=0.02 * gears.tip / gears.ball)
    assert np.linalg.norm(pose[:3, 3]) < 1e-4


def test_covariance_is_that_of_the_errors(kinematics):
    config = KinematicTrackerConfig(creep_position=0.0, creep_rotation_deg=0.0)
    rng = np.random.default_rng(5)
    vision = np.diag([np.deg2rad(0.2) ** 2] * 3 + [5e-4**2] * 3)
    offset_std = np.sqrt(config.joints.constant_variance(ROBOT))
    varying_std = np.sqrt(config.joints.varying_variance(ROBOT))
    end = START + np.concatenate([0.3 * rng.normal(size=7), 0.04 * rng.normal(size=16)])
    nees = []
    for _ in range(200):
        offset = offset_std * rng.normal(size=ROBOT.dof)
        truth = object_in_hand(kinematics, START)
        palms = [kinematics.locate(q).palm.copy() for q in (START, end)]
        truth_end = palms[1] @ np.linalg.inv(palms[0]) @ truth
        error = np.sqrt(np.diag(vision)) * rng.normal(size=6)
        seen = truth.copy()
        seen[:3, :3] = exp_so3(error[:3]) @ seen[:3, :3]
        seen[:3, 3] += error[3:]
        tracker = KinematicTracker(kinematics, config)
        tracker.initialise(seen, START + offset, vision, time=0.0)
        held = np.concatenate([end[:7], START[7:]])
        noise = varying_std * rng.normal(size=ROBOT.dof)
        estimate, covariance = tracker.update(held + offset + noise, 1.0, HELD)
        residual = pose_error(estimate, truth_end)
        nees.append(residual @ np.linalg.solve(covariance, residual))
    assert 2.0 < np.mean(nees) < 7.5


def test_covariance_grows_with_joint_errors_and_time(kinematics):
    pose = object_in_hand(kinematics, START)
    moved = START + 0.1
    sizes = []
    for config, time in [
        (KinematicTrackerConfig(), 0.0),
        (KinematicTrackerConfig(), 100.0),
        (KinematicTrackerConfig(give_position=3e-3), 0.0),
    ]:
        tracker = KinematicTracker(kinematics, config)
        tracker.initialise(pose, START, 1e-10 * np.eye(6), time=0.0)
        sizes.append(np.trace(tracker.update(moved, time)[1][3:, 3:]))
    assert sizes[1] > 1.1 * sizes[0]
    assert sizes[2] > 3.0 * sizes[0]


def test_constant_offsets_of_the_hand_do_no_harm_while_only_the_arm_moves(kinematics):
    joints = JointUncertaintyConfig(
        arm_offset=0.0, arm_noise=0.0, hand_offset=0.1, hand_noise=0.0, hand_backlash=0.0
    )
    config = KinematicTrackerConfig(joints=joints, creep_position=0.0, creep_rotation_deg=0.0)
    tracker = KinematicTracker(kinematics, config)
    tracker.initialise(object_in_hand(kinematics, START), START, 1e-12 * np.eye(6), time=0.0)
    moved = START.copy()
    moved[:7] += 0.4
    arm_only = tracker.update(moved, 1.0)[1]
    moved[-4:] += 0.1
    with_thumb = tracker.update(moved, 1.0)[1]
    assert np.sqrt(arm_only[3, 3]) < 1.3 * config.give_position
    assert np.trace(with_thumb[3:, 3:]) > 2.0 * np.trace(arm_only[3:, 3:])


def test_use_before_initial_pose_and_bad_pose_are_refused(kinematics):
    tracker = KinematicTracker(kinematics)
    with pytest.raises(NotIdentifiableError, match="/object/pose/vision"):
        tracker.update(START, 0.0)
    with pytest.raises(BadInputError, match="rigid"):
        tracker.initialise(2.0 * np.eye(4), START)
    tracker.initialise(np.eye(4), START)
    tracker.reset()
    assert not tracker.initialised


def test_average_of_poses_and_its_covariance():
    rng = np.random.default_rng(8)
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = exp_so3(np.array([2.5, 1.0, -1.2])), [0.5, -0.1, 0.2]
    poses = np.tile(truth, (400, 1, 1))
    poses[:, :3, :3] = exp_so3(0.02 * rng.normal(size=(400, 3))) @ truth[:3, :3]
    poses[:, :3, 3] += 1e-3 * rng.normal(size=(400, 3))
    mean, covariance = average_poses(poses)
    assert np.linalg.norm(log_so3(mean[:3, :3] @ truth[:3, :3].T)) < 5e-3
    assert_allclose(np.sqrt(np.diag(covariance)), [1e-3] * 3 + [5e-5] * 3, rtol=0.15)
    with pytest.raises(BadInputError, match="at least 2"):
        average_poses(poses[:1])
