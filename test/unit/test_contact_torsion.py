"""Torsion of soft fingertips: each with its own coefficient, elastic until it slips."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.carried import CarriedOptions, generate_carried
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.effects.check import check_effect, example_samples
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings

COUNT = 400


def turning(rate, pressing=2.0, pause=None) -> WrenchSamples:
    """One finger that presses along z while the object turns about z at these rates (N,)."""
    time = 0.01 * np.arange(len(rate))
    if pause is not None:
        time = np.where(np.arange(len(rate)) >= pause, time + 5.0, time)
    still = np.zeros((len(rate), 3))
    eye = np.broadcast_to(np.eye(3), (len(rate), 3, 3))
    spin = np.stack([still[:, 0], still[:, 0], rate], axis=1)
    return WrenchSamples(
        time=time,
        position=still,
        rotation=eye,
        velocity=still,
        acceleration=still,
        angular_velocity=spin,
        angular_acceleration=still,
        contact_names=("tip",),
        contact_point=still[:, None],
        contact_rotation=eye[:, None],
        contact_force=np.tile([0.0, 0.0, pressing], (len(rate), 1))[:, None],
        contact_torque=still[:, None],
        in_contact=np.ones((len(rate), 1), dtype=bool),
        gravity=np.array([0.0, 0.0, -9.81]),
    )


def torque(samples, limit, stiffness):
    effect = create_effect("contact_torsion:sticks")
    return effect.wrench(samples, np.zeros(10), np.array([limit, stiffness]))[:, 2]


def test_a_small_twist_is_a_spring():
    rate = 0.1 * np.cos(np.arange(COUNT) * 0.05)
    samples = turning(rate)
    angle = np.cumsum(rate) * 0.01 - rate[0] * 0.01
    np.testing.assert_allclose(torque(samples, 0.01, 0.05), -0.05 * angle, atol=1e-12)


def test_a_large_twist_slips_at_the_limit_and_holds_its_torque_at_rest():
    rate = np.where(np.arange(COUNT) < 200, 1.0, 0.0)
    found = torque(turning(rate), 0.01, 0.05)
    assert found.min() == pytest.approx(-0.01 * 2.0)
    np.testing.assert_allclose(found[200:], -0.02)


def test_turning_back_unloads_the_spring_first():
    rate = np.where(np.arange(COUNT) < 200, 1.0, -1.0)
    found = torque(turning(rate), 0.01, 0.05)
    assert found[199] == pytest.approx(-0.02)
    np.testing.assert_allclose(np.diff(found)[199:259], 0.05 * 0.01, atol=1e-12)
    assert found[-1] == pytest.approx(0.02)


def test_a_pause_forgets_the_twist():
    found = torque(turning(np.full(COUNT, 0.05), pause=200), 0.01, 0.05)
    assert found[199] == pytest.approx(-0.05 * 0.05 * 1.99)
    assert found[200] == 0.0


@pytest.mark.parametrize("reading", ["fingers", "sticks", "relative_sticks"])
def test_the_readings_keep_the_contract_of_effects(reading):
    assert check_effect(create_effect(f"contact_torsion:{reading}")).failures == ()


def test_each_finger_has_its_own_coefficient():
    samples = example_samples()
    names = [p.name for p in create_effect("contact_torsion:sticks").parameters(samples)]
    assert names == [*(f"torsion_{name}" for name in samples.contact_names), "stiffness"]
    effect, theta = create_effect("contact_torsion:fingers"), np.zeros(len(names))
    theta[0], theta[-1] = 0.01, 0.05
    alone = np.zeros_like(samples.in_contact)
    alone[:, 0] = samples.in_contact[:, 0]
    common = create_effect("contact_torsion").wrench(
        replace(samples, in_contact=alone), np.zeros(10), np.array([0.01, 0.05])
    )
    np.testing.assert_allclose(effect.wrench(samples, np.zeros(10), theta), common, atol=1e-12)


@pytest.mark.parametrize("torsion", [(0.006, 0.001, 0.003), (0.004, 0.004, 0.004)])
def test_fingertips_that_stick_and_slip_are_found_in_a_recording(torsion):
    options = CarriedOptions(torsion=torsion, twist_stiffness=0.06)
    model = HeldObjectModel.from_fit(fit_with_readings(generate_carried(61, options).streams))
    diagnosis = diagnose(model)
    assert (diagnosis.verdict, diagnosis.effect) == ("missing_effect", "contact_torsion")
    found = diagnosis.explained_model.parameters()["contact_torsion"]
    for index, true in enumerate(torsion, start=1):
        entry = found[f"torsion_finger_{index}"]
        assert entry["value"] == pytest.approx(true, abs=max(5.0 * entry["std"], 2e-4))
    assert found["stiffness"]["value"] == pytest.approx(0.06, rel=0.1)


def test_offsets_that_take_all_contacts_to_their_middle_are_impossible():
    samples = example_samples()
    points = samples.contact_point.mean(axis=0)
    effect = create_effect("contact_offset")
    whole = (points - points.mean(axis=0)).ravel()
    assert not effect.is_possible(samples, np.zeros(10), whole)
    assert effect.is_possible(samples, np.zeros(10), 0.1 * whole)
    common = create_effect("contact_offset:common")
    assert common.is_possible(samples, np.zeros(10), np.array([0.08, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("label", "theta"),
    [
        ("tether_spring", [-3.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0]),
        ("viscous_drag", [-0.2]),
        ("added_mass", [-10.0]),
        ("contact_torsion", [-0.01, 0.05]),
    ],
)
def test_a_spring_that_pushes_and_the_like_cannot_be(label, theta):
    effect, inertia = create_effect(label), np.array([0.5, *np.zeros(9)])
    assert not effect.is_possible(example_samples(), inertia, np.array(theta))
    assert effect.is_possible(example_samples(), inertia, np.abs(theta))
