"""Every mistake with a recording has a reading that undoes it; readings are ranked by mechanics."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.support.conventions import MISTAKES, OF_FINGERS, OF_IMU, mistaken
from benchmarks.support.tables import WristOptions, finger_table, wrist_table
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.conventions.balance import Evidence, thinned
from tactile_dynamics_ros.core.inertia.conventions.finder import assumed
from tactile_dynamics_ros.core.inertia.conventions.motions import Motions
from tactile_dynamics_ros.core.inertia.conventions.ranking import Readings, readings_of
from tactile_dynamics_ros.core.inertia.conventions.reading import CONVENTIONS

ANGLE_FORMS = {"angle_unit": (0, 1, 2, 3)}


def right_and_recorded(name, seed, form, hand="wrist"):
    if hand == "finger":
        table, _ = finger_table(seed, duration=8.0)
    else:
        table, _ = wrist_table(seed, WristOptions(duration=8.0, imu=name in OF_IMU))
    return table.streams(), mistaken(table, name, form).streams()


def differences(streams, other):
    """Largest differences of what is measured, up to the origin of the positions."""
    found = []
    for name, contact in streams.contacts.items():
        twin = other.contacts[name]
        found += [contact.force - twin.force, contact.torque - twin.torque]
        lever, same = contact.position - streams.pose.position, twin.position - other.pose.position
        found += [lever - same]
    found += [streams.pose.rotation - other.pose.rotation]
    found += [streams.pose.position - other.pose.position]
    found += [streams.pose.time - other.pose.time]
    if streams.imu is not None:
        found += [streams.imu.specific_force - other.imu.specific_force]
        found += [streams.imu.angular_velocity - other.imu.angular_velocity]
    return max(float(np.abs(d).max()) for d in found)


def least_difference(recorded, right, name):
    """That of the best reading of a name; readings that a recording does not allow are left out."""
    found = []
    for reading in readings_of(recorded):
        if reading.name == name:
            with contextlib.suppress(BadInputError):
                found.append(differences(reading.apply(recorded), right))
    return min(found)


def cases():
    for name in MISTAKES:
        for form in ANGLE_FORMS.get(name, (0, 1)):
            yield name, form


def test_names_are_those_of_the_documented_interface():
    assert tuple(MISTAKES) == CONVENTIONS


@pytest.mark.parametrize(("name", "form"), cases())
def test_a_reading_undoes_each_mistake(name, form):
    seed = 8 if name == "angle_unit" else 5
    right, recorded = right_and_recorded(name, seed, form)
    assert differences(recorded, right) > 0.05
    if name == "gravity_direction":  # the heading of the world is free
        attitude = right.pose.rotation[:, 2]
        apart = [
            np.abs(reading.apply(recorded).pose.rotation[:, 2] - attitude).max()
            for reading in readings_of(recorded)
            if reading.name == name
        ]
        assert min(apart) < 1e-9
    else:
        assert least_difference(recorded, right, name) < 1e-6


@pytest.mark.parametrize("name", OF_FINGERS[:5])
def test_mistakes_of_fingertips_have_readings_too(name):
    right, recorded = right_and_recorded(name, 6, 2, "finger")
    assert differences(recorded, right) > 1.0
    assert least_difference(recorded, right, name) < 0.05  # fingers do not share the pose's noise


def test_readings_state_their_noise_in_their_own_unit():
    _, recorded = right_and_recorded("position_unit", 5, 0)
    [reading] = [r for r in readings_of(recorded) if r.change == "positions are in mm, not m"]
    stated = reading.apply(recorded).pose.covariance[0]
    assert_allclose(np.sqrt(np.diag(stated)), np.repeat([5e-4, 1e-4], 3))
    _, recorded = right_and_recorded("force_unit", 5, 0)
    [reading] = [
        r for r in readings_of(recorded) if "kgf, not N" in r.change and "forces" in r.change
    ]
    assert_allclose(reading.apply(recorded).contacts["wrist"].force_std, 0.05)


def weigh(streams):
    return Evidence.of(thinned(streams), Motions()).weigh()


def test_a_right_recording_balances_to_its_noise_and_negated_forces_are_no_body():
    right, recorded = right_and_recorded("force_sign", 5, 1)
    fits, fails = weigh(right), weigh(recorded)
    assert fits.left["force"] < -3.5 and fits.implausible == 0.0
    assert fails.left["force"] > -1.5


def test_noise_that_a_reading_makes_larger_does_not_flatter_it():
    right, _ = right_and_recorded("position_unit", 5, 0)
    pose = right.pose
    larger = replace(
        right, pose=replace(pose, position=1e3 * pose.position, covariance=1e6 * pose.covariance)
    )
    assert weigh(larger).score > weigh(right).score + 3.0


@pytest.mark.parametrize("name", ["torque_unit", "mirrored_axes", "gyro_sign"])
def test_the_mistaken_convention_ranks_first(name):
    _, recorded = right_and_recorded(name, 5, 0)
    ranking = Readings.of(recorded).alone
    assert ranking.ranked[0].reading.name == name
    assert ranking.gain > 0.9


@pytest.mark.parametrize("hand", ["wrist", "finger"])
def test_no_reading_of_a_right_recording_is_better(hand):
    right, _ = right_and_recorded("force_sign", 7, 0, hand)
    assert Readings.of(right).alone.gain < 0.01
    assert Readings.of(right).disturbed.gain < 0.01


def test_a_convention_is_assumed_in_the_form_that_fits():
    right, recorded = right_and_recorded("torque_unit", 5, 0)
    streams, reading = assumed(recorded, "torque_unit")
    assert reading.change == "torques are in N mm, not N m"
    assert_allclose(streams.contacts["wrist"].torque, right.contacts["wrist"].torque)


@pytest.mark.parametrize(
    ("name", "says"), [("torque", "expected one of"), ("gyro_unit", "nothing in this recording")]
)
def test_what_cannot_be_assumed_is_refused(name, says):
    right, _ = right_and_recorded("torque_unit", 5, 0)
    with pytest.raises(BadInputError, match=says):
        assumed(right, name)
