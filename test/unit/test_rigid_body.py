"""Closed forms and finite differences for rotations, inertial parameters and Newton-Euler."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.rigid_body import inertial_parameters as ip
from tactile_dynamics_ros.core.rigid_body.newton_euler import inertia_map, regressor
from tactile_dynamics_ros.core.rigid_body.rotation import (
    exp_so3,
    log_so3,
    matrix_to_quaternion,
    quaternion_to_matrix,
    skew,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def random_body(rng: np.random.Generator) -> tuple[ip.InertialParameters, np.ndarray, np.ndarray]:
    """A body made of 30 point masses: parameters, points and masses."""
    points = rng.normal([0.03, -0.02, 0.01], 0.04, (30, 3))
    masses = rng.uniform(0.005, 0.02, 30)
    com = masses @ points / masses.sum()
    centred = points - com
    inertia = np.einsum("n,nij->ij", masses, -skew(centred) @ skew(centred))
    return ip.InertialParameters(masses.sum(), com, inertia), points, masses


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-7, np.pi])
def test_log_inverts_exp(rng, angle):
    axis = rng.normal(size=3)
    vector = angle * axis / np.linalg.norm(axis)
    assert_allclose(exp_so3(log_so3(exp_so3(vector))), exp_so3(vector), atol=1e-9)
    if angle < 3.1:
        assert_allclose(log_so3(exp_so3(vector)), vector, atol=1e-9)


def test_quaternion_round_trip_and_axis_convention(rng):
    vectors = rng.normal(size=(50, 3))
    rotations = exp_so3(vectors)
    assert_allclose(quaternion_to_matrix(matrix_to_quaternion(rotations)), rotations, atol=1e-12)
    quarter_turn_z = exp_so3(np.array([0.0, 0.0, np.pi / 2]))
    assert_allclose(quarter_turn_z @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


def test_regressor_equals_forces_on_point_masses(rng):
    body, points, masses = random_body(rng)
    s, w, dw = rng.normal(size=(3, 3))
    accelerations = s + np.cross(dw, points) + np.cross(w, np.cross(w, points))
    forces = masses[:, None] * accelerations
    expected = np.concatenate([np.cross(points, forces).sum(0), forces.sum(0)])
    wrench = regressor(s[None], w[None], dw[None])[0] @ body.dynamic_parameters
    assert_allclose(wrench, expected, rtol=1e-10)


def test_resting_body_is_pushed_up_by_its_weight():
    body = ip.InertialParameters(2.0, np.array([0.1, 0.0, 0.0]), np.eye(3) * 1e-3)
    resting = regressor(np.array([[0.0, 0.0, 9.81]]), np.zeros((1, 3)), np.zeros((1, 3)))[0]
    assert_allclose(resting @ body.dynamic_parameters, [0, -1.962, 0, 0, 0, 19.62], atol=1e-12)


def test_inertia_map_multiplies(rng):
    body, _, _ = random_body(rng)
    vector = rng.normal(size=3)
    product = inertia_map(vector) @ ip.inertia_vector(body.inertia_com)
    assert_allclose(product, body.inertia_com @ vector)


def test_parameter_conversions_round_trip(rng):
    body, points, masses = random_body(rng)
    phi = body.dynamic_parameters
    again = ip.InertialParameters.from_dynamic_parameters(phi)
    assert_allclose(again.com, body.com)
    assert_allclose(again.inertia_com, body.inertia_com, rtol=1e-10)
    homogeneous = np.concatenate([points, np.ones((30, 1))], axis=1)
    second_moments = np.einsum("n,ni,nj->ij", masses, homogeneous, homogeneous)
    assert_allclose(body.pseudo_inertia, second_moments, rtol=1e-10)
    assert_allclose(ip.dynamic_parameters_from_pseudo_inertia(second_moments), phi, rtol=1e-10)
    xi = ip.log_cholesky(second_moments)
    assert_allclose(ip.dynamic_parameters_from_log_cholesky(xi), phi, rtol=1e-9)


def test_every_log_cholesky_point_is_feasible(rng):
    for xi in rng.normal(size=(200, 10)):
        assert ip.is_feasible(ip.dynamic_parameters_from_log_cholesky(xi))


@pytest.mark.parametrize(
    ("function", "jacobian", "point"),
    [
        (ip.dynamic_parameters_from_log_cholesky, ip.log_cholesky_jacobian, "xi"),
        (
            lambda phi: np.concatenate(
                [
                    [phi[0]],
                    ip.InertialParameters.from_dynamic_parameters(phi).com,
                    ip.inertia_vector(
                        ip.InertialParameters.from_dynamic_parameters(phi).inertia_com
                    ),
                ]
            ),
            ip.com_inertia_jacobian,
            "phi",
        ),
    ],
)
def test_jacobians_match_finite_differences(rng, function, jacobian, point):
    xi = 0.3 * rng.normal(size=10)
    at = xi if point == "xi" else ip.dynamic_parameters_from_log_cholesky(xi)
    step = 1e-6
    numeric = np.array(
        [(function(at + step * e) - function(at - step * e)) / (2 * step) for e in np.eye(10)]
    ).T
    assert_allclose(jacobian(at), numeric, rtol=1e-5, atol=1e-8)


def test_distances(rng):
    body, _, _ = random_body(rng)
    truth = body.pseudo_inertia
    assert ip.affine_invariant_distance(truth, truth) == pytest.approx(0.0, abs=1e-9)
    assert ip.affine_invariant_distance(truth, 2 * truth) == pytest.approx(2 * np.log(2))
    assert ip.log_det_divergence(truth, truth) == pytest.approx(0.0, abs=1e-9)
    assert ip.trace_error(truth, np.zeros((4, 4))) == pytest.approx(4.0)
    assert ip.affine_invariant_distance(truth, truth - 2 * np.eye(4)) == np.inf
