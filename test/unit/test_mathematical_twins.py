"""Pairs of effects of which one can do all that the other does: no recording refutes the former."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_dynamics_ros.core.effects.check import example_inertia, example_samples
from tactile_dynamics_ros.core.effects.held.gravity import load_regressor
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

GRAVITY = np.array([0.0, 0.0, -9.81])
PHI = example_inertia()


def wrench(label: str, theta: list[float] | np.ndarray, phi: np.ndarray = PHI) -> np.ndarray:
    """(N, 6) contact wrench that a load with an effect asks for."""
    samples = example_samples(turning_contacts=False)
    shown = create_effect(label).wrench(samples, phi, np.asarray(theta, dtype=float))
    return np.asarray(load_regressor(samples) @ phi - shown)


def test_a_tilted_gravity_is_a_cable_at_the_centre_of_mass():
    tilt = np.array([0.05, -0.03])
    pull = PHI[0] * (exp_so3(np.array([*tilt, 0.0])) @ GRAVITY - GRAVITY)
    cable = wrench("hanging_cable", [*pull, *(PHI[1:4] / PHI[0])])
    assert wrench("gravity_tilt", tilt) == pytest.approx(cable, abs=1e-12)


def test_an_added_mass_is_a_mass_that_a_cable_carries():
    heavier = PHI.copy()
    heavier[0] += 0.2
    cable = wrench("hanging_cable", [*(-0.2 * GRAVITY), 0.0, 0.0, 0.0], heavier)
    assert wrench("added_mass", [0.2]) == pytest.approx(cable, abs=1e-12)


def test_a_cable_is_a_soft_spring_from_afar():
    """The difference is k times the path of the point, and goes to zero with k."""
    force, point = np.array([0.3, -0.2, 0.4]), [0.02, 0.01, -0.03]
    cable = wrench("hanging_cable", [*force, *point])
    gaps = [
        np.abs(wrench("tether_spring", [k, *(force / k), *point]) - cable).max()
        for k in (1e-1, 1e-4)
    ]
    assert gaps[1] == pytest.approx(1e-3 * gaps[0], rel=1e-3)


@pytest.mark.parametrize("reading", ["force_bias", "force_bias:@body"])
def test_a_push_in_one_place_is_a_bias_of_fingers_that_stay(reading: str):
    samples = example_samples(turning_contacts=False)
    theta = np.array([0.3, -0.1, 0.2, 0.03, 0.02, -0.01])
    push = create_effect("unsensed_contact").wrench(samples, PHI, theta)
    bias = create_effect(reading)
    columns = bias.jacobian(samples, PHI, np.zeros(len(bias.parameters(samples))))
    rows = columns.reshape(-1, columns.shape[2])
    found = np.linalg.lstsq(rows, push.ravel(), rcond=None)[0]
    assert rows @ found == pytest.approx(push.ravel(), abs=1e-9)


def test_a_bias_is_no_push_in_one_place_once_fingers_have_moved():
    samples = example_samples(turning_contacts=False)
    moved = dataclasses.replace(samples, contact_point=samples.contact_point[:, [1, 2, 3, 0]])
    bias = create_effect("force_bias")
    theta = 0.1 * np.arange(len(bias.parameters(samples)))
    before, after = (bias.wrench(s, PHI, theta)[0, :3] for s in (samples, moved))
    assert np.linalg.norm(before - after) > 0.001


def test_a_short_lag_is_a_delay():
    """Both show the forces of a moment ago: their derivatives at zero are the same."""
    samples = example_samples(400, turning_contacts=False)
    late, lagging = (
        create_effect(name).jacobian(samples, PHI, np.array([1e-4]))[50:-50, :, 0].ravel()
        for name in ("time_offset:body", "sensor_lag")
    )
    likeness = late @ lagging / (np.linalg.norm(late) * np.linalg.norm(lagging))
    assert abs(likeness) > 0.99
