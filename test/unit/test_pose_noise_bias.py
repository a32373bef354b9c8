"""Intervals of effects that ring: noise of the poses that drives them counts."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.effects.registry import create_effects
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.batch.pose_noise_bias import widen_by_pose_noise
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions


@pytest.fixture(scope="module")
def hidden():
    options = ScenarioOptions(duration=15.0, finger_roll=True)
    return generate(2, {"sloshing_mass": 2.0}, options)


def test_the_true_frequency_of_a_heavy_slosh_is_within_the_interval(hidden):
    model = fit_recording(hidden.streams, create_effects(["sloshing_mass"]))
    truth = hidden.truth()["effects"]["sloshing_mass"]["parameters"]["frequency"]["value"]
    wide = widen_by_pose_noise(model, hidden.streams)
    error = model.theta[0][1] - truth
    narrow, honest = (np.sqrt(m.covariance[11, 11]) for m in (model, wide))
    assert abs(error) > 4.0 * narrow
    assert abs(error) < 3.0 * honest
    np.testing.assert_allclose(
        wide.covariance - model.covariance, np.outer(wide.noise_bias, wide.noise_bias), atol=1e-9
    )


def test_effects_that_do_not_ring_are_left_alone(hidden):
    model = fit_recording(hidden.streams, create_effects(["viscous_drag"]))
    assert widen_by_pose_noise(model, hidden.streams) is model
