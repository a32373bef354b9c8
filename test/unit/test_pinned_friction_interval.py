"""Intervals of the friction coefficient: closed forms and coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from tactile_dynamics_ros.core.friction.estimate import (
    FrictionEstimateConfig,
    SlipEvent,
    estimate_region,
)

DRAWS = 200
MU = 0.8
CONFIG = FrictionEstimateConfig()


def slips(ratios: np.ndarray, angles: np.ndarray, std: np.ndarray) -> list[SlipEvent]:
    triples = zip(ratios, angles, std, strict=True)
    return [SlipEvent(float(k), "a", a, 2.0, 2.0 * r, s) for k, (r, a, s) in enumerate(triples)]


def regression(ratios, angles, std, config):
    """Solution and covariance of [mu, b_x, b_y] by stacked rows, no outliers."""
    middle = np.median(ratios)
    steep = 1.0 + middle**2
    design = np.stack(
        [np.ones_like(angles), steep * np.cos(angles), steep * np.sin(angles)], axis=1
    )
    spread = np.hypot(std, config.scatter * middle)
    tilt = np.deg2rad(config.tilt_std_deg)
    rows = np.concatenate([design / spread[:, None], np.eye(3)[1:] / tilt])
    target = np.concatenate([ratios / spread, np.zeros(2)])
    solution = np.linalg.lstsq(rows, target, rcond=None)[0]
    error = (ratios - design @ solution) / spread
    assert np.all(np.abs(error) < 2.0)  # none is weighed down
    return solution, np.linalg.inv(rows.T @ rows), error


@pytest.mark.parametrize("loud", [0.3, 2.0])
def test_interval_is_that_of_a_regression_with_students_quantile_and_the_gain(loud):
    config = FrictionEstimateConfig(gain=1.2, gain_std=0.07, confidence=0.9)
    angles = np.array([0.3, 0.3 + np.pi, 1.1, 1.1 + np.pi, 2.0])
    std = np.array([0.01, 0.05, 0.02, 0.08, 0.03])
    errors = loud * np.array([0.5, -0.4, 0.6, 0.3, -0.5]) * np.hypot(std, 0.03 * MU)
    ratios = MU + 0.1 * np.cos(angles) + errors
    solution, covariance, error = regression(ratios, angles, std, config)
    excess = max(np.sqrt((np.sum(error**2) + 4.0) / (4 + 4.0)), 0.5)
    found = estimate_region("a", slips(ratios, angles, std), config)
    assert found.static == pytest.approx(1.2 * solution[0])
    own = 1.2 * excess * np.sqrt(covariance[0, 0])
    assert found.std == pytest.approx(np.hypot(own, 0.07 * found.static))
    quantile = student.ppf(0.95, 4 + 4)
    assert found.repeatable == pytest.approx(quantile * own)
    assert found.width == pytest.approx(2 * quantile * found.std)
    assert sum(found.interval) == pytest.approx(2 * found.static)
    np.testing.assert_allclose(found.tilt, solution[1:], atol=1e-9)


@pytest.mark.parametrize("count", [3, 8])
def test_nineteen_of_twenty_intervals_hold_the_truth_with_unlike_directions(count):
    rng = np.random.default_rng(count)
    held = 0
    for _ in range(DRAWS):
        angles = rng.uniform(0.0, 1.5, count)  # all to one side: the tilt does not cancel
        tilt = np.deg2rad(CONFIG.tilt_std_deg) * rng.normal(size=2)
        std = rng.uniform(0.005, 0.08, count)
        errors = rng.normal(size=count) * np.hypot(std, CONFIG.scatter * MU)
        true = MU * (1.0 + CONFIG.gain_std * rng.normal())
        toward = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ tilt
        ratios = MU + (1.0 + MU**2) * toward + errors
        low, high = estimate_region("a", slips(ratios, angles, std), CONFIG).interval
        held += low <= true <= high
    assert 0.92 * DRAWS <= held <= 0.995 * DRAWS


def test_kinetic_friction_scatters_by_its_mean_and_shares_the_gain():
    kinetic = np.array([0.5, 0.55, 0.6, 0.52, np.nan, 0.57])
    events = [
        SlipEvent(float(k), "a", 1.0 * k, 2.0, 1.6, 0.02, kinetic=value)
        for k, value in enumerate(kinetic)
    ]
    found = estimate_region("a", events, CONFIG)
    seen = kinetic[np.isfinite(kinetic)]
    assert found.kinetic == pytest.approx(np.median(seen))
    scatter = seen.std(ddof=1) / np.sqrt(5)
    assert found.kinetic_std == pytest.approx(np.hypot(scatter, CONFIG.gain_std * found.kinetic))
