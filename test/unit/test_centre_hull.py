"""The centre of mass stays inside the object, at the most likely place there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from benchmarks.support.live_replay import replay_streams
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.inertia.live import IncrementalInertialEstimator
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    is_feasible,
)
from tactile_dynamics_ros.core.shape.solid import CentreHull, keep_in_hull
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

CUBE = 0.05 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


@settings(max_examples=60, deadline=None)
@given(
    point=st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3).map(np.array),
    seed=st.integers(0, 500),
)
def test_nearest_point_is_inside_and_no_neighbour_is_better(point, seed):
    rng = np.random.default_rng(seed)
    hull = CentreHull.of_points(CUBE)
    half = rng.normal(size=(3, 3)) + 2.0 * np.eye(3)
    metric = half @ half.T
    found = hull.nearest(point, metric)
    assert np.all(np.abs(found) <= 0.05 + 1e-9)
    if np.all(np.abs(point) < 0.0499):
        assert_allclose(found, point, atol=1e-7)
        return

    def cost(c):
        return (c - point) @ metric @ (c - point) * 1e4

    best = minimize(cost, np.zeros(3), bounds=[(-0.05, 0.05)] * 3)
    assert cost(found) <= best.fun * (1.0 + 1e-3) + 1e-3


def test_other_coordinates_follow_the_information():
    rng = np.random.default_rng(1)
    half = rng.normal(size=(10, 10))
    information, xi = half @ half.T + np.eye(10), rng.normal(size=10) * 0.1
    xi[7:] = [0.08, 0.0, 0.0]
    hull = CentreHull.of_points(CUBE)
    moved = keep_in_hull(xi, information, hull)
    gradient = information @ (moved - xi)
    assert_allclose(gradient[:7], 0.0, atol=1e-9)
    assert hull.contains(moved[7:])
    assert is_feasible(InertialParameters.from_log_cholesky(moved).dynamic_parameters)


def test_live_estimates_stay_inside():
    recording = generate(6, scenario=ScenarioOptions(duration=2.0))
    small = recording.scenario.body.com + 0.02 * CUBE + np.array([0.003, 0.0, 0.0])
    hull = CentreHull.of_points(small)
    estimator = IncrementalInertialEstimator()
    estimator.set_hull(small)
    for estimate in replay_streams(recording.streams, estimator):
        assert hull.contains(estimate.inertia.com)
        assert is_feasible(estimate.inertia.dynamic_parameters)
    estimator.set_hull(None)
    assert not hull.contains(estimator.update().inertia.com)


def test_batch_estimate_stays_inside():
    recording = generate(6, scenario=ScenarioOptions(duration=2.0))
    small = recording.scenario.body.com + 0.02 * CUBE + np.array([0.003, 0.0, 0.0])
    assert CentreHull.of_points(small).contains(
        estimate_body(recording.streams, hull=small).to_estimate().inertia.com
    )


def test_flat_shapes_are_refused():
    with pytest.raises(BadInputError, match="span a volume"):
        CentreHull.of_points(np.zeros((5, 3)))
