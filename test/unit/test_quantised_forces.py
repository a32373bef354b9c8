"""Force sensors with coarse steps: noise of step^2 / 12 along each axis of the sensor."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.numerics.noise import quantisation_step, rounding_noise
from tactile_dynamics_ros.recording import Recording

MASS, COM = 0.9, np.array([0.01, -0.02, 0.06])
STEPS = np.array([1.0, 0.5, 2.0])


def _turned_load(seed: int, steps: np.ndarray, torque_step: float) -> Recording:
    """Return a load that a wrist turns slowly about its origin, read in steps."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 15.0, 0.01)
    waves = np.sin(rng.uniform(0.3, 0.9, (3, 1)) * time + rng.uniform(0, 6, (3, 1)))
    turned = Rotation.from_rotvec(1.5 * waves.T)
    force = turned.inv().apply([0.0, 0.0, 9.81 * MASS])
    torque = np.cross(COM, force) + 0.003 * rng.normal(size=force.shape)
    force = force + 0.02 * rng.normal(size=force.shape)
    wrist = {
        "time": time,
        "force": steps * np.round(force / steps),
        "torque": torque_step * np.round(torque / torque_step),
        "position": np.zeros(3),
        "rotation": np.eye(3),
    }
    pose = {"time": time, "position": np.zeros(3), "rotation": turned.as_matrix()}
    return Recording.from_arrays({"wrist": wrist}, pose, contact_frame="object")


def test_steps_are_seen_and_a_fine_signal_has_none():
    rng = np.random.default_rng(0)
    fine = np.cumsum(rng.normal(size=2000))
    assert quantisation_step(0.3 + 0.25 * np.round(fine / 0.25)) == pytest.approx(0.25)
    assert quantisation_step(fine) == 0.0
    assert quantisation_step(np.ones(50)) == 0.0


def test_each_axis_of_a_sensor_has_the_noise_of_its_own_steps():
    wrist = _turned_load(1, STEPS, 0.1).streams.contacts["wrist"]
    np.testing.assert_allclose(rounding_noise(wrist, wrist.force), STEPS / np.sqrt(12.0), rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_mass_read_in_coarse_steps_lies_in_its_interval(seed):
    recording = _turned_load(10 + seed, np.ones(3), 0.1)
    assert not any("saturated" in line for line in recording.problem_lines())
    result = estimate(recording)
    assert 0.5 < result.to_estimate().error.whitened_rms < 1.5
    mass, std = result.to_estimate().inertia.mass, result.to_estimate().parameter_std[0]
    assert abs(mass - MASS) < 3.0 * std < 0.3 * MASS
