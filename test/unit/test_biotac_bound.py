"""The bound on what a fingertip can tell: it follows from noise, units and memory."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.biotac_bound import Instant, _moving, _slope, force_covariance
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig

QUIET = BioTacConfig(noise=0.3, wander=0.0, pressure_noise=0.1)
LOUD = BioTacConfig(noise=3.4, wander=1.0, pressure_noise=1.2)


@pytest.fixture
def instant() -> Instant:
    units = BioTacArray(2, BioTacConfig(unit_variation=0.0), seed=1).units
    force, point = np.array([0.1, -0.05, -0.9]), np.array([-5e-3, 0.0, -7e-3])
    return Instant(force, point, units, np.array([0.3, 0.2, 0.2, 1e-3, 1e-3]))


def test_noise_costs_precision_and_no_noise_leaves_what_differs_between_units(instant):
    loud = np.sqrt(np.diag(force_covariance(instant, LOUD)))
    quiet = np.sqrt(np.diag(force_covariance(instant, QUIET)))
    assert np.all(loud > 1.2 * quiet)
    assert 0.003 < quiet[0] < 0.03


def test_a_loud_unit_is_known_less_well(instant):
    louder = replace(instant, unit=replace(instant.unit, loudness=2.0 * instant.unit.loudness))
    usual, worse = (np.diag(force_covariance(each, BioTacConfig())) for each in (instant, louder))
    assert np.all(worse > 1.05 * usual)


def test_many_frames_average_white_noise(instant):
    config = replace(LOUD, wander=0.0)
    signals = _moving(instant, config)
    noise = np.array([config.noise] * 19 + [config.pressure_noise])
    alone = np.linalg.inv(signals.T @ (signals / noise[:, None] ** 2))[:3, :3]
    many = np.diag(force_covariance(instant, config))
    assert np.all(many[1:] < 0.6 * np.diag(alone)[1:])


def test_derivatives_are_those_of_the_sensor(instant):
    config = BioTacConfig(unit_variation=0.0)
    signals = _moving(instant, config)
    push = np.outer([0.02, -0.02], [0.0, 0.0, -1.0])
    change = _slope(instant.force + push, instant.point, instant.unit, config, 0.02)
    assert change == pytest.approx(signals[:, 0], abs=0.02 * np.abs(change).max())
