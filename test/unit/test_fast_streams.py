"""Streams faster than any motion are averaged, noise and all; others stay as they are."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.tables import WristOptions, wrist_table
from tactile_dynamics_ros.core.inertia.batch.averaging import FAST, averaged
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.rigid_body.rotation import are_rotations


def wrist(rate_hz, seed=3, duration=6.0):
    table, body = wrist_table(seed, WristOptions(duration=duration, rate_hz=rate_hz, bias_n=2.0))
    return table.streams(), body


@pytest.fixture(scope="module")
def fast():
    return wrist(1000.0)


def test_slow_streams_stay_as_they_are():
    streams, _ = wrist(200.0, duration=2.0)
    same = averaged(streams)
    assert same.pose is streams.pose
    assert same.contacts["wrist"] is streams.contacts["wrist"]


def test_means_have_the_noise_of_means(fast):
    streams, _ = fast
    slow = averaged(streams)
    wrist, pose = slow.contacts["wrist"], slow.pose
    assert len(pose.time) == len(wrist.time) == pytest.approx(6.0 * FAST, abs=2)
    np.testing.assert_allclose(pose.time, wrist.time)
    each = streams.contacts["wrist"].force_std[0, 0]
    np.testing.assert_allclose(wrist.force_std[1:-1], each / np.sqrt(8.0))
    np.testing.assert_allclose(pose.covariance[5], streams.pose.covariance[5] / 8.0)
    assert np.all(are_rotations(pose.rotation))
    np.testing.assert_allclose(
        wrist.force[20], streams.contacts["wrist"].force[160:168].mean(axis=0)
    )
    again = averaged(slow)
    assert again.pose is pose


def test_a_fast_recording_is_estimated_as_well_as_its_means_allow(fast):
    streams, body = fast
    found = estimate(streams).to_estimate()
    assert found.samples < 6.0 * FAST
    assert found.error.whitened_rms == pytest.approx(1.0, abs=0.1)
    off = np.append(found.inertia.mass - body.mass, found.inertia.com - body.com)
    assert np.all(np.abs(off) < 4.0 * found.parameter_std[:4])
    slow = estimate(wrist(125.0)[0]).to_estimate()
    assert found.parameter_std[0] < 0.6 * slow.parameter_std[0]


def test_forces_alone_may_be_fast():
    streams, body = wrist(1000.0)
    pose = streams.pose
    kept = slice(0, None, 33)
    slow = replace(
        pose,
        time=pose.time[kept],
        position=pose.position[kept],
        rotation=pose.rotation[kept],
        covariance=pose.covariance[kept],
    )
    found = estimate(replace(streams, pose=slow)).to_estimate()
    off = np.append(found.inertia.mass - body.mass, found.inertia.com - body.com)
    assert np.all(np.abs(off) < 4.0 * found.parameter_std[:4])
