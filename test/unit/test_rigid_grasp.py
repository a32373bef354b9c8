"""Poses sharpened by contacts that stay where they are on the object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.inertia.scenarios import Case, four_fingers
from benchmarks.inertia.scores import Score
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.inertia.residuals.rigid_grasp import (
    displacement_jacobian,
    sharpen_poses,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.streams.streams import Streams


@pytest.fixture(scope="module")
def case() -> Case:
    return four_fingers(3, 8.0)


def with_contacts(case: Case, change) -> Streams:
    contacts = {name: change(name, c) for name, c in case.streams.contacts.items()}
    return replace(case.streams, contacts=contacts)


def test_poses_become_sharp_up_to_one_displacement_of_the_body_frame(case):
    sharp = sharpen_poses(case.streams)
    assert sharp is not None and len(sharp.contacts) == 4
    truth, pose = case.scene.motion, sharp.streams.pose
    turn = log_so3(np.swapaxes(truth.rotation, 1, 2) @ pose.rotation)
    shift = truth.to_body(pose.position - truth.position)
    common = np.concatenate([turn.mean(axis=0), shift.mean(axis=0)])
    spread = np.concatenate([turn.std(axis=0), shift.std(axis=0)])
    assert np.all(spread[:3] < 1e-3 * np.degrees(1.0) * 0.02) and np.all(spread[3:] < 2.5e-5)
    assert np.all(np.abs(common) < 4.0 * np.sqrt(np.diag(sharp.frame_covariance)))


def test_estimate_comes_nearer_to_the_truth():
    gains = []
    for seed in range(3, 9):
        held = four_fingers(seed, 8.0)
        phi = estimate_body(held.streams).to_estimate().inertia.dynamic_parameters
        alone = fit_recording(held.streams).phi
        scores = [Score.of(held.truth, p, 0.0) for p in (alone, phi)]
        gains.append(np.log(scores[0].com_mm / scores[1].com_mm))
    assert np.mean(gains) > 0.1


def test_contacts_that_move_on_the_object_are_left_alone(case):
    def roll(name, contact):
        drift = np.outer(np.linspace(0.0, 1e-3, len(contact.pose_time)), [0.0, 1.0, 0.0])
        return contact if name == "thumb" else replace(contact, position=contact.position + drift)

    def late(_, contact):
        return replace(contact, pose_time=contact.pose_time + 0.01)

    assert sharpen_poses(with_contacts(case, roll)) is None
    assert sharpen_poses(with_contacts(case, late)) is None


def test_nothing_changes_without_a_stated_covariance_or_with_noisy_contacts(case):
    unstated = replace(case.streams, pose=replace(case.streams.pose, covariance=None))
    assert sharpen_poses(unstated) is None
    rng = np.random.default_rng(0)

    def scatter(_, contact):
        noise = 5e-4 * rng.normal(size=contact.position.shape)
        return replace(contact, position=contact.position + noise)

    assert sharpen_poses(with_contacts(case, scatter)) is None
    assert sharpen_poses(replace(case.streams, contacts={})) is None


def test_a_finger_that_lifts_counts_only_while_it_touches(case):
    def lift(name, contact):
        if name != "index":
            return contact
        gone = (contact.time > 3.0) & (contact.time < 4.0)
        away = np.where(gone[:, None], 0.05, 0.0)
        force = np.where(gone[:, None], 0.0, contact.force)
        return replace(contact, force=force, position=contact.position + away)

    sharp = sharpen_poses(with_contacts(case, lift))
    assert sharp is not None and "index" in sharp.contacts
    moved = sharp.streams.pose.position - case.scene.motion.position
    assert np.abs(moved).max() < 2e-4


def test_jacobian_of_a_displacement_is_its_derivative(case):
    phi, step = case.truth.dynamic_parameters, 1e-6
    jacobian = displacement_jacobian(phi)
    for k, axis in enumerate(np.eye(6)):
        transform = np.eye(4)
        transform[:3, :3], transform[:3, 3] = exp_so3(step * axis[:3]), step * axis[3:]
        moved = transform @ pseudo_inertia(phi) @ transform.T
        change = (dynamic_parameters_from_pseudo_inertia(moved) - phi) / step
        assert change == pytest.approx(jacobian[:, k], rel=1e-3, abs=1e-6)
