"""Paper A's methods: right Jacobians, exact on exact data, and its known failures reproduced."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.peers.paper_a import METHODS, TimeSteps, estimate_as_published
from benchmarks.peers.paper_a.dynamics import differentiate
from benchmarks.peers.paper_a.factors import (
    AXES_KEY,
    VECTOR_KEY,
    InertiaVariables,
    consistency_factor,
    dynamics_factor,
    prior_factor,
)
from benchmarks.peers.paper_a.parameters import (
    phi_of_principal,
    principal_of_phi,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    is_feasible,
    pseudo_inertia,
    trace_error,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions
from tactile_dynamics_ros.synthetic.sensors import SensorOptions

EXACT = SensorOptions(force_std=1e-9, position_std=0.0, rotation_std_deg=0.0)


def truth_of(recording) -> InertialParameters:
    body = recording.scenario.body
    return InertialParameters(body.mass, body.com, body.inertia_com)


@pytest.fixture(scope="module")
def exact():
    return generate(0, scenario=ScenarioOptions(duration=5.0), sensors=EXACT)


def check_jacobians(factor: gtsam.CustomFactor, values: gtsam.Values, scale: float) -> None:
    """Compare the linearised factor with central differences along each variable."""
    linear = factor.linearize(values)
    matrix, _ = linear.jacobian()
    column, step = 0, 1e-5
    keys = factor.keys()
    for key in keys:
        width = dimension(values, key)
        for k in range(width):
            moved = []
            for sign in (1.0, -1.0):
                delta = gtsam.VectorValues()
                unit = np.zeros(width)
                unit[k] = sign * step
                delta.insert(key, unit)
                moved.append(factor.unwhitenedError(values.retract(delta)))
            numeric = (moved[0] - moved[1]) / (2 * step)
            assert_allclose(matrix[:, column] * scale, numeric, rtol=2e-3, atol=2e-5)
            column += 1


def dimension(values: gtsam.Values, key: int) -> int:
    if key == VECTOR_KEY:
        return len(values.atVector(key))
    return {"r": 3, "x": 6, "f": 3, "p": 3}[chr(gtsam.symbolChr(key))]


@pytest.mark.parametrize("principal", [False, True])
def test_factor_jacobians_match_finite_differences(principal):
    rng = np.random.default_rng(3)
    inertia = InertiaVariables(principal)
    values = gtsam.Values()
    values.insert(VECTOR_KEY, rng.uniform(0.1, 1.0, 7 if principal else 10))
    if principal:
        values.insert(AXES_KEY, gtsam.Rot3(exp_so3(rng.normal(size=3))))
    poses, forces, points = (
        [gtsam.symbol(c, k) for k in range(n)] for c, n in (("x", 3), ("f", 2), ("p", 2))
    )
    turn = exp_so3(rng.normal(size=3))
    for k, key in enumerate(poses):
        rotation = turn @ exp_so3(0.2 * k * rng.normal(size=3))
        values.insert(key, gtsam.Pose3(gtsam.Rot3(rotation), rng.normal(size=3)))
    for key in forces + points:
        values.insert(key, rng.normal(size=3))
    unit = gtsam.noiseModel.Unit.Create(6)
    time = np.array([0.0, 0.4, 0.9])
    check_jacobians(dynamics_factor(inertia, poses, forces, points, time, unit), values, 1.0)
    prior = np.array([1.0, 0.1, 0.0, 0.1, 1.0, 0.1, 1.2, 0.0, 0.1, 0.9])
    check_jacobians(prior_factor(inertia, prior, 4.0, corrected=False), values, 0.5)
    body = np.array([0.9, 0.1, -0.1, 0.05, 1.1, 0.2, 1.0, 0.1, -0.1, 1.3])
    values.update(VECTOR_KEY, body if not principal else principal_of_phi(body)[0])
    check_jacobians(prior_factor(inertia, prior, 4.0, corrected=True), values, 0.5)
    if principal:
        box = consistency_factor(np.full(3, 0.3), np.full(3, 0.4), 0.5)
        check_jacobians(box, values, 0.5)


def test_finite_differences_are_those_of_the_paper():
    """Angular velocities of both steps, the later one moved to the first frame by Eq. 10."""
    early, late, steps = np.array([0.3, -0.2, 0.5]), np.array([0.5, 0.1, 0.2]), (0.1, 0.2)
    first = exp_so3(np.array([0.1, 0.2, 0.3]))
    second = first @ exp_so3(early * steps[0])
    rotation = np.stack([first, second, second @ exp_so3(late * steps[1])])
    position = np.zeros((3, 3))
    found = differentiate(rotation, position, np.array([0.0, steps[0], sum(steps)]))
    assert_allclose(found.early, early, atol=1e-9)
    assert_allclose(found.late, late, atol=1e-9)
    turned = late + np.cross(early, late) * steps[1]
    assert_allclose(found.acceleration, (turned - early) / steps[1], atol=1e-9)
    assert_allclose(found.specific, first.T @ np.array([0.0, 0.0, 9.81]), atol=1e-9)


def test_corrected_prior_is_least_at_its_own_mean_and_the_printed_one_is_not():
    prior = np.array([1.0, 0.1, 0.0, 0.1, 1.0, 0.1, 1.2, 0.0, 0.1, 0.9])
    vector, axes = principal_of_phi(prior)
    for corrected in (True, False):
        costs = []
        for scale in (0.5, 1.0, 2.0):
            values = gtsam.Values()
            scaled = vector.copy()
            scaled[[0, 4, 5, 6]] *= scale
            values.insert(VECTOR_KEY, scaled)
            values.insert(AXES_KEY, gtsam.Rot3(axes))
            factor = prior_factor(InertiaVariables(principal=True), prior, 2.0, corrected)
            costs.append(factor.error(values))
        assert int(np.argmin(costs)) == (1 if corrected else 0)


def test_principal_parametrisation_is_inverted():
    rng = np.random.default_rng(1)
    half = rng.normal(size=(4, 4))
    body = half @ half.T
    phi = np.array([body[3, 3], *body[:3, 3], 2.0, 0.1, 2.2, -0.2, 0.3, 1.9])
    vector, axes = principal_of_phi(phi)
    assert_allclose(phi_of_principal(vector, axes)[0], phi, atol=1e-12)


def test_graph_methods_find_the_truth_on_exact_data(exact):
    truth = truth_of(exact)
    steps = TimeSteps.from_streams(exact.streams, 12)
    for method in METHODS[1:4]:
        estimate = estimate_as_published(steps, method)
        error = trace_error(truth.pseudo_inertia, pseudo_inertia(estimate.dynamic_parameters))
        assert estimate.converged and error < 0.2, method


def test_double_differences_of_noisy_poses_ruin_least_squares():
    """The mass comes out far too low and the body cannot exist, as in the paper's Table I."""
    noisy = generate(0, scenario=ScenarioOptions(duration=5.0))
    estimate = estimate_as_published(TimeSteps.from_streams(noisy.streams), "Baseline")
    assert estimate.dynamic_parameters[0] < 0.5 * noisy.scenario.body.mass
    assert not is_feasible(estimate.dynamic_parameters)
