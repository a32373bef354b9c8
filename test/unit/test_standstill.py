"""A robot stands still since its joints moved last, however slowly they moved."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.robot.hand_kinematics import Standstill


def since(positions, period=0.01):
    still = Standstill()
    for k, place in enumerate(positions):
        still.update(period * k, np.array([0.3, place]))
    return still.since


def test_noise_of_joints_is_no_motion():
    noise = np.random.default_rng(0).normal(0.0, 5e-4, 300)
    assert since(noise) == 0.0


@pytest.mark.parametrize("speed", [0.02, 0.5])
def test_it_stands_still_since_its_last_motion(speed):
    moving = speed * 0.01 * np.arange(200)
    ended = since([*moving, *np.full(50, moving[-1])])
    assert 1.99 - 0.005 / speed - 0.01 <= ended <= 1.99


def test_nothing_is_known_before_the_first_positions():
    assert np.isinf(Standstill().since)
