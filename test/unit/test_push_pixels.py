"""Pixels of an image as an observation of a link's pose."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.planar.filter.dual import DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import (
    Observation,
    Pixels,
    coverage,
    pose_of_pixels,
)
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess

BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
SIDE = np.linspace(-0.12, 0.12, 64)
GRID = np.stack(np.meshgrid(SIDE, SIDE), axis=-1).reshape(-1, 2)
"""64 x 64 pixels of 3.8 mm."""
NONE = np.array([1e-8, 1e-8, 1e-7])
"""Lasting error that is as good as none."""


def linear_pixels(rng, slopes, lasting):
    """An image that is linear in the pose, with uneven noise."""
    std = rng.uniform(0.1, 2.0, len(slopes))
    value = slopes @ [2e-3, -1e-3, 0.02] + std * rng.standard_normal(len(slopes))
    return Pixels(value, std, lambda poses: poses @ slopes.T, lasting)


def posterior(mean, covariance, by_pose, value, noise):
    """Kalman update with a matrix as large as the measurement."""
    gain = covariance @ by_pose.T @ np.linalg.inv(by_pose @ covariance @ by_pose.T + noise)
    return mean + gain @ (value - by_pose @ mean), covariance - gain @ by_pose @ covariance


@pytest.mark.parametrize("lasting", [NONE, np.array([1e-3, 2e-3, 1e-2])])
@pytest.mark.parametrize("told", [3, 2])
def test_three_numbers_are_worth_as_much_as_the_matrix_of_all_pixels(lasting, told):
    rng = np.random.default_rng(told)
    slopes = rng.normal(size=(300, 3)) * [100.0, 50.0, 5.0]
    slopes[:, told:] = 0.0
    pixels = linear_pixels(rng, slopes, lasting)
    root = rng.normal(size=(3, 3)) * np.array([[1e-3], [2e-3], [2e-2]])
    mean, covariance = np.array([1e-3, 0.0, -0.01]), root @ root.T
    common = slopes @ np.diag(lasting**2) @ slopes.T
    dense = posterior(mean, covariance, slopes, pixels.value, np.diag(pixels.std**2) + common)
    few = pose_of_pixels(pixels, mean, covariance)
    short = posterior(mean, covariance, few.along, few.value, np.diag(few.std**2))
    assert_allclose(short[0], dense[0], rtol=1e-5, atol=1e-9)
    assert_allclose(short[1], dense[1], rtol=1e-5, atol=1e-5 * covariance.max())


def test_an_age_tells_of_the_pose_before_the_end_of_the_step():
    pixels = linear_pixels(np.random.default_rng(3), np.eye(3), NONE)
    seen = pose_of_pixels(pixels, np.zeros(3), np.eye(3), link=1, age=0.02)
    derivative = Observation((seen,)).by_state(12)
    assert_allclose(derivative[:, 9:], -0.02 * derivative[:, 6:9])
    assert not derivative[:, :6].any()


def test_a_mask_of_64_by_64_pixels_brings_a_pose_that_is_off_to_where_the_object_is():
    rng, true = np.random.default_rng(4), np.array([4e-3, -3e-3, 0.06])
    std = np.full(len(GRID), 0.1)
    value = coverage(BLOCK, true[None], GRID, 0.004)[0] + std * rng.standard_normal(len(GRID))
    pixels = Pixels(value, std, lambda poses: coverage(BLOCK, poses, GRID, 0.004), NONE)
    belief = DualFilter(PatchProcess(BLOCK), np.zeros(3), np.array([5e-3, 5e-3, 0.1]))
    mean, covariance = belief.state
    seen = pose_of_pixels(pixels, mean[:3], covariance[:3, :3])
    belief.step(None, Observation((seen,)))
    after, left = belief.state
    std_left = np.sqrt(np.diag(left))[:3]
    assert np.all(std_left < [2e-4, 2e-4, 4e-3])
    assert np.all(np.abs(after[:3] - true) < 3.0 * std_left)
    wide = replace(pixels, lasting=np.array([1e-3, 1e-3, 1e-2]))
    belief = DualFilter(PatchProcess(BLOCK), np.zeros(3), np.array([5e-3, 5e-3, 0.1]))
    belief.step(None, Observation((pose_of_pixels(wide, mean[:3], covariance[:3, :3]),)))
    assert_allclose(np.sqrt(np.diag(belief.state[1]))[:3], [1e-3, 1e-3, 1e-2], rtol=0.05)


def test_a_pixel_at_the_edge_is_half_covered():
    share = coverage(BLOCK, np.array([[0.01, 0.0, np.pi / 2]]), np.array([[-0.02, 0.0]]), 0.004)
    assert_allclose(share, [[0.5]])
