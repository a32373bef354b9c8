"""Contacts that carry the noise of the tracked pose are told from those measured for themselves."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.carried import CarriedOptions, generate_carried
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.inertia.residuals import newton_euler_residual
from tactile_dynamics_ros.core.inertia.residuals.carried import carried_places
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import WrenchProblem
from tactile_dynamics_ros.core.inertia.residuals.sensitivity import motion_sensitivity
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3


def true_parameters(recording):
    body = recording.body
    return InertialParameters(body.mass, body.com, body.inertia_com).dynamic_parameters


def white_rms_of_torque(recording):
    problem = WrenchProblem.from_streams(recording.streams)
    phi = true_parameters(recording)
    white = problem.linearise(phi).whiten(problem.residual(phi)).reshape(-1, 6)
    return np.sqrt(np.mean(white[:, :3] ** 2))


@pytest.mark.parametrize("fingers", [3, 4])
@pytest.mark.parametrize("size", [5e-5, 1e-3])
@pytest.mark.parametrize("own", [0.0, 5e-4])
@pytest.mark.parametrize("carried", [True, False])
def test_whose_noise_the_points_carry_is_seen(carried, own, size, fingers):
    options = CarriedOptions(
        carried, fingers, position_std=size, rotation_std=5.0 * size, point_std=min(own, size)
    )
    found = carried_places(generate_carried(31, options).streams)
    assert len(found) == (fingers if carried else 0)


@pytest.mark.parametrize("carried", [True, False])
def test_contacts_between_the_poses_are_told_as_well(carried):
    streams = generate_carried(32, CarriedOptions(carried, rate_hz=100.0)).streams
    pose = streams.pose
    sparse = replace(
        pose,
        time=pose.time[::2],
        position=pose.position[::2],
        rotation=pose.rotation[::2],
        covariance=pose.covariance[::2],
    )
    contacts = streams.contacts
    if carried:
        between = 0.5 * (sparse.position[:-1] + sparse.position[1:])
        turn = sparse.rotation[:-1]
        contacts = {
            name: replace(
                contact,
                pose_time=sparse.time[:-1] + 0.01,
                position=between + turn @ np.array([0.0, 0.0, 1e-3]),
                rotation=turn,
            )
            for name, contact in contacts.items()
        }
    found = carried_places(replace(streams, pose=sparse, contacts=contacts))
    assert bool(found) == carried


def test_residuals_of_carried_contacts_are_white_and_are_not_if_the_lever_counts_as_noisy(
    monkeypatch,
):
    recording = generate_carried(33, CarriedOptions(position_std=1e-3, rotation_std=5e-3))
    assert white_rms_of_torque(recording) == pytest.approx(1.0, abs=0.05)
    monkeypatch.setattr(newton_euler_residual, "carried_places", lambda streams: {})
    assert white_rms_of_torque(recording) < 0.9


def test_turned_poses_move_only_the_force_at_the_lever_of_a_carried_contact():
    recording = generate_carried(34, CarriedOptions(drawn=False, force_std=1e-6))
    problem, phi = WrenchProblem.from_streams(recording.streams), true_parameters(recording)
    samples, turn = problem.samples, np.array([2e-6, -1e-6, 3e-6])
    sensitivity = motion_sensitivity(samples, phi, True, True, np.array([True, True, True]))
    rotation = exp_so3(turn) @ samples.rotation
    force = np.swapaxes(rotation, 1, 2) @ samples.rotation
    force = (force[:, None] @ samples.contact_force[..., None])[..., 0]
    moved = samples.with_forces(force).measured_wrench - samples.measured_wrench
    np.testing.assert_allclose(sensitivity["orientation"][:, 0] @ turn, -moved, atol=1e-10)
    np.testing.assert_array_equal(sensitivity["position"][:, 0, :3], 0.0)


@pytest.mark.parametrize("carried", [True, False])
def test_nothing_is_found_in_clean_recordings_of_either_kind(carried):
    streams = generate_carried(35, CarriedOptions(carried)).streams
    diagnosis = diagnose(HeldObjectModel.from_fit(fit_with_readings(streams)))
    assert diagnosis.verdict == "adequate"
