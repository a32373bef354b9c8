"""Noise of live contacts: axes, arms, points, what sensors state, and readings between samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.inertia.live.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.live.contact_queue import ContactQueue, ContactReading
from tactile_dynamics_ros.core.inertia.live.residuals import ContactRows, contact_covariance
from tactile_dynamics_ros.core.inertia.live.sample_stream import PoseNoise, SampleStream


def contacts(rng: np.random.Generator, count: int) -> tuple[WrenchSamples, ContactRows]:
    """Three contacts of a turned body at some instants, the second absent at the first."""
    turn = Rotation.random(count, random_state=3).as_matrix()
    position, point = rng.normal(size=(count, 3)), rng.normal(size=(count, 3, 3))
    held = np.ones((count, 3), dtype=bool)
    held[0, 1] = False
    force = 3.0 * rng.normal(size=(count, 3, 3)) * held[..., None]
    torque = np.zeros((count, 3, 3))
    torque[:, 2] = rng.normal(size=(count, 3))
    rows = ContactRows(
        names=("a", "b", "c"),
        point=position[:, None] + point,
        rotation=np.broadcast_to(np.eye(3), (count, 3, 3, 3)),
        force=force,
        torque=torque,
        std=10.0 ** rng.uniform(-2.5, 0.0, (count, 3, 3)),
        in_contact=held,
        torque_std=np.array([0.0, 0.0, 0.2]),
        point_std=np.array([0.02, 0.05, 0.0]),
    )
    none = np.zeros((count, 3))
    to_body = np.swapaxes(turn, 1, 2)[:, None]
    arms, forces, torques = ((to_body @ v[..., None])[..., 0] for v in (point, force, torque))
    samples = WrenchSamples(
        np.arange(count), position, turn, none, none, none, none, rows.names,
        arms * held[..., None], to_body @ rows.rotation, forces, torques, held, none[0],
    )  # fmt: skip
    return samples, rows


def wrench(samples: WrenchSamples, rows: ContactRows, k: int, readings: np.ndarray) -> np.ndarray:
    """Body wrench (6,) [torque, force] of [force, point, torque] (3, 3, 3) in the world."""
    total = np.zeros((2, 3))
    for held, force, point, torque in zip(rows.in_contact[k], *readings, strict=True):
        total += held * np.array([np.cross(point - samples.position[k], force) + torque, force])
    return (total @ samples.rotation[k]).ravel()


@pytest.mark.parametrize("k", [0, 1])
def test_covariance_is_that_of_unlike_noise_of_forces_points_and_torques(k):
    """J S J^T with J by differences of the wrench, absent contacts without noise."""
    samples, rows = contacts(np.random.default_rng(1), 2)
    readings = np.stack([rows.force[k], rows.point[k], rows.torque[k]])
    stds = np.stack(
        [rows.std[k], *(np.outer(s, np.ones(3)) for s in (rows.point_std, rows.torque_std))]
    )
    expected = np.zeros((6, 6))
    for place in np.ndindex(readings.shape):
        step = np.zeros_like(readings)
        step[place] = 1.0
        change = wrench(samples, rows, k, readings + step) - wrench(samples, rows, k, readings)
        expected += stds[place] ** 2 * np.outer(change, change)
    found = contact_covariance(samples, rows)[k]
    np.testing.assert_allclose(found, expected, atol=1e-9 * expected.max())


def test_force_noise_along_one_world_axis_stays_along_it():
    rng = np.random.default_rng(2)
    samples, rows = contacts(rng, 2)
    std = np.zeros_like(rows.std)
    std[:, 0, 2] = 0.3
    rows = replace(rows, std=std, point_std=np.zeros(3), torque_std=np.zeros(3))
    found = contact_covariance(samples, rows)
    axis = samples.rotation[:, 2]
    expected = 0.09 * axis[:, :, None] * axis[:, None]
    np.testing.assert_allclose(found[:, 3:, 3:], expected, atol=1e-12)


def test_noise_of_a_point_is_felt_across_the_force_only():
    rng = np.random.default_rng(3)
    samples, rows = contacts(rng, 2)
    rows = replace(rows, std=0.0 * rows.std, torque_std=np.zeros(3))
    found = contact_covariance(samples, rows)
    expected = np.zeros((2, 3, 3))
    for k in range(2):
        for c, std in enumerate(rows.point_std):
            force = samples.contact_force[k, c]
            expected[k] += std**2 * (force @ force * np.eye(3) - np.outer(force, force))
    np.testing.assert_allclose(found[:, :3, :3], expected, atol=1e-12)
    assert not found[:, 3:].any()
    assert not found[:, :3, 3:].any()


STATED = np.array([0.02, 0.3, 0.07])


def stream(std: np.ndarray, seconds: float = 3.0) -> SampleStream:
    """A finger that scatters by 0.05 N along all axes and a point that scatters by 2 mm."""
    rng, own = np.random.default_rng(4), SampleStream(IncrementalConfig())
    for k in range(round(100 * seconds)):
        time = 0.01 * k
        force = np.array([1.0, -2.0, 3.0]) + 0.05 * rng.normal(size=3)
        point = np.array([0.1, 0.2, 0.3]) + 2e-3 * rng.normal(size=3)
        reading = ContactReading(point, np.eye(3), force, np.zeros(3), std)
        own.add_contact("index", time, reading)
        own.add_pose(
            time, np.zeros(3), np.eye(3), PoseNoise(1e-4 * np.stack(2 * [np.eye(3)]), True)
        )
        own.align(time)
    return own


def test_noise_that_a_finger_states_is_believed_axis_by_axis():
    rows = stream(STATED).contacts(200, 250)
    np.testing.assert_allclose(rows.std[:, 0], np.broadcast_to(STATED, (50, 3)))


def test_noise_that_is_not_stated_is_what_scatters():
    rows = stream(np.full(3, np.nan)).contacts(200, 250)
    np.testing.assert_allclose(rows.std[:, 0], 0.05, rtol=0.25)


def test_noise_that_is_stated_far_too_small_is_what_scatters():
    rows = stream(1e-3 * np.array([0.05, 5.0, 50.0])).contacts(200, 250)
    np.testing.assert_allclose(rows.std[:, 0, 1:], [[5e-3, 0.05]] * 50)
    np.testing.assert_allclose(rows.std[:, 0, 0], 0.05, rtol=0.25)


def test_noise_of_contact_points_is_measured():
    assert stream(STATED).contacts(200, 250).point_std == pytest.approx(2e-3, rel=0.25)


def quartic(time: np.ndarray) -> np.ndarray:
    return np.array([1.0, -2.0, 3.0]) * (1.0 + 1e4 * np.asarray(time)[..., None] ** 4)


def queue(times: np.ndarray) -> ContactQueue:
    own = ContactQueue(0.1)
    for time in times:
        force = quartic(time)
        own.append(time, ContactReading(force, np.eye(3), force, np.zeros(3), np.full(3, 0.03)))
    return own


@pytest.mark.parametrize("share", [0.1, 0.5, 0.7])
def test_reading_between_samples_is_the_cubic_of_two_before_and_two_after(share):
    times = np.array([0.0, 0.011, 0.02, 0.029, 0.041, 0.05, 0.06, 0.071])
    own = queue(times)
    for left in range(1, 6):
        time = times[left] + share * (times[left + 1] - times[left])
        nodes = times[left - 1 : left + 3]
        cubic = np.polynomial.Polynomial.fit(nodes, quartic(nodes)[:, 0], 3)(time)
        reading = own.read(time, 0.01)
        assert reading.force[0] == pytest.approx(cubic, rel=1e-12)
        assert reading.point[2] == pytest.approx(3.0 * cubic, rel=1e-12)


def test_reading_between_the_first_two_samples_is_linear():
    times = np.array([0.0, 0.01, 0.02, 0.03, 0.04])
    own = queue(times)
    expected = quartic(times[:2]).mean(axis=0)
    np.testing.assert_allclose(own.read(0.005, 0.01).force, expected, rtol=1e-12)


def test_noise_of_faster_readings_is_that_of_a_grid_of_the_same_power():
    own = ContactQueue(0.1)
    std = np.array([0.02, 0.3, 0.07])
    for k in range(100):
        force = np.array([1.0, -2.0, 3.0])
        own.append(1e-3 * k, ContactReading(force, np.eye(3), force, np.zeros(3), std))
    np.testing.assert_allclose(own.read(0.05, 0.01).std, std * np.sqrt(0.1), rtol=1e-6)


@pytest.mark.parametrize(("offset", "counts"), [(0.011, True), (0.0135, False)])
def test_a_mean_reaches_over_a_period_and_a_quarter_of_the_grid(offset, counts):
    own = ContactQueue(0.1)
    for k in range(200):
        time = 5e-4 * k
        force = np.array([0.0, 0.0, 5.0 + 1.0 * (abs(abs(time - 0.05) - offset) < 1e-6)])
        own.append(time, ContactReading(force, np.eye(3), force, np.zeros(3), np.full(3, 0.03)))
    moved = own.read(0.05, 0.01).force[2] != pytest.approx(5.0, abs=1e-9)
    assert moved == counts
