"""Covariance of the fused pose: that of a Kalman filter with noise unlike along all axes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.tracking.pose_fusion import (
    PoseFusion,
    PoseFusionConfig,
    average_poses,
)

DRAWS = 200
CONFIG = PoseFusionConfig(smoothing=0.0, adaptation=0.0)
POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([0.9, -0.7, 1.3]).as_matrix()
POSE[:3, 3] = [0.5, -0.2, 0.4]
TURN = block_diag(POSE[:3, :3], POSE[:3, :3])
BOTH = np.hstack([np.eye(6), np.eye(6)])


def unlike(seed: int, scale: float) -> np.ndarray:
    """A covariance (6, 6) with unlike, correlated axes, rad and m."""
    factor = np.random.default_rng(seed).normal(size=(6, 6)) * np.geomspace(0.3, 3.0, 6)
    unit = np.array([5e-3] * 3 + [1e-3] * 3) * scale
    return np.outer(unit, unit) * (factor @ factor.T + 0.1 * np.eye(6))


START, VISION = unlike(1, 1.0), unlike(2, 0.5)


def diagonal(rotation_deg: float, position: float) -> np.ndarray:
    return np.diag([np.deg2rad(rotation_deg) ** 2] * 3 + [position**2] * 3)


GROWTH = diagonal(CONFIG.slip_rotation_deg, CONFIG.slip_position)
BIAS = diagonal(CONFIG.bias_rotation_deg, CONFIG.bias_position)
WANDER = diagonal(CONFIG.wander_rotation_deg, CONFIG.wander_position)


def corrected(past: np.ndarray) -> np.ndarray:
    """Covariance (12, 12) of slip and wander after an image, by their information."""
    noise = TURN.T @ VISION @ TURN
    return np.linalg.inv(np.linalg.inv(past) + BOTH.T @ np.linalg.solve(noise, BOTH))


def published(slip: np.ndarray) -> np.ndarray:
    return TURN @ (slip + BIAS) @ TURN.T


def first_image() -> np.ndarray:
    return corrected(block_diag(TURN.T @ START @ TURN, WANDER))


def agree(found: np.ndarray, expected: np.ndarray) -> None:
    unit = np.linalg.inv(np.linalg.cholesky(expected))
    np.testing.assert_allclose(unit @ found @ unit.T, np.eye(6), atol=1e-6)


def test_one_image_leaves_what_prediction_and_image_leave_together():
    fusion = PoseFusion(CONFIG)
    _, before = fusion.predict(POSE, START, 0.0)
    agree(before, published(TURN.T @ START @ TURN))
    assert fusion.correct(POSE, VISION, 0.0)
    agree(fusion.predict(POSE, START, 0.0)[1], published(first_image()[:6, :6]))


def test_wander_of_vision_lasts_so_that_many_images_at_once_are_hardly_more_than_one():
    fusion = PoseFusion(CONFIG)
    fusion.predict(POSE, START, 0.0)
    expected = first_image()
    fusion.correct(POSE, VISION, 0.0)
    for _ in range(20):
        fusion.correct(POSE, VISION, 0.0)
        expected = corrected(expected)
    agree(fusion.predict(POSE, START, 0.0)[1], published(expected[:6, :6]))


def test_a_late_image_says_nothing_of_slip_since_it_was_taken():
    fusion = PoseFusion(CONFIG)
    for time in (0.0, 0.1):
        fusion.predict(POSE, START, time)
    fusion.correct(POSE, VISION, 0.0)
    expected = first_image()[:6, :6] + 0.1 * GROWTH
    agree(fusion.predict(POSE, START, 0.1)[1], published(expected))


def test_slip_grows_and_wander_fades_from_image_to_image():
    fusion = PoseFusion(CONFIG)
    fusion.predict(POSE, START, 0.0)
    fusion.correct(POSE, VISION, 0.0)
    fusion.predict(POSE, START, 0.15)
    fusion.correct(POSE, VISION, 0.15)
    fade = block_diag(np.eye(6), np.exp(-0.15 / CONFIG.wander_time) * np.eye(6))
    past = fade @ first_image() @ fade
    past[:6, :6] += 0.15 * GROWTH
    past[6:, 6:] += (1.0 - np.exp(-0.3 / CONFIG.wander_time)) * WANDER
    agree(fusion.predict(POSE, START, 0.15)[1], published(corrected(past)[:6, :6]))


def test_errors_of_the_fused_pose_are_as_large_as_it_says():
    """Squared normalised errors over 200 draws; expected 6, of which bias is not drawn."""
    rng = np.random.default_rng(3)
    factors = [np.linalg.cholesky(c) for c in (START, VISION, TURN @ WANDER @ TURN.T)]
    found = []
    for _ in range(DRAWS):
        fusion = PoseFusion(CONFIG)
        start, *seen, wander = (f @ rng.normal(size=6) for f in (*factors[:2], *factors[1:]))
        fusion.predict(moved(start), START, 0.0)
        for noise in seen:
            fusion.correct(moved(noise + wander), VISION, 0.0)
        pose, covariance = fusion.predict(moved(start), START, 0.0)
        error = np.concatenate(
            [
                Rotation.from_matrix(pose[:3, :3] @ POSE[:3, :3].T).as_rotvec(),
                pose[:3, 3] - POSE[:3, 3],
            ]
        )
        found.append(error @ np.linalg.solve(covariance, error))
    assert 4.6 < np.mean(found) < 6.8


def moved(step: np.ndarray) -> np.ndarray:
    pose = POSE.copy()
    pose[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += step[3:]
    return pose


def test_a_contradiction_widens_by_its_own_square():
    fusion = PoseFusion(CONFIG)
    _, before = fusion.predict(POSE, START, 0.0)
    away = POSE.copy()
    away[:3, 3] += [0.2, -0.1, 0.05]
    assert not fusion.correct(away, VISION, 0.0)
    _, doubted = fusion.predict(POSE, START, 0.0)
    expected = np.zeros((6, 6))
    expected[3:, 3:] = np.outer([0.2, -0.1, 0.05], [0.2, -0.1, 0.05])
    np.testing.assert_allclose(doubted - before, expected, atol=1e-9)


def test_covariance_of_a_mean_pose_is_that_of_the_scatter_over_its_number():
    rng = np.random.default_rng(4)
    factor = np.linalg.cholesky(unlike(5, 1.0))
    poses = np.stack([moved(factor @ rng.normal(size=6)) for _ in range(2000)])
    _, covariance = average_poses(poses)
    unit = np.linalg.inv(factor)
    np.testing.assert_allclose(2000 * unit @ covariance @ unit.T, np.eye(6), atol=0.12)
    assert covariance.shape == (6, 6)


@pytest.mark.parametrize("unseen", [0.3, 0.6, 5.0])
def test_slip_that_nobody_sees_grows_with_the_square_of_the_time(unseen):
    fusion = PoseFusion(CONFIG)
    fusion.predict(POSE, START, 0.0)
    fusion.correct(POSE, VISION, 0.0)
    _, before = fusion.predict(POSE, START, 0.0)
    _, after = fusion.predict(POSE, START, unseen)
    span = min(unseen - CONFIG.unseen_after, CONFIG.unseen_time)
    grown = (unseen + (CONFIG.unseen_slip * span) ** 2) * TURN @ GROWTH @ TURN.T
    np.testing.assert_allclose(after - before, grown, atol=1e-9 * grown.max())
