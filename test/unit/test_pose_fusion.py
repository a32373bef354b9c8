"""Kinematics and vision together: accurate, delayed, slipping, and honest."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.tracking.kinematic_tracker import pose_error
from tactile_dynamics_ros.core.tracking.pose_fusion import PoseFusion

NOISE = np.array([np.deg2rad(0.2)] * 3 + [5e-4] * 3)
BIAS = np.array([np.deg2rad(0.05)] * 3 + [2e-4] * 3)
VISION = np.diag(NOISE**2)
START = np.diag([np.deg2rad(0.3) ** 2] * 3 + [1e-3**2] * 3)


def perturbed(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    moved = pose.copy()
    moved[:3, :3] = exp_so3(step[:3]) @ pose[:3, :3]
    moved[:3, 3] += step[3:]
    return moved


def hand_motion(time: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(0.5 * np.sin([1.3 * time, 0.7 * time, 2.1 * time]))
    pose[:3, 3] = [0.5 + 0.1 * np.sin(2 * time), 0.1 * np.cos(1.5 * time), 0.4]
    return pose


def slip(time: float, rate: float) -> np.ndarray:
    """The object in the hand: it drifts, faster with rate."""
    steps = rate * time * np.array([0.003, -0.002, 0.001, 1e-4, 5e-5, -1e-4])
    return perturbed(np.eye(4), steps)


def run(rate: float, latency: float, seconds: float = 20.0, blind: tuple = (99.0, 99.0)):
    rng = np.random.default_rng(4)
    fusion = PoseFusion()
    bias = BIAS * rng.normal(size=6)
    waiting, errors, nees = [], [], []
    for k in range(round(100 * seconds)):
        time = 0.01 * k
        truth = hand_motion(time) @ slip(time, rate)
        jitter = np.array([2e-4] * 3 + [3e-5] * 3) * rng.normal(size=6)
        pose, covariance = fusion.predict(perturbed(hand_motion(time), jitter), START, time)
        if k % 3 == 0 and not blind[0] < time < blind[1]:
            seen = perturbed(truth, bias + NOISE * rng.normal(size=6))
            waiting.append((time, seen))
        while waiting and waiting[0][0] <= time - latency:
            stamp, seen = waiting.pop(0)
            fusion.correct(seen, VISION, stamp)
        error = pose_error(pose, truth)
        errors.append(error)
        nees.append(error @ np.linalg.solve(covariance, error))
    return np.array(errors), np.array(nees), fusion


@pytest.mark.parametrize("latency", [0.0, 0.1])
def test_fused_pose_is_far_better_than_either_source(latency):
    errors, nees, _ = run(rate=1.0, latency=latency)
    settled = errors[300:]
    position = np.sqrt(np.mean(np.sum(settled[:, 3:] ** 2, axis=1)))
    rotation = np.rad2deg(np.sqrt(np.mean(np.sum(settled[:, :3] ** 2, axis=1))))
    assert position < 0.6e-3  # vision alone 0.9 mm, hand alone 3 mm at the end
    assert rotation < 0.25  # vision alone 0.35 deg, hand alone 4 deg at the end
    assert 1.0 < np.mean(nees[300:]) < 12.0


def test_covariance_grows_without_vision_and_shrinks_with_it():
    fusion = PoseFusion()
    sizes = []
    for k in range(1000):
        _, covariance = fusion.predict(np.eye(4), START, 0.01 * k)
        if 300 <= k < 600:
            fusion.correct(np.eye(4), VISION, 0.01 * k)
        sizes.append(np.trace(covariance[3:, 3:]))
    assert sizes[299] > sizes[0]
    assert sizes[599] < 0.2 * sizes[299]
    assert sizes[999] > 1.5 * sizes[599]


def test_blackout_is_bridged_by_the_hand():
    errors, nees, _ = run(rate=0.3, latency=0.05, blind=(10.0, 12.0))
    assert np.linalg.norm(errors[1190, 3:]) < 2e-3
    assert nees[1190] < 40.0


def test_an_object_that_rolls_unseen_is_not_known_for_sure_and_is_found_again():
    fusion = PoseFusion()
    roll = np.array([np.deg2rad(8.0), 0.0, 0.0, 0.0, 0.004, 0.003])
    for k in range(300):
        fusion.predict(np.eye(4), START, 0.01 * k)
        if k % 7 == 0:
            assert fusion.correct(np.eye(4), VISION, 0.01 * k)
    for k in range(300, 350):
        truth = perturbed(np.eye(4), 0.01 * (k - 300) * roll)
        pose, covariance = fusion.predict(np.eye(4), START, 0.01 * k)
        error = pose_error(pose, truth)
        wrong = np.linalg.norm(error[:3]) > np.deg2rad(3.0)
        assert not wrong or error @ np.linalg.solve(covariance, error) < 22.46  # 0.999 quantile
    assert wrong
    assert fusion.correct(truth, VISION, 3.49)
    spread = [fusion.predict(np.eye(4), START, 0.01 * k)[1] for k in range(350, 1500)]
    seen, late = spread[18], spread[-1]
    config = fusion.config
    growth = 11.5 * fusion.slip_factor + (config.unseen_slip * config.unseen_time) ** 2
    for axis, usual in ((0, np.deg2rad(config.slip_rotation_deg)), (3, config.slip_position)):
        assert late[axis, axis] == pytest.approx(growth * usual**2, rel=0.1)
        assert seen[axis, axis] < 0.05 * late[axis, axis]


def test_outliers_are_rejected_but_a_jump_is_followed():
    fusion = PoseFusion()
    rng = np.random.default_rng(1)
    far = perturbed(np.eye(4), np.array([0.3, 0.0, 0.0, 0.05, 0.0, 0.0]))
    for k in range(300):
        pose, _ = fusion.predict(np.eye(4), START, 0.01 * k)
        seen = far if k in (100, 101, 102) else np.eye(4)
        used = fusion.correct(perturbed(seen, NOISE * rng.normal(size=6)), VISION, 0.01 * k)
        assert used == (k not in (100, 101, 102))
        assert np.linalg.norm(pose[:3, 3]) < 1.5e-3
    for k in range(300, 340):
        pose, _ = fusion.predict(np.eye(4), START, 0.01 * k)
        fusion.correct(perturbed(far, NOISE * rng.normal(size=6)), VISION, 0.01 * k)
    assert np.linalg.norm(pose_error(pose, far)[3:]) < 2e-3


def test_vision_before_the_hand_or_from_long_ago():
    fusion = PoseFusion()
    with pytest.raises(NotIdentifiableError, match="before"):
        fusion.correct(np.eye(4), VISION, 0.0)
    for k in range(300):
        fusion.predict(np.eye(4), START, 0.01 * k)
    assert not fusion.correct(np.eye(4), VISION, 0.1)


def test_a_refuted_pose_is_doubted_until_vision_agrees():
    fusion = PoseFusion()
    for k in range(50):
        _, before = fusion.predict(np.eye(4), START, 0.01 * k)
        fusion.correct(np.eye(4), VISION, 0.01 * k)
    fusion.refute()
    _, doubted = fusion.predict(np.eye(4), START, 0.5)
    assert fusion.doubtful
    assert np.sqrt(doubted[3, 3]) > 0.02 > np.sqrt(before[3, 3])
    fusion.correct(np.eye(4), VISION, 0.5)
    _, after = fusion.predict(np.eye(4), START, 0.51)
    assert not fusion.doubtful
    assert np.trace(after) < 2.0 * np.trace(before)


def test_disagreement_shows_in_the_covariance_at_once():
    fusion = PoseFusion()
    for k in range(50):
        fusion.predict(np.eye(4), START, 0.01 * k)
        fusion.correct(np.eye(4), VISION, 0.01 * k)
    far = perturbed(np.eye(4), np.array([0.0, 0.0, 0.0, 0.03, 0.0, 0.0]))
    assert not fusion.correct(far, VISION, 0.49)
    _, covariance = fusion.predict(np.eye(4), START, 0.5)
    assert np.sqrt(covariance[3, 3]) > 0.029


def test_many_images_with_the_same_error_do_not_feign_precision():
    fusion = PoseFusion()
    for k in range(500):
        _, covariance = fusion.predict(np.eye(4), START, 0.01 * k)
        fusion.correct(np.eye(4), 1e-4 * VISION, 0.01 * k)
    config = fusion.config
    assert np.sqrt(covariance[3, 3]) > config.bias_position
    assert np.sqrt(covariance[0, 0]) > np.deg2rad(config.bias_rotation_deg)


def test_what_vision_cannot_see_is_left_to_the_hand():
    fusion = PoseFusion()
    blind = VISION.copy()
    blind[2, 2] = 100.0
    spun = perturbed(np.eye(4), np.array([0.0, 0.0, 0.4, 0.0, 0.0, 0.0]))
    for k in range(100):
        pose, _ = fusion.predict(np.eye(4), START, 0.01 * k)
        assert fusion.correct(spun, blind, 0.01 * k)
    assert np.linalg.norm(pose_error(pose, np.eye(4))[:3]) < 0.01
