"""What the batch fit says of its own uncertainty, and the bodies that it starts from."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.prior import (
    LogCholeskyPrior,
    contact_prior,
    nearest_body,
)
from tactile_dynamics_ros.core.inertia.batch.uncertainty import (
    misfit_inflation,
    unexcited_directions,
)
from tactile_dynamics_ros.core.inertia.residuals.systematic import PresumedErrors
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    dynamic_parameters_from_pseudo_inertia,
    log_cholesky_jacobian,
    pseudo_inertia,
)

DRAWS = 200
XI = np.array([-0.4, -3.0, -2.8, -3.1, 0.01, -0.02, 0.005, 0.02, -0.01, 0.03])
STD = np.array([2.0, 1.5, 1.5, 1.5, 0.1, 0.1, 0.1, 0.5, 0.5, 0.5])
GAIN_STD = 0.5
"""Of a gain before the data."""
FINGERS = ("index", "middle", "thumb")


def samples(points: np.ndarray, force: np.ndarray, held: np.ndarray) -> WrenchSamples:
    """Contacts (N, C) of a body at rest."""
    count, none = len(points), np.zeros((len(points), 3))
    turns = np.broadcast_to(np.eye(3), (count, *points.shape[1:2], 3, 3))
    return WrenchSamples(
        np.arange(count), none, turns[:, 0], none, none, none, none, FINGERS[: points.shape[1]],
        points, turns, force, 0.0 * force, held, np.array([0.0, 0.0, -9.81]),
    )  # fmt: skip


def fitted(
    rng: np.random.Generator,
    rows: np.ndarray,
    noise: np.ndarray,
    theta: np.ndarray | None = None,
    unexcited: np.ndarray | None = None,
) -> FittedModel:
    """A fit of which the white Jacobian (M, 10 + k) and its noise are given."""
    held = np.ones((4, 3), dtype=bool)
    seen = samples(rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 3, 3)), held)
    model = FittedModel(
        stretches=(SimpleNamespace(problem=SimpleNamespace(samples=seen)),),
        xi=XI,
        effects=() if theta is None else (create_effect("force_scale"),),
        theta=() if theta is None else (theta,),
        prior=LogCholeskyPrior(XI, STD),
        unexcited=np.zeros((10, 0)) if unexcited is None else unexcited,
        converged=True,
        corrected=PresumedErrors(np.zeros(9), np.zeros(9), np.zeros((rows.shape[1],) * 2)),
    )
    white = rng.normal(size=len(rows))
    vars(model).update(white_jacobian=rows, noise_information=noise, white_residual=white)
    return model


def jacobian(rng: np.random.Generator, count: int, effects: int = 0) -> np.ndarray:
    by_phi = np.linalg.inv(log_cholesky_jacobian(XI))
    rows = rng.normal(size=(count, 10)) * np.geomspace(10.0, 300.0, 10) @ by_phi
    return np.concatenate([rows, 40.0 * rng.normal(size=(count, effects))], axis=1)


@pytest.mark.parametrize("held", [0, 2])
def test_noise_of_the_regressors_adds_scatter_and_takes_information(held):
    """Fuller 1987, Eq. 3.1.12, with directions that are held left to the prior."""
    rng = np.random.default_rng(held)
    rows = jacobian(rng, 600)
    noise = 0.64 * rows[:200].T @ rows[:200]
    unexcited = np.linalg.qr(rng.normal(size=(10, max(held, 1))))[0][:, :held]
    model = fitted(rng, rows, noise, unexcited=unexcited)
    by_z, excited = log_cholesky_jacobian(XI) * STD, np.eye(10) - unexcited @ unexcited.T
    seen = excited @ by_z.T @ rows.T @ rows @ by_z @ excited
    bread = np.linalg.inv(seen - excited @ by_z.T @ noise @ by_z @ excited + np.eye(10))
    widen = misfit_inflation(model.white_residual, rows)
    unit = np.linalg.inv(by_z)
    found = unit @ (model.covariance / np.outer(widen, widen)) @ unit.T
    expected = bread @ (seen + np.eye(10)) @ bread
    assert np.max(np.linalg.eigvals(bread @ (seen + np.eye(10))).real) > 1.1  # it matters
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.min(np.diag(expected)))


def test_a_gain_that_all_fingers_may_share_widens_the_body_by_its_share():
    rng = np.random.default_rng(3)
    rows = jacobian(rng, 600, 3)
    model = fitted(rng, rows, np.zeros((13, 13)), 1e-3 * rng.normal(size=3))
    by_all = np.eye(13)
    by_all[:10, :10] = log_cholesky_jacobian(XI)
    prior = np.diag(np.concatenate([STD, 3 * [GAIN_STD]]) ** -2)
    inverse = by_all @ np.linalg.inv(by_all.T @ rows.T @ rows @ by_all + prior) @ by_all.T
    widen = misfit_inflation(model.white_residual, rows)
    expected = inverse * np.outer(widen, widen)
    phi = dynamic_parameters_from_log_cholesky(XI)
    expected[:10, :10] += GAIN_STD**2 / 3 * np.outer(phi, phi)
    tolerance = 1e-9 * expected.max()
    np.testing.assert_allclose(model.covariance, expected, rtol=1e-6, atol=tolerance)


def test_a_gain_of_some_fingers_is_seen_against_the_others():
    rng = np.random.default_rng(4)
    held = np.ones((4, 3), dtype=bool)
    seen = samples(rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 3, 3)), held)
    every, some = create_effect("force_scale"), create_effect("force_scale:index+thumb")
    std = np.array([0.01, 0.02, 0.01])
    shared = GAIN_STD / np.sqrt(3)
    assert every.unseen_gain(seen, 10.0 * std, std) == pytest.approx(shared)
    assert some.unseen_gain(seen, 3.0 * std[:2], std[:2]) == pytest.approx(shared)
    assert some.unseen_gain(seen, np.array([0.0, -0.1]), std[:2]) == 0.0
    both = some.unseen_gain(seen, np.array([0.1, 0.1]), std[:2])  # or are the others 10 % low?
    gains = [0.1, 0.1, *np.zeros(len(seen.contact_names) - 2)]
    assert both == pytest.approx(np.std(gains, ddof=1) / np.sqrt(len(gains)))


SIZE = 300
"""Rows of a block, 0.5 s of six channels at 100 Hz."""


def test_white_residuals_widen_nothing():
    rng = np.random.default_rng(5)
    found = []
    for _ in range(DRAWS):
        rows = rng.normal(size=(6000, 4)) * [1.0, 30.0, 0.01, 1.0]
        found.append(misfit_inflation(rng.normal(size=6000), rows))
    assert np.mean(found) < 1.02  # twice the variance has a chance of 0.5 %, for 20 blocks
    assert np.min(found) >= 1.0


def test_residuals_that_stay_alike_widen_by_their_sums_over_blocks():
    """Influence of a column of ones is the block's sum over N; white noise scatters by 1 / N."""
    rng = np.random.default_rng(6)
    blocks = rng.normal(size=20)
    rows = np.stack([np.ones(6000), np.tile([1.0, -1.0], 3000)], axis=1) * [3.0, 0.2]
    found = misfit_inflation(np.repeat(blocks, SIZE), rows)
    assert found[0] == pytest.approx(np.sqrt(SIZE * np.mean(blocks**2)))
    assert found[1] == pytest.approx(max(1.0, np.sqrt(np.mean(blocks**2))))


def test_residuals_that_are_larger_widen_at_least_by_their_size():
    rng = np.random.default_rng(7)
    white = 2.5 * rng.normal(size=6000)
    found = misfit_inflation(white, rng.normal(size=(6000, 5)) * 10.0 ** np.arange(5))
    assert np.all(found >= np.sqrt(np.mean(white**2)) * (1.0 - 1e-9))
    assert np.median(found) < 4.0


def body(values: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return dynamic_parameters_from_pseudo_inertia((vectors * values) @ vectors.T)


def test_nearest_body_raises_each_eigenvalue_to_a_tenth_of_the_usual_one_in_its_place():
    rng = np.random.default_rng(8)
    usual = np.array([4e-4, 7e-4, 1e-3, 0.5])
    vectors, others = (np.linalg.qr(rng.normal(size=(4, 4)))[0] for _ in range(2))
    reference = body(usual, others)
    for values in (
        [-3e-4, 2e-5, 5e-3, 0.8],
        [1e-5, 6.9e-5, 1.01e-4, 0.04],
        [-2.0, -1.0, -0.5, 0.1],
    ):
        raised = np.maximum(np.array(values), 0.1 * usual)
        found = dynamic_parameters_from_log_cholesky(nearest_body(body(values, vectors), reference))
        expected = (vectors * raised) @ vectors.T
        np.testing.assert_allclose(pseudo_inertia(found), expected, atol=1e-12)


def test_a_body_that_can_exist_is_its_own_nearest_body():
    phi = dynamic_parameters_from_log_cholesky(XI)
    np.testing.assert_allclose(nearest_body(phi, phi), XI, atol=1e-9)


def test_prior_weighs_what_is_carried_and_spreads_like_the_contacts():
    rng = np.random.default_rng(9)
    points = np.array([0.1, -0.2, 0.3]) + rng.normal(size=(50, 3, 3)) * [0.02, 0.05, 0.08]
    force = np.zeros((50, 3, 3))
    force[..., 2] = 9.81 * np.array([0.5, 0.3, 0.4])
    held = np.ones((50, 3), dtype=bool)
    held[:, 1] = rng.uniform(size=50) < 0.5
    force *= held[..., None]
    prior = contact_prior(samples(points, force, held))
    touching = points[held]
    centre = touching.mean(axis=0)
    radius = np.sqrt(np.mean((touching - centre) ** 2))
    mass = np.median(np.where(held[:, 1], 1.2, 0.9))
    mean = [0.5 * np.log(mass), *3 * [np.log(radius)], 0.0, 0.0, 0.0, *centre]
    np.testing.assert_allclose(prior.mean, mean, rtol=1e-9)
    std = [2.0, *3 * [1.5], *3 * [2.0 * radius], *3 * [0.5]]
    np.testing.assert_allclose(prior.std, std)


def test_misfit_makes_the_prior_as_many_times_stiffer():
    prior = LogCholeskyPrior(XI, STD)
    np.testing.assert_allclose(prior.information, np.diag(STD**-2))
    np.testing.assert_allclose(prior.weighted(3.0).information, 9.0 * prior.information)


def test_directions_are_held_where_information_is_hardly_more_than_noise():
    """Ratios of all information to that of noise plus one are 1.4 and 1.6 along two directions."""
    rng = np.random.default_rng(10)
    directions = np.linalg.qr(rng.normal(size=(10, 10)))[0]
    noise = np.geomspace(1e2, 1e-2, 10)
    ratio = np.array([1.4, 1.6, 30.0, 5.0, 1.45, 9.0, 80.0, 2.0, 1e4, 3.0])
    unit = np.linalg.inv(log_cholesky_jacobian(XI) * STD)

    def on_phi(values: np.ndarray) -> np.ndarray:
        return unit.T @ (directions * values) @ directions.T @ unit

    given = on_phi(ratio * (noise + 1.0)), on_phi(noise), LogCholeskyPrior(XI, STD)
    for scatter, expected in ((0.0, [0, 4]), (0.2, [0, 1, 4]), (1.0, [0, 1, 4, 7])):
        found = unexcited_directions(*given, scatter)
        own = directions[:, expected]
        np.testing.assert_allclose(found @ found.T, own @ own.T, atol=1e-6)


def test_intervals_of_a_flat_body_are_those_of_one_that_is_not():
    """A second moment of nothing hardly moves with its logarithm; its interval is linear in phi."""
    prior = LogCholeskyPrior(XI, np.ones(10))
    flat = XI.copy()
    flat[1] -= 12.0
    phi = dynamic_parameters_from_log_cholesky(flat)
    thin, open_ = (log_cholesky_jacobian(xi) for xi in (flat, prior.opened(phi)))
    assert np.linalg.svd(thin)[1][-1] < 1e-6 * np.linalg.svd(open_)[1][-1]
    np.testing.assert_allclose(prior.opened(dynamic_parameters_from_log_cholesky(XI)), XI)
