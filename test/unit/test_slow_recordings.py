"""Loggers of a few hertz: nothing overflows, nothing is found that is not there."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from benchmarks.support.slow import slow_logger
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import explanation_document
from tactile_dynamics_ros.core.discrepancy.explanation import explain
from tactile_dynamics_ros.core.effects.filters import discretise
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import choose_grid

LOGGERS = [(6.0, 40.0), (5.0, 40.0), (2.0, 100.0), (1.0, 100.0), (0.5, 100.0)]


def model_of(streams):
    return HeldObjectModel.from_fit(fit_with_readings(streams))


def deviations(streams, body):
    """Errors of mass and centre in standard deviations."""
    found = estimate(streams).to_estimate().to_json()
    value = np.array([found["mass"]["value"], *found["com"]["value"]])
    std = np.array([found["mass"]["std"], *found["com"]["std"]])
    return np.abs(value - [body.mass, *body.com]) / std


@pytest.mark.parametrize(("rate", "duration"), LOGGERS)
def test_slow_clean_recording_is_adequate_without_a_warning(rate, duration):
    made = slow_logger(11, rate, duration)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        found = diagnose(model_of(made.streams))
    assert found.verdict == "adequate"
    assert np.all(deviations(made.streams, made.scenario.body) < 4.0)


@pytest.mark.parametrize(("rate", "duration"), LOGGERS[1::2])
def test_motion_that_a_logger_cannot_follow_is_put_down_to_no_effect(rate, duration):
    made = slow_logger(12, rate, duration, followed=2.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        found = explain(model_of(made.streams))
    assert found.effects == ()
    sentence = explanation_document(found)["sentence"]
    assert found.verdict == "adequate" or "do not show the motion" in sentence
    assert np.all(deviations(made.streams, made.scenario.body) < 4.0)


def test_an_effect_is_named_at_five_hertz():
    made = slow_logger(13, 5.0, 60.0, effects={"unsensed_contact": 0.5})
    found = diagnose(model_of(made.streams))
    assert "unsensed_contact" in (found.effect, *found.group)


def test_the_grid_is_no_finer_than_four_times_the_motion():
    streams = slow_logger(11, 5.0, 20.0, force_rate_hz=100.0).streams
    assert_allclose(np.diff(choose_grid(streams, 125.0)), 0.05)
    even = slow_logger(11, 50.0, 4.0, force_rate_hz=100.0).streams
    assert_allclose(np.diff(choose_grid(even, 125.0)), 0.01)


@pytest.mark.parametrize("step", [0.01, 0.2, 2.0])
def test_steps_of_a_stiff_spring_damper_are_the_exponential(step):
    omega, damping = 2.0 * np.pi * 6.5, 0.1
    matrix = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]])
    transition, pushes = discretise(matrix[None], np.array([step]), omega)
    assert_allclose(transition[0], expm(matrix * step), atol=1e-9 * omega)
    joined = np.zeros((6, 6))
    joined[:2, :2] = matrix
    joined[1, 2] = joined[2, 3] = joined[3, 4] = joined[4, 5] = 1.0
    exact = expm(joined * step)[:2, 2:6].T
    assert_allclose(pushes[:, 0, :, 0], exact, atol=1e-9, rtol=1e-7)
