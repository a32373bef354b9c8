"""What the live estimator says of its own uncertainty: the sandwich, its inflation, the misfit."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.inertia.batch.prior import LogCholeskyPrior
from tactile_dynamics_ros.core.inertia.live import IncrementalInertialEstimator
from tactile_dynamics_ros.core.inertia.live.accumulation import Accumulation
from tactile_dynamics_ros.core.inertia.live.information import BlockScores, SquareRootInformation
from tactile_dynamics_ros.core.inertia.live.solver import DivergencePrior, SummarySolver
from tactile_dynamics_ros.core.inertia.live.summary import Summariser
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import log_cholesky_jacobian
from tactile_dynamics_ros.core.streams.streams import ContactSample, places_at
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

DRAWS = 200
XI = np.array([-0.4, -3.0, -2.8, -3.1, 0.01, -0.02, 0.005, 0.02, -0.01, 0.03])
STD = np.array([2.0, 1.5, 1.5, 1.5, 0.1, 0.1, 0.1, 0.5, 0.5, 0.5])


def accumulation(
    rows: np.ndarray, noise: np.ndarray, unexcited: np.ndarray
) -> tuple[Accumulation, np.ndarray]:
    """What has seen white rows (n, 10), and the information of its prior on xi."""
    model = Accumulation.__new__(Accumulation)
    model.solver = SummarySolver(DivergencePrior(XI, 0.02))
    model.information = SquareRootInformation(10)
    model.information.add(rows, np.zeros(len(rows)))
    model.noise_information = noise
    model._unexcited, model._prior, model._known = unexcited, LogCholeskyPrior(XI, STD), None
    opened = model._prior.opened(model.phi)
    return model, model.solver.prior_information(opened)


@pytest.mark.parametrize("held", [0, 1, 3])
def test_noise_of_the_regressors_adds_scatter_and_takes_information(held):
    """Fuller 1987, Eq. 3.1.12, with directions that are held left to the prior."""
    rng = np.random.default_rng(held)
    by_phi = np.linalg.inv(log_cholesky_jacobian(XI))
    rows = rng.normal(size=(400, 10)) * np.geomspace(10.0, 300.0, 10) @ by_phi
    feigned = 0.8 * rows[:150]
    noise = feigned.T @ feigned
    unexcited = np.linalg.qr(rng.normal(size=(10, max(held, 1))))[0][:, :held]
    model, prior = accumulation(rows, noise, unexcited)
    by_z, excited = log_cholesky_jacobian(XI) * STD, np.eye(10) - unexcited @ unexcited.T
    own = prior * np.outer(STD, STD)
    seen = excited @ by_z.T @ rows.T @ rows @ by_z @ excited
    feigned_z = excited @ by_z.T @ noise @ by_z @ excited
    bread = np.linalg.inv(seen - feigned_z + own)
    expected = by_z @ bread @ (seen + own) @ bread @ by_z.T
    assert np.max(np.linalg.eigvals(bread @ (seen + own)).real) > 1.1  # what is tested matters
    unit = np.linalg.inv(by_z)
    found, expected = (unit @ values @ unit.T for values in (model.covariance, expected))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.min(np.diag(expected)))


def test_without_noise_of_the_regressors_it_is_the_inverse_of_the_information():
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(400, 10)) * 10.0 ** rng.uniform(-1, 2, 10)
    model, prior = accumulation(rows, np.zeros((10, 10)), np.zeros((10, 0)))
    mapping = log_cholesky_jacobian(XI)
    inverse = np.linalg.inv(mapping.T @ rows.T @ rows @ mapping + prior)
    expected = mapping @ inverse @ mapping.T
    np.testing.assert_allclose(model.covariance, expected, rtol=1e-6, atol=1e-9 * expected.max())


AXES = np.array([[2.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.1], [1.0, 1.0, 0.0]])


def inflation(residuals: np.ndarray, jacobians: np.ndarray, length: int = 5) -> np.ndarray:
    """Factors of variances of the least-squares fit to residuals (n, m), J (n, m, 3)."""
    scores = BlockScores(3, length)
    for jacobian, residual in zip(jacobians, residuals, strict=True):
        scores.add(jacobian, residual)
    inverse = np.linalg.inv(np.einsum("nmi,nmj->ij", jacobians, jacobians))
    state = inverse @ np.einsum("nmi,nm->i", jacobians, residuals)
    return scores.inflation(state, inverse)


def test_white_residuals_widen_nothing():
    rng = np.random.default_rng(1)
    found = []
    for _ in range(DRAWS):
        jacobians = AXES * (1.0 + 0.3 * rng.normal(size=(200, 1, 3)))
        found.append(inflation(rng.normal(size=(200, 4)), jacobians))
    wider = np.any(np.array(found) > 1.0, axis=1)
    assert wider.mean() < 0.09  # at most 1 % for each of three parameters and three lengths


def test_residuals_that_stay_alike_widen_by_their_number():
    """Ten samples alike: the variance of a mean is ten times that of white noise."""
    rng = np.random.default_rng(2)
    jacobians = np.broadcast_to(AXES, (400, *AXES.shape))
    found = []
    for _ in range(40):
        alike = np.repeat(rng.normal(size=(40, 4)), 10, axis=0)
        found.append(inflation(alike, jacobians))
    assert np.all(np.mean(found, axis=0) > 8.0)
    assert np.all(np.mean(found, axis=0) < 16.0)  # the largest of five lengths, of few blocks


def test_residuals_that_are_larger_widen_by_their_size():
    rng = np.random.default_rng(3)
    jacobians = np.broadcast_to(AXES, (400, *AXES.shape))
    found = [inflation(3.0 * rng.normal(size=(400, 4)), jacobians) for _ in range(40)]
    assert np.all(np.abs(np.mean(found, axis=0) - 9.0) < 5.0)
    assert np.all(np.min(found, axis=0) > 4.0)


def test_blocks_merged_in_pairs_are_blocks_of_twice_the_length():
    rng = np.random.default_rng(4)
    count = 2 * 128 * 3 + 1
    jacobians = AXES * (1.0 + rng.normal(size=(count, 1, 3)))
    residuals = np.repeat(rng.normal(size=(count // 8 + 1, 4)), 8, axis=0)[:count]
    short, long = (inflation(residuals, jacobians, length) for length in (3, 6))
    assert np.all(long > 1.5)
    np.testing.assert_allclose(short, long)


@pytest.fixture(scope="module")
def model() -> Accumulation:
    estimator = IncrementalInertialEstimator()
    streams = generate(3, scenario=ScenarioOptions(duration=3.0)).streams
    for name, own in streams.contacts.items():
        points, turns = places_at(own.pose_time, own.position, own.rotation, own.time)
        rows = own.time, [name] * len(points), points, turns, own.force, own.torque, own.force_std
        for row in zip(*rows, strict=True):
            estimator.add_contact(ContactSample(*row))
    pose = np.tile(np.eye(4), (len(streams.pose.time), 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = streams.pose.rotation, streams.pose.position
    for row in zip(streams.pose.time, pose, streams.pose.covariance, strict=True):
        estimator.add_pose(*row)
    estimator.update()
    return estimator._model


def summarise(model: Accumulation, monkeypatch, rms: float, scatter: float) -> np.ndarray:
    presumed = model.presume_lasting_errors()
    with monkeypatch.context() as patch:
        patch.setattr(Accumulation, "presume_lasting_errors", lambda _: presumed)
        patch.setattr(SquareRootInformation, "whitened_rms", property(lambda _: rms))
        patch.setattr(BlockScores, "inflation", lambda *_: np.full(10, scatter))
        return Summariser().summarise(model, 0.0).covariance


@pytest.mark.parametrize(
    ("rms", "factor"), [(0.9, 1.0), (1.15, 1.15**2), (1.35, 5.0 * 1.35**2), (2.0, 9.0 * 2.0**2)]
)
def test_published_covariance_grows_with_scatter_and_misfit(model, monkeypatch, rms, factor):
    plain = summarise(model, monkeypatch, 1.0, 1.0)
    lasting = plain - model.covariance
    wider = summarise(model, monkeypatch, rms, 7.0)
    tolerance = 1e-9 * np.max(np.abs(wider))
    np.testing.assert_allclose(wider - lasting, 7.0 * factor * model.covariance, atol=tolerance)


def test_published_scatter_is_that_of_the_scores_at_the_estimate(model, monkeypatch):
    seen = []
    with monkeypatch.context() as patch:
        patch.setattr(BlockScores, "inflation", lambda *given: seen.append(given) or np.ones(10))
        Summariser().summarise(model, 0.0)
    [(scores, state, inverse)] = seen
    assert scores is model.scores
    np.testing.assert_array_equal(state, model.phi)
    np.testing.assert_array_equal(inverse, model.covariance)
