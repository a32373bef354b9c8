"""What a motion would tell: information of wrenches whose noise is unlike along all axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.inertia.excitation.design import (
    InertiaCriterion,
    wrench_covariance,
    wrench_information,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor

BODY = InertialParameters(0.7, np.array([0.02, -0.01, 0.03]), np.diag([3e-4, 5e-4, 7e-4]))


def motion(seed: int = 1, count: int = 40) -> WrenchSamples:
    """Three contacts far apart along x and near along z, the second absent now and then."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(count, random_state=seed).as_matrix()
    points = rng.normal(size=(count, 3, 3)) * [0.2, 0.05, 0.01]
    held = np.ones((count, 3), dtype=bool)
    held[::3, 1] = False
    vectors = [3.0 * rng.normal(size=(count, 3)) for _ in range(5)]
    frames = np.broadcast_to(np.eye(3), (count, 3, 3, 3))
    return WrenchSamples(
        np.arange(count), vectors[0], turn, *vectors[1:], ("a", "b", "c"), points, frames,
        0.0 * points, 0.0 * points, held, np.array([0.0, 0.0, -9.81]),
    )  # fmt: skip


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def covariance(samples: WrenchSamples, k: int, std: float) -> np.ndarray:
    total = 1e-12 * np.eye(6)
    for point, held in zip(samples.contact_point[k], samples.in_contact[k], strict=True):
        grasp = np.concatenate([skew(point), np.eye(3)])
        total += held * std**2 * grasp @ grasp.T
    return total


def test_noise_of_a_wrench_is_that_of_the_forces_that_touch_with_their_arms():
    samples = motion()
    found = wrench_covariance(samples, 0.04)
    for k in range(40):
        np.testing.assert_allclose(found[k], covariance(samples, k, 0.04), atol=1e-14)


def information(samples: WrenchSamples, std: float) -> np.ndarray:
    total = np.zeros((10, 10))
    for k, turn in enumerate(samples.rotation):
        measured = turn.T @ (samples.acceleration[k] - samples.gravity)
        rates = samples.angular_velocity[k], samples.angular_acceleration[k]
        rows = regressor(measured[None], *(rate[None] for rate in rates))[0]
        total += rows.T @ np.linalg.solve(covariance(samples, k, std), rows)
    return total


def test_information_is_weighed_by_the_noise_of_each_wrench():
    samples = motion()
    found = wrench_information(samples, 0.04)
    np.testing.assert_allclose(found, information(samples, 0.04), rtol=1e-6)


def test_criteria_are_the_expected_distance_and_the_volume_in_the_metric_of_the_body():
    samples = motion()
    known = information(motion(7), 0.02)
    phi = BODY.dynamic_parameters
    total = known + 3.0 * information(samples, 0.05)
    plan = InertiaCriterion(phi, known, force_std=0.05, rate_ratio=3.0)
    expected = np.trace(plan.metric @ np.linalg.inv(total))
    assert plan(samples) == pytest.approx(expected, rel=1e-6)
    volume = np.linalg.slogdet(plan.metric)[1] - np.linalg.slogdet(total)[1]
    assert replace(plan, kind="D")(samples) == pytest.approx(volume, rel=1e-6)


def test_the_metric_is_the_squared_distance_of_nearby_bodies():
    """G of a step d is sum log^2 eig(P^-1 P') to second order, d along single parameters."""
    phi = BODY.dynamic_parameters
    metric = InertiaCriterion(phi, np.eye(10)).metric
    rng = np.random.default_rng(2)
    for _ in range(20):
        step = 1e-6 * rng.normal(size=10) * [1.0, 0.1, 0.1, 0.1, *6 * [1e-2]]
        near = InertialParameters.from_dynamic_parameters(phi + step).pseudo_inertia
        ratio = np.linalg.eigvals(np.linalg.solve(BODY.pseudo_inertia, near)).real
        assert step @ metric @ step == pytest.approx(np.sum(np.log(ratio) ** 2), rel=1e-3)


def test_contacts_that_do_not_touch_bring_no_noise():
    samples = motion()
    loose = replace(samples, in_contact=np.tile([True, False, True], (40, 1)))
    far = loose.contact_point.copy()
    far[:, 1] += 100.0
    moved = replace(loose, contact_point=far)
    np.testing.assert_allclose(wrench_covariance(moved, 0.1), wrench_covariance(loose, 0.1))
