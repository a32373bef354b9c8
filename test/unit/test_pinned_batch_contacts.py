"""Noise of contacts in the batch fit: axes, arms, points, what sensors state, and the grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.inertia.residuals.contact_grid import contact_signals
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import WrenchProblem
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

PHI = np.array([0.6, 0.012, -0.008, 0.02, 2.1e-3, 1e-4, 1.7e-3, -2e-4, 3e-4, 1.2e-3])
POINTS = np.array([[0.05, 0.01, 0.0], [-0.04, 0.03, 0.02], [-0.01, -0.05, -0.01]])
FORCE_STD = np.array([[0.01, 0.03, 0.15], [0.12, 0.02, 0.04], [0.03, 0.1, 0.01]])
"""N by finger and world axis."""
POINT_STD = 2e-3
POSE_STD = np.array([2e-3, 5e-4, 1e-3, 1e-4, 4e-4, 2e-4])
STEP = 1e-4
NAMES = ("index", "middle", "thumb")


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def motion(time: np.ndarray) -> tuple[np.ndarray, Rotation]:
    waves = np.sin(2 * np.pi * np.outer(time, [0.6, 0.9, 1.1, 0.7, 1.2, 0.8]) + np.arange(6))
    turn = Rotation.from_euler("zyx", [0.7, -0.9, 0.5]) * Rotation.from_rotvec(0.4 * waves[:, 3:])
    return 0.04 * waves[:, :3] + [0.5, 0.0, 0.4], turn


def truth(seconds: float) -> tuple[np.ndarray, np.ndarray, Rotation, np.ndarray, np.ndarray]:
    """Times, positions, rotations, and forces and points (N, 3 fingers, 3) in the world."""
    time = np.arange(round(100 * seconds)) / 100
    place, turn = motion(time)
    before, after = motion(time - STEP), motion(time + STEP)
    acceleration = (before[0] - 2 * place + after[0]) / STEP**2
    last, next_ = (
        (a.inv() * b).as_rotvec() / STEP for a, b in ((before[1], turn), (turn, after[1]))
    )
    specific_force = turn.inv().apply(acceleration + [0.0, 0.0, 9.81])
    wrench = regressor(specific_force, 0.5 * (last + next_), (next_ - last) / STEP) @ PHI
    grasp = np.concatenate([np.concatenate([skew(p), np.eye(3)]) for p in POINTS], axis=1)
    squeeze = np.array([[-3.0, 0.5, 1.0], [2.0, -1.0, 0.0], [0.5, 2.0, -1.0]]).ravel()
    force = squeeze + (wrench - squeeze @ grasp.T) @ np.linalg.pinv(grasp).T
    force = np.stack([turn.apply(f) for f in force.reshape(-1, 3, 3).swapaxes(0, 1)], axis=1)
    point = np.stack([place + turn.apply(p) for p in POINTS], axis=1)
    return time, place, turn, force, point


def measure(rng: np.random.Generator, seconds: float = 2.0, stated: bool = True) -> Streams:
    """A recording with unlike noise along all axes and contact points that scatter."""
    time, place, turn, force, point = truth(seconds)
    white = rng.normal(size=(len(time), 6)) * POSE_STD
    turned = Rotation.from_rotvec(white[:, :3]) * turn
    covariance = np.broadcast_to(np.diag(POSE_STD**2), (len(time), 6, 6))
    pose = PoseStream(time, place + white[:, 3:], turned.as_matrix(), covariance, white=True)
    force = force + FORCE_STD * rng.normal(size=force.shape)
    point = point + POINT_STD * rng.normal(size=point.shape)
    frames = np.broadcast_to(np.eye(3), (len(time), 3, 3))
    contacts = {
        name: ContactStream(
            name, time, force[:, k], np.zeros_like(place),
            np.tile(FORCE_STD[k], (len(time), 1)) if stated else None, time, point[:, k], frames,
        )
        for k, name in enumerate(NAMES)
    }  # fmt: skip
    return Streams(pose, contacts)


@pytest.fixture(scope="module")
def problem() -> WrenchProblem:
    return WrenchProblem.from_streams(measure(np.random.default_rng(1)))


def share(problem: WrenchProblem, name: str) -> np.ndarray:
    """Covariance (N, 6, 6) of each residual from one signal."""
    linearisation = problem.linearise(PHI)
    matrix = linearisation.sensitivities[linearisation.names.index(name)].matrix()
    whole = (matrix @ matrix.T).toarray()
    return np.stack([whole[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(problem.count)])


@pytest.mark.parametrize("finger", range(3))
def test_stated_noise_of_a_force_is_turned_into_the_body_with_its_arm(problem, finger):
    samples = problem.samples
    found = share(problem, f"force:{NAMES[finger]}")
    for k in range(0, problem.count, 17):
        to_body = samples.rotation[k].T
        grasp = np.concatenate([skew(samples.contact_point[k, finger]), np.eye(3)]) @ to_body
        expected = (grasp * FORCE_STD[finger] ** 2) @ grasp.T
        np.testing.assert_allclose(found[k], expected, atol=1e-9)


@pytest.mark.parametrize("finger", range(3))
def test_noise_of_a_point_moves_the_torque_across_the_force(problem, finger):
    found = share(problem, f"point:{NAMES[finger]}")
    std = problem.contacts[finger].signals["point"].noise_factor[0, 0, 0]
    assert std == pytest.approx(POINT_STD, rel=0.2)
    for k in range(0, problem.count, 17):
        force = problem.samples.contact_force[k, finger]
        expected = std**2 * (force @ force * np.eye(3) - np.outer(force, force))
        np.testing.assert_allclose(found[k, :3, :3], expected, atol=1e-12)
        assert not found[k, 3:].any()


@pytest.fixture(scope="module")
def exact() -> WrenchProblem:
    """Of a recording without noise that states some."""
    time, place, turn, force, point = truth(1.5)
    covariance = np.broadcast_to(np.diag(POSE_STD**2), (len(time), 6, 6))
    pose = PoseStream(time, place, turn.as_matrix(), covariance)
    frames = np.broadcast_to(np.eye(3), (len(time), 3, 3))
    contacts = {
        name: ContactStream(
            name, time, force[:, k], np.zeros_like(place), np.tile(FORCE_STD[k], (len(time), 1)),
            time, point[:, k], frames,
        )
        for k, name in enumerate(NAMES)
    }  # fmt: skip
    return WrenchProblem.from_streams(Streams(pose, contacts))


@pytest.mark.parametrize("name", ["orientation", "position", "force:middle"])
def test_residuals_move_with_each_sample_as_the_whitening_says(exact, name):
    """By differences: one sample of the measured signals is moved, the windows read it."""
    linearisation = exact.linearise(PHI)
    at = linearisation.names.index(name)
    moves, factor = linearisation.sensitivities[at].matrix().toarray(), linearisation.factors[at]
    start = exact.residual(PHI)
    for sample in (60, 75, 91):
        for axis in range(3):
            step = np.zeros((len(factor), 3))
            step[sample] = 1e-2 * factor[sample, :, axis]
            there, back = (
                replace(exact, raw=exact.raw.corrected({name: sign * step})).residual(PHI)
                for sign in (1.0, -1.0)
            )
            found = moves[:, 3 * sample + axis].reshape(start.shape)
            expected = (there - back) / 2e-2
            assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()


def test_noise_that_is_not_stated_is_what_the_samples_show():
    streams = measure(np.random.default_rng(2), 6.0, stated=False)
    for name, own in zip(NAMES, FORCE_STD, strict=True):
        factor = contact_signals(streams.contacts[name], streams.pose.time).signals["force"]
        size = np.median(np.abs(own * np.random.default_rng(3).normal(size=(4000, 3)))) / 0.6745
        expected = np.broadcast_to(size * np.eye(3), factor.noise_factor.shape)
        np.testing.assert_allclose(factor.noise_factor, expected, rtol=0.15)


def test_torques_that_were_computed_do_not_get_all_the_weight():
    time = np.arange(0.0, 4.0, 0.01)
    turn = np.broadcast_to(np.eye(3), (len(time), 3, 3))
    load = np.stack([np.sin(1.3 * time), np.cos(0.7 * time), np.ones_like(time)], axis=1)
    stream = ContactStream(
        "wrist", time, load, 0.05 * load, None, time, np.zeros((len(time), 3)), turn,
        carries_torque=True,
    )  # fmt: skip
    signals = contact_signals(stream, time).signals
    np.testing.assert_allclose(signals["force"].noise_factor[9], 0.03 * np.eye(3))
    np.testing.assert_allclose(signals["torque"].noise_factor[9], 1e-3 * np.eye(3))


def test_residuals_of_the_true_body_are_white_along_every_axis():
    """Of 12 recordings with unlike noise of forces, poses and points."""
    rng = np.random.default_rng(4)
    squares, sums = [], []
    for _ in range(12):
        problem = WrenchProblem.from_streams(measure(rng, 1.5))
        white = problem.linearise(PHI).whiten(problem.residual(PHI)).reshape(-1, 6)
        squares.append(np.mean(white**2, axis=0))
        sums.append(white.sum(axis=0) / np.sqrt(len(white)))
    assert np.mean(squares, axis=0) == pytest.approx(np.ones(6), abs=0.1)
    assert 0.7 < np.mean(np.square(sums)) < 1.4


def quartic(time: np.ndarray) -> np.ndarray:
    return np.array([1.0, -2.0, 3.0]) * (1.0 + 1e3 * (np.asarray(time)[..., None] - 0.1) ** 4)


def test_grid_reads_the_cubic_of_two_samples_before_and_two_after():
    rng = np.random.default_rng(5)
    time = 0.01 * np.arange(40) + 1e-3 * rng.uniform(-1, 1, 40)
    frames, force = np.broadcast_to(np.eye(3), (40, 3, 3)), quartic(time)
    std = np.full((40, 3), 0.03)
    stream = ContactStream("a", time, force, 0.0 * force, std, time, force, frames)
    grid = 0.01 * np.arange(5, 34) + 0.004
    found, _, point = contact_signals(stream, grid).evaluate()
    for k, at in enumerate(grid):
        left = np.searchsorted(time, at) - 1
        nodes = time[left - 1 : left + 3]
        cubic = np.polynomial.Polynomial.fit(nodes, quartic(nodes)[:, 0], 3)(at)
        assert found[k, 0] == pytest.approx(cubic, rel=1e-12)
        assert point[k, 2] == pytest.approx(3.0 * cubic, rel=1e-9)
