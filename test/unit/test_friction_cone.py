"""The friction cone: share used, and how far a force lies outside."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.friction.probe_config import cone_share, distance_beyond
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

NORMAL = np.array([0.0, 0.0, 1.0])


def test_share_of_the_cone_is_the_ratio_of_the_forces_over_the_coefficient():
    assert cone_share(np.array([0.3, 0.4, 2.0]), NORMAL, 0.5) == pytest.approx(0.5)
    assert cone_share(np.array([0.0, 1.0, 1.0]), NORMAL, 0.5) == pytest.approx(2.0)
    assert cone_share(np.zeros(3), NORMAL, 0.5) == 0.0
    assert cone_share(np.array([0.1, 0.0, 0.0]), NORMAL, 0.5) == np.inf


@pytest.mark.parametrize("seed", range(5))
def test_distance_is_that_to_the_nearest_force_that_friction_can_hold(seed):
    rng = np.random.default_rng(seed)
    turn, friction = exp_so3(rng.normal(size=3)), rng.uniform(0.2, 1.2)
    angle, press = np.meshgrid(np.linspace(0.0, 2 * np.pi, 721), np.linspace(0.0, 6.0, 1201))
    holdable = np.stack(
        [friction * press * np.cos(angle), friction * press * np.sin(angle), press], axis=-1
    ).reshape(-1, 3)
    for force in rng.normal(size=(10, 3)) * [1.0, 1.0, 2.0]:
        expected = 0.0
        if np.hypot(*force[:2]) > friction * force[2]:
            expected = np.linalg.norm(holdable - force, axis=1).min()
        found = distance_beyond(turn @ force, turn @ NORMAL, friction)
        assert found == pytest.approx(expected, abs=0.02)
