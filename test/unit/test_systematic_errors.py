"""Presumed lasting errors: nothing on clean data, their true size where they are."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from synthetic_recording import held_box

from benchmarks.inertia.boxes import wrist_recording
from benchmarks.inertia.scenarios import four_fingers
from benchmarks.support.live_replay import replay_streams
from tactile_dynamics_ros.core.effects.check import example_samples
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.batch.fitting import fit_corrected
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.inertia.residuals.stated_noise import states_shares
from tactile_dynamics_ros.core.inertia.residuals.systematic import (
    SYSTEMATIC_SIZE,
    PresumedErrors,
    lasting_basis,
    systematic_basis,
    systematic_variances,
    with_gains,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

LOAD = 1.0
"""Weight that the sensors carry, N."""


def white_rows(seed: int, size: float, kinds: int = SYSTEMATIC_SIZE):
    """A regression with lasting errors of the first kinds, of the given size, as white rows."""
    rng = np.random.default_rng(seed)
    rotation = exp_so3(rng.normal(0, 0.5, (400, 3)))
    basis = systematic_basis(rotation, 0.05).reshape(-1, SYSTEMATIC_SIZE)
    jacobian = rng.normal(size=(len(basis), 4)) + basis[:, 2:6]
    error = size * rng.normal(size=SYSTEMATIC_SIZE) * (np.arange(SYSTEMATIC_SIZE) < kinds)
    measured = rng.normal(size=len(basis)) + basis @ error
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    shift = -inverse @ jacobian.T @ measured
    return inverse, jacobian, basis, measured + jacobian @ shift, shift


def test_clean_residuals_presume_nothing():
    found = [PresumedErrors.of_rows(*white_rows(k, 0.0)[:4], LOAD) for k in range(60)]
    assert np.mean([f.covariance[0, 0] > 0.0 for f in found]) < 0.15
    assert np.mean([f.errors.any() for f in found]) < 0.15


@pytest.mark.parametrize("load, left", [(100.0, 0.3), (1.0, 0.999)])
def test_an_error_of_the_sensors_is_corrected_as_far_as_is_usual(load, left):
    """A constant wrench of the body shifts the estimate by much less, unless it is unusual."""
    before, after = [], []
    for seed in range(60):
        inverse, jacobian, basis, residual, shift = white_rows(seed, 1.0, kinds=6)
        found = PresumedErrors.of_rows(inverse, jacobian, basis, residual, load)
        before.append(shift)
        after.append(shift + inverse @ jacobian.T @ basis @ found.errors)
    ratio = np.linalg.norm(after) / np.linalg.norm(before)
    assert ratio < left
    assert load > 1.0 or ratio > 0.9


@pytest.mark.parametrize("size", [0.5, 3.0])
def test_lasting_errors_are_covered(size):
    inside = []
    for seed in range(60):
        inverse, jacobian, basis, residual, shift = white_rows(seed, size)
        added = PresumedErrors.of_rows(inverse, jacobian, basis, residual, LOAD).covariance
        inside.append(np.abs(shift) < 1.645 * np.sqrt(np.diag(inverse + added)))
    assert 0.75 < np.mean(inside) < 0.98


def test_gains_are_covered_though_their_sum_leaves_no_trace():
    """Four gains of which only the differences show: what they shift the load by is covered."""
    inside, constant = [], np.zeros((400, SYSTEMATIC_SIZE))
    for seed in range(200):
        rng = np.random.default_rng(seed)
        gains = 20.0 * rng.normal(size=(400, 4))
        jacobian = gains.sum(axis=1, keepdims=True)
        measured = rng.normal(size=400) + gains @ rng.normal(0.0, 0.1, 4)
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        shift = -inverse @ jacobian.T @ measured
        residual = measured + jacobian @ shift
        basis = np.concatenate([constant, gains, np.zeros((400, 48))], axis=1)
        added = PresumedErrors.of_rows(inverse, jacobian, basis, residual, LOAD).covariance
        inside.append(abs(shift[0]) < 1.645 * np.sqrt((inverse + added)[0, 0]))
    assert 0.86 < np.mean(inside) < 0.97


def test_axes_that_a_sensor_mixes_are_covered():
    """Two sensors show a tenth of a load along one axis along others: the intervals hold it."""
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        mixed = 20.0 * rng.normal(size=(600, 2, 3, 3))
        gains = np.trace(mixed, axis1=2, axis2=3)
        mixed = mixed.reshape(600, 18)
        jacobian = mixed @ rng.normal(size=(18, 4)) + rng.normal(size=(600, 4))
        measured = rng.normal(size=600) + mixed @ rng.normal(0.0, 0.1, 18)
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        shift = -inverse @ jacobian.T @ measured
        constant, places = np.zeros((600, SYSTEMATIC_SIZE)), np.zeros((600, 6))
        basis = np.concatenate([constant, gains, places, mixed], axis=1)
        residual = measured + jacobian @ shift
        added = PresumedErrors.of_rows(inverse, jacobian, basis, residual, LOAD).covariance
        inside.append(np.abs(shift) < 1.645 * np.sqrt(np.diag(inverse + added)))
    assert 0.82 < np.mean(inside) < 0.98


def test_contacts_that_are_elsewhere_are_covered():
    """Each of four contacts is millimetres off: what its moments shift the load by is covered."""
    inside, without, four = [], [], example_samples()
    columns = lasting_basis(four, 0.05)
    rows = (columns @ with_gains(columns.shape[2])).reshape(-1, SYSTEMATIC_SIZE + 52)
    places = slice(SYSTEMATIC_SIZE + 4, SYSTEMATIC_SIZE + 16)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        basis = rows / 1e-3
        jacobian = basis[:, places] @ rng.normal(0.0, 1e-3, (12, 4))
        jacobian += rng.normal(size=jacobian.shape)
        measured = rng.normal(size=len(basis)) + basis[:, places] @ rng.normal(0.0, 3e-3, 12)
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        shift = -inverse @ jacobian.T @ measured
        residual = measured + jacobian @ shift
        added = PresumedErrors.of_rows(inverse, jacobian, basis, residual, LOAD).covariance
        inside.append(np.abs(shift) < 1.645 * np.sqrt(np.diag(inverse + added)))
        without.append(np.abs(shift) < 1.645 * np.sqrt(np.diag(inverse)))
    assert np.mean(without) < 0.6 and np.mean(inside) > 0.8


def test_no_information_gives_no_variance():
    [(weight, variances)] = systematic_variances(np.zeros((9, 9)), np.zeros(9))
    assert weight == 1.0 and not variances.any()


@pytest.mark.parametrize("box, seed", [("box_0", 300), ("box_0", 305), ("box_2", 300)])
def test_the_gain_of_an_only_sensor_is_not_presumed_from_rounding(box, seed):
    """It leaves no trace beside the load: the mass is known to a gram, not to kilograms."""
    streams, truth = wrist_recording(box, seed)
    estimate = estimate_body(streams).to_estimate()
    std = estimate.parameter_std
    assert np.all(std > 0.0) and std[0] < 0.01 * truth.mass
    assert abs(estimate.inertia.mass - truth.mass) < 4.0 * std[0]


def test_a_gain_that_is_off_is_covered():
    """Fingers read up to 20 % wrong: what that shifts the mass by is in the interval."""
    inside = []
    for seed in range(1000, 1012):
        case = four_fingers(seed, 8.0, {"force_scale": 2.0})
        estimate = estimate_body(case.streams).to_estimate()
        inside.append(abs(estimate.inertia.mass - case.truth.mass) / estimate.parameter_std[0])
    assert np.mean(np.array(inside) < 3.0) > 0.9
    assert np.median(inside) < 1.5


def test_an_only_sensor_has_no_gain_to_presume():
    """It is a heavier load, whatever a poor motion or a misfit may leave beside that."""
    four = example_samples()
    contact_fields = [field.name for field in fields(four) if field.name.startswith("contact_")]
    alone = replace(four, **{name: getattr(four, name)[:, :1] for name in contact_fields[1:]})
    alone = replace(alone, contact_names=four.contact_names[:1], in_contact=four.in_contact[:, :1])
    basis = lasting_basis(four, 0.05)
    gains = (basis @ with_gains(basis.shape[2]))[:, :, SYSTEMATIC_SIZE:]
    assert gains.shape == (len(four.time), 6, 52)
    whole = gains[:, :, :4].sum(axis=2)
    assert np.allclose(whole, four.measured_wrench)
    mixed = gains[:, :, 16:].reshape(len(four.time), 6, 4, 3, 3)
    assert np.allclose(np.trace(mixed, axis1=3, axis2=4), gains[:, :, :4])
    assert lasting_basis(alone, 0.05).shape == (len(four.time), 6, SYSTEMATIC_SIZE)
    assert with_gains(SYSTEMATIC_SIZE).shape == (SYSTEMATIC_SIZE, SYSTEMATIC_SIZE)


def test_a_contact_that_comes_later_adds_columns_at_the_end():
    """What was summed before it keeps its place."""
    four = example_samples()
    contact_fields = [field.name for field in fields(four) if field.name.startswith("contact_")]
    two = replace(four, **{name: getattr(four, name)[:, :2] for name in contact_fields[1:]})
    two = replace(two, contact_names=four.contact_names[:2], in_contact=four.in_contact[:, :2])
    before, after = lasting_basis(two, 0.05), lasting_basis(four, 0.05)
    assert before.shape[2] < after.shape[2]
    assert np.array_equal(before, after[:, :, : before.shape[2]])


def with_a_finger_off(case):
    """Streams of a case in which one finger reads a constant force too much, fixed in the body."""
    streams, rng = case.streams, np.random.default_rng(1)
    name = sorted(streams.contacts)[0]
    contact, pose = streams.contacts[name], streams.pose
    within = np.clip(contact.time, pose.time[0], pose.time[-1])
    turn = Slerp(pose.time, Rotation.from_matrix(pose.rotation))(within)
    direction = rng.normal(size=3)
    excess = 0.01 * 9.81 * case.truth.mass * direction / np.linalg.norm(direction)
    contact = replace(contact, force=contact.force + turn.apply(excess))
    return replace(streams, contacts={**streams.contacts, name: contact})


def deviations(estimate, truth):
    """Of mass (share) and centre of mass (m)."""
    centre = np.linalg.norm(estimate.inertia.com - truth.com)
    return [abs(estimate.inertia.mass / truth.mass - 1.0), centre]


def test_recordings_are_corrected_where_a_finger_is_off_by_a_percent():
    """Mass and centre of mass come out better than without, as a rule several times."""
    before, after = [], []
    for seed in range(1100, 1108):
        case = four_fingers(seed, 8.0)
        streams = with_a_finger_off(case)
        before.append(deviations(fit_recording(streams).to_estimate(), case.truth))
        after.append(deviations(estimate_body(streams).to_estimate(), case.truth))
    mass, centre = np.median(after, axis=0) / np.median(before, axis=0)
    assert mass < 0.4
    assert centre < 0.7


def test_the_live_estimate_is_corrected_alike():
    for seed in (1100, 1102):
        case = four_fingers(seed, 8.0)
        streams = with_a_finger_off(case)
        mass, _ = deviations(fit_recording(streams).to_estimate(), case.truth)
        assert deviations(list(replay_streams(streams))[-1], case.truth)[0] < 0.5 * mass


def test_the_estimate_does_not_leap_where_a_finger_has_a_lasting_error():
    """What lasting errors change is found anew when the estimate moves, not added from long ago."""
    streams = held_box(seconds=4.0, seed=3, motion=0.5).streams
    index = streams.contacts["index"]
    index.force[:] += [0.05, -0.08, 0.06]
    told = list(replay_streams(streams))[100:]
    moments = np.array([estimate.inertia.inertia_com.diagonal() for estimate in told])
    stds = np.array([estimate.parameter_std[4:7] for estimate in told])
    leaps = np.abs(np.diff(moments, axis=0)) / np.minimum(stds[1:], stds[:-1])
    assert leaps.max() < 30.0


def test_sensors_whose_noise_grows_with_their_load_are_told_from_others():
    rng = np.random.default_rng(3)
    loads = [f * (1.0 + 0.1 * rng.normal(size=(200, 3))) for f in (1.0, 3.0)]
    calibrated = [0.005 + 0.03 * np.linalg.norm(load, axis=1) for load in loads]
    averaged = [0.03 / np.sqrt(rng.integers(9, 12, (200, 1))) * np.ones(3) for _ in loads]
    assert states_shares(loads, calibrated)
    assert not states_shares(loads, [0.03 * np.ones((200, 3)) for _ in loads])
    assert not states_shares(loads, averaged)
    assert not states_shares([], [])


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_errors_of_fingertips_are_covered_at_any_size(size):
    """Of usual proportions; data a little different say a little different, as live and offline."""
    inside, leaps, four = [], [], example_samples()
    columns = lasting_basis(four, 0.05)
    basis = (columns @ with_gains(columns.shape[2])).reshape(-1, SYSTEMATIC_SIZE + 52) / 0.01
    usual = np.repeat([0.015, 0.006, 0.03, 0.0015, 0.015], [6, 3, 4, 12, 36])
    for seed in range(60):
        rng = np.random.default_rng(seed)
        jacobian = basis @ (usual[:, None] * rng.normal(size=(61, 4)))
        measured = basis @ (size * usual * rng.normal(size=61))
        measured += 3.0 * size * rng.normal(size=len(basis))  # nine samples are alike
        inverse, prior = np.linalg.inv(jacobian.T @ jacobian + 1e-6 * np.eye(4)), 1e-6 * np.eye(4)
        found = []
        for noise in (0.0, 0.3):
            seen = measured + noise * size * rng.normal(size=len(basis))
            shift = -inverse @ jacobian.T @ seen
            rows = inverse, jacobian, basis, seen + jacobian @ shift, LOAD
            added = PresumedErrors.of_rows(*rows, prior).covariance
            found.append(np.sqrt(np.diag(9.0 * size**2 * inverse + added)))
        inside.append(np.abs(shift) < 1.645 * found[1])
        leaps.append(np.abs(np.log(found[1] / found[0])))
    assert 0.8 < np.mean(inside) < 0.98
    assert np.max(leaps) < np.log(1.2)


def test_what_lasting_errors_do_is_told_where_they_were_found():
    """A correction moves the coordinates of a thin body, not what errors shift its moments by."""
    streams = with_a_finger_off(four_fingers(1100, 4.0))
    model = fit_recording(streams)
    found = fit_corrected(model)
    assert found.corrected.errors.any()
    np.testing.assert_allclose(found.lasting_covariance, model.lasting_covariance)
