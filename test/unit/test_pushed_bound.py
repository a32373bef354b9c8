"""The bound of the benchmark falls with what a recording tells."""

from dataclasses import replace

import pytest

from benchmarks.pushed.bound import bound
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions

SENSORS = SensorOptions()


def made(**actions):
    options = pushed.ActionOptions(count=1, travel=0.03, duration=0.6, pauses=0, **actions)
    return pushed.generate([5], {}, pushed.PushOptions(actions=options))[0].scene


def test_without_noise_of_forces_everything_is_known_better():
    scene = made(speed=(0.1, 0.1))
    noisy = bound(scene, SENSORS)
    good = bound(scene, replace(SENSORS, force_std=0.25 * SENSORS.force_std))
    assert noisy["friction_force_n"] / good["friction_force_n"] == pytest.approx(4.0, rel=0.5)
    assert all(good[name] < noisy[name] for name in noisy)


def test_mass_is_told_by_fast_pushes_and_hardly_by_slow_ones():
    fast, slow = (bound(made(speed=(v, v)), SENSORS) for v in (0.2, 0.03))
    assert fast["mass"] < 0.5 * slow["mass"]
