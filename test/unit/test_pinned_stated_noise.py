"""Noise that samples show: along the axes of a turning sensor, and beside what is stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.inertia.residuals.contact_grid import contact_signals
from tactile_dynamics_ros.core.inertia.residuals.stated_noise import restate_noise
from tactile_dynamics_ros.core.numerics.noise import noise_along_axes, white_noise_std
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams

COUNT = 3000
ALONG = np.array([0.3, 0.02, 0.08])
"""N, along the axes of the sensor."""
STATED = 0.05
TIME = 0.01 * np.arange(COUNT)
TURNS = (
    Rotation.from_rotvec(np.outer(TIME, [0.9, -1.3, 0.5])) * Rotation.from_rotvec([0.3, 1.1, -0.6])
).as_matrix()


def wrist(along: np.ndarray = ALONG, carries_torque: bool = True) -> ContactStream:
    rng = np.random.default_rng(1)
    smooth = np.sin(2 * np.pi * np.outer(TIME, [0.7, 1.1, 0.4])) * [5.0, 3.0, 9.0]
    noise = along * rng.normal(size=(COUNT, 3))
    force = smooth + np.einsum("nij,nj->ni", TURNS, noise)
    turning = 0.1 * np.einsum("nij,nj->ni", TURNS, along * rng.normal(size=(COUNT, 3)))
    return ContactStream(
        "wrist", TIME, force, 0.1 * smooth + turning, np.full((COUNT, 3), STATED),
        TIME, np.zeros((COUNT, 3)), TURNS, carries_torque,
    )  # fmt: skip


def test_noise_is_found_along_the_axes_that_turn_with_the_sensor():
    own = wrist()
    assert noise_along_axes(own, own.force) == pytest.approx(ALONG, rel=0.1)
    assert noise_along_axes(own, own.torque) == pytest.approx(0.1 * ALONG, rel=0.1)


def test_white_noise_is_found_beneath_motion_at_uneven_stamps_on_average_over_draws():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(200):
        time = np.cumsum(rng.uniform(0.007, 0.013, 300))
        smooth = np.sin(9.0 * time)[:, None] * [30.0, 0.0, -7.0]
        found.append(white_noise_std(time, smooth + 0.2 * rng.normal(size=(300, 3))))
    assert np.mean(found) == pytest.approx(0.2, rel=0.02)


def restated(contact: ContactStream, pose: PoseStream | None = None) -> tuple[ContactStream, dict]:
    streams, ratios = restate_noise(Streams(pose, {"wrist": contact}))
    return streams.contacts["wrist"], ratios


def test_a_sensor_with_unlike_axes_is_read_along_them():
    found, ratios = restated(wrist())
    loudest = ALONG.max() / np.sqrt(np.mean(ALONG**2))
    assert ratios == {"wrist": pytest.approx(loudest, rel=0.1)}
    factor = contact_signals(found, TIME).signals["force"].noise_factor
    unturned = np.swapaxes(TURNS, 1, 2) @ factor
    expected = np.broadcast_to(np.diag(ALONG), unturned.shape)
    np.testing.assert_allclose(unturned, expected, rtol=0.1, atol=1e-9)


@pytest.mark.parametrize("scale", [3.0, 0.3])
def test_noise_that_is_stated_too_small_or_too_large_is_scaled_to_what_scatters(scale):
    even = np.full(3, scale * STATED)
    unlike = wrist(even, carries_torque=False)
    stated = STATED * np.array([1.0, 1.2, 0.9])
    found, ratios = restated(replace(unlike, force_std=np.tile(stated, (COUNT, 1))))
    median = np.sqrt(np.median(stated**2))
    assert ratios == {"wrist": pytest.approx(scale * STATED / median, rel=0.05)}
    np.testing.assert_allclose(found.force_std, ratios["wrist"] * np.tile(stated, (COUNT, 1)))


def test_noise_that_is_stated_well_stays_as_it_is():
    even = wrist(np.full(3, STATED), carries_torque=False)
    found, ratios = restated(even)
    assert ratios == {}
    assert found.force_std is even.force_std


@pytest.mark.parametrize(("scatter", "used"), [(2.0, True), (1.0, False), (0.4, False)])
def test_poses_that_scatter_more_than_they_state_lose_their_statement(scatter, used):
    rng = np.random.default_rng(3)
    noise = scatter * rng.normal(size=(COUNT, 6)) * ([2e-3] * 3 + [5e-4] * 3)
    turned = Rotation.from_rotvec(noise[:, :3]).as_matrix() @ TURNS
    stated = np.broadcast_to(np.diag([4e-6] * 3 + [25e-8] * 3), (COUNT, 6, 6))
    pose = PoseStream(TIME, np.sin(TIME)[:, None] + noise[:, 3:], turned, stated)
    even = wrist(np.full(3, STATED), carries_torque=False)
    streams, ratios = restate_noise(Streams(pose, {"wrist": even}))
    assert (streams.pose.covariance is None) is used
    assert ratios == ({"pose": pytest.approx(2.0, rel=0.1)} if used else {})
