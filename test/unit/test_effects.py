"""Every effect of the catalogue: contract, sign and meaning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, lti

from tactile_dynamics_ros.core.effects import (
    EFFECT_NAMES,
    EffectParameter,
    LinearEffect,
    create_effect,
)
from tactile_dynamics_ros.core.effects.check import (
    check_effect,
    example_inertia,
    example_samples,
)
from tactile_dynamics_ros.core.effects.filters import first_order_lag
from tactile_dynamics_ros.core.effects.held.gravity import load_regressor
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

SAMPLES = example_samples()
INERTIA = example_inertia()


def applied(name, theta, samples=SAMPLES):
    return create_effect(name).wrench(samples, INERTIA, np.asarray(theta, dtype=float))


def to_world(samples, vectors):
    return np.einsum("nij,nj->ni", samples.rotation, vectors)


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_contract(name):
    report = check_effect(create_effect(name))
    assert report.passed, str(report)


def test_example_forces_balance_the_load():
    wrench = regressor(
        SAMPLES.specific_acceleration, SAMPLES.angular_velocity, SAMPLES.angular_acceleration
    )
    np.testing.assert_allclose(wrench @ INERTIA, SAMPLES.measured_wrench, atol=1e-9)


def test_drag_takes_power_from_the_object():
    for name in ("viscous_drag", "quadratic_drag"):
        force = to_world(SAMPLES, applied(name, [2.0])[:, 3:])
        assert np.all(np.einsum("ni,ni->n", force, SAMPLES.velocity) <= 0)
    torque = applied("rotational_drag", [0.1])[:, :3]
    np.testing.assert_allclose(torque, -0.1 * SAMPLES.angular_velocity)


def test_quadratic_drag_grows_with_the_square_of_speed():
    faster = replace(SAMPLES, velocity=2.0 * SAMPLES.velocity)
    slow = applied("quadratic_drag", [1.0])
    np.testing.assert_allclose(applied("quadratic_drag", [1.0], faster), 4.0 * slow)


def test_tether_pulls_the_body_point_to_its_anchor():
    anchor, point = np.array([0.1, 0.4, 1.0]), np.array([0.03, 0.0, -0.02])
    wrench = applied("tether_spring", [50.0, *anchor, *point])
    away = SAMPLES.position + SAMPLES.rotation @ point - anchor
    np.testing.assert_allclose(to_world(SAMPLES, wrench[:, 3:]), -50.0 * away)
    np.testing.assert_allclose(wrench[:, :3], np.cross(point, wrench[:, 3:]))


def test_tether_at_rest_length_is_slack():
    effect = create_effect("tether_spring:rest_length")
    still = replace(SAMPLES, position=np.zeros_like(SAMPLES.position))
    theta = np.array([50.0, 0.0, 0.0, 0.7, 0.0, 0.0, 0.0, 0.7])
    assert np.abs(effect.wrench(still, INERTIA, theta)).max() < 1e-12


def test_cable_stands_still_in_the_world_and_contact_in_the_body():
    cable = applied("hanging_cable", [0.5, 0.0, -1.0, 0.0, 0.03, 0.0])
    np.testing.assert_allclose(
        to_world(SAMPLES, cable[:, 3:]), np.tile([0.5, 0.0, -1.0], (len(cable), 1)), atol=1e-12
    )
    contact = applied("unsensed_contact", [0.5, 0.0, -1.0, 0.0, 0.03, 0.0])
    assert np.ptp(contact, axis=0).max() == 0.0
    np.testing.assert_allclose(contact[0, :3], np.cross([0.0, 0.03, 0.0], [0.5, 0.0, -1.0]))


def test_rotor_torque_is_across_spin_and_rate():
    torque = applied("spinning_rotor", [0.0, 0.0, 0.01])[:, :3]
    np.testing.assert_allclose(torque, -np.cross(SAMPLES.angular_velocity, [0.0, 0.0, 0.01]))


def kicked(time):
    """Samples of a body that is kicked along x for a tenth of a second and does not turn."""
    zero = np.zeros((len(time), 3))
    kick = np.where(((time > 0.2) & (time < 0.3))[:, None], [2.0, 0.0, 0.0], 0.0)
    return replace(
        example_samples(len(time)),
        time=time,
        rotation=np.tile(np.eye(3), (len(time), 1, 1)),
        acceleration=kick,
        angular_velocity=zero,
        angular_acceleration=zero,
    )


def test_slosh_rings_at_its_frequency_after_a_step():
    time = 0.002 * np.arange(2000)
    samples = kicked(time)
    force = applied("sloshing_mass", [0.1, 3.0, 0.05, 0.0, 0.0, 0.0], samples)[:, 3]
    ringing = force[200:]
    crossings = np.flatnonzero(np.diff(np.sign(ringing)) > 0)
    hz = 1.0 / np.mean(np.diff(time[crossings]))
    assert hz == pytest.approx(3.0, rel=0.01)
    assert np.abs(force[time < 0.19]).max() < 1e-9
    during = force[(time > 0.2) & (time < 0.22)]
    assert np.all(during > 0), "the mass stays behind, so the body feels less inertia"


@pytest.mark.parametrize("hz, damping", [(3.02, 0.006), (1.23, 0.02)])
def test_a_fit_of_a_mass_that_rings_for_long_starts_at_its_frequency(hz, damping):
    """Water in a glass; the filters of the screening, of damping 0.1, are far from it."""
    time = 0.01 * np.arange(1200)
    samples, rate = kicked(time), 2.0 * np.pi * hz
    system = lti([-1.0], [1.0, 2.0 * damping * rate, rate**2])
    _, moved, _ = lsim(system, samples.acceleration[:, 0], time)
    residual = 0.01 * np.random.default_rng(0).normal(size=(len(time), 6))
    residual[:, 3] += -0.15 * np.gradient(np.gradient(moved, time), time)
    start = create_effect("sloshing_mass").initial_guess(samples, INERTIA, np.zeros(36), residual)
    assert start[0] == pytest.approx(0.15, rel=0.4)
    assert start[1] == pytest.approx(hz, abs=0.03)
    assert start[2] < 3.0 * damping


def test_added_mass_resists_acceleration_only():
    force = to_world(SAMPLES, applied("added_mass", [0.2])[:, 3:])
    np.testing.assert_allclose(force, -0.2 * SAMPLES.acceleration)


def test_mass_change_equals_a_heavier_load_later():
    heavier = INERTIA.copy()
    rate, late = 0.01, len(SAMPLES.time) - 1
    added = rate * SAMPLES.time[late]
    com = INERTIA[1:4] / INERTIA[0]
    heavier[0] += added
    heavier[1:4] += added * com
    cross = com @ com * np.eye(3) - np.outer(com, com)
    heavier[4:] += added * cross[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    needed = regressor(
        SAMPLES.specific_acceleration, SAMPLES.angular_velocity, SAMPLES.angular_acceleration
    )[late] @ (heavier - INERTIA)
    np.testing.assert_allclose(applied("mass_change", [rate])[late], -needed, atol=1e-12)


def test_tilted_gravity_equals_motion_in_a_tilted_world():
    angle = np.array([0.05, -0.03, 0.0])
    tilted = replace(SAMPLES, gravity=exp_so3(angle) @ SAMPLES.gravity)
    plain, other = (
        regressor(s.specific_acceleration, s.angular_velocity, s.angular_acceleration) @ INERTIA
        for s in (SAMPLES, tilted)
    )
    np.testing.assert_allclose(applied("gravity_tilt", angle[:2]), plain - other, atol=1e-12)


def test_torsion_resists_spin_and_is_bounded_by_normal_force():
    wrench = applied("contact_torsion", [0.01, 0.05])
    assert np.all(np.einsum("ni,ni->n", wrench[:, :3], SAMPLES.angular_velocity) <= 1e-12)
    normal = np.einsum("nci,nci->nc", SAMPLES.contact_rotation[..., 2], SAMPLES.contact_force)
    bound = 0.01 * np.maximum(normal, 0.0).sum(axis=1)
    assert np.all(np.linalg.norm(wrench[:, :3], axis=1) <= bound + 1e-12)


def corrected(**changes):
    """Wrench of corrected readings minus that of the readings."""
    return replace(SAMPLES, **changes).measured_wrench - SAMPLES.measured_wrench


def test_sensor_effects_give_back_the_true_forces():
    force = SAMPLES.contact_force.copy()
    force[:, 1] -= [0.3, -0.1, 0.2]
    found = create_effect("force_bias:middle").wrench(SAMPLES, INERTIA, np.array([0.3, -0.1, 0.2]))
    np.testing.assert_allclose(found, corrected(contact_force=force), atol=1e-12)
    force = SAMPLES.contact_force.copy()
    force[:, 3] /= 1.25
    found = create_effect("force_scale:thumb").wrench(SAMPLES, INERTIA, np.array([0.25]))
    np.testing.assert_allclose(found, corrected(contact_force=force), atol=1e-12)
    point = SAMPLES.contact_point - np.array([0.002, 0.0, -0.003])
    found = create_effect("contact_offset:common").wrench(
        SAMPLES, INERTIA, np.array([0.002, 0.0, -0.003])
    )
    np.testing.assert_allclose(found, corrected(contact_point=point), atol=1e-12)


def test_a_gain_of_all_fingers_is_a_mass_and_corrects_nothing():
    scale = create_effect("force_scale")
    common = scale.wrench(SAMPLES, INERTIA, np.full(4, 14.0))
    np.testing.assert_allclose(common, 0.0, atol=1e-12)
    gain = np.array([0.3, -0.1, 0.0, 0.2])
    share = 1.0 / (1.0 + gain)
    force = SAMPLES.contact_force * (share / share.mean())[:, None]
    found = scale.wrench(SAMPLES, INERTIA, gain)
    np.testing.assert_allclose(found, corrected(contact_force=force), atol=1e-12)


@pytest.mark.parametrize(
    ("label", "value"), [("sensor_lag", 0.12), ("time_offset:body", 0.08), ("time_offset", -0.08)]
)
def test_the_screening_basis_of_timing_effects_holds_large_ones(label, value):
    effect = create_effect(label)
    wrench = effect.wrench(SAMPLES, INERTIA, np.array([value])).ravel()
    basis = effect.screening_basis(SAMPLES, INERTIA).reshape(len(wrench), -1)
    coefficients = np.linalg.lstsq(basis, wrench, rcond=None)[0]
    left = np.linalg.norm(wrench - basis @ coefficients) / np.linalg.norm(wrench)
    slope_only = basis[:, :1] @ np.linalg.lstsq(basis[:, :1], wrench, rcond=None)[0]
    assert left < 0.5 * np.linalg.norm(wrench - slope_only) / np.linalg.norm(wrench)
    guess = effect.initial_guess(SAMPLES, INERTIA, coefficients, np.zeros((len(wrench) // 6, 6)))
    assert guess == pytest.approx([value], rel=0.3)


def test_sensor_rotation_turns_in_the_sensor_frame():
    angle = np.array([0.1, -0.05, 0.2])
    frame = SAMPLES.contact_rotation[:, 0]
    force = SAMPLES.contact_force.copy()
    force[:, 0] = np.einsum(
        "nij,jk,nlk,nl->ni", frame, exp_so3(-angle), frame, SAMPLES.contact_force[:, 0]
    )
    found = create_effect("sensor_rotation:index").wrench(SAMPLES, INERTIA, angle)
    np.testing.assert_allclose(found, corrected(contact_force=force), atol=1e-12)


def test_timing_effects_undo_a_delay_and_a_lag():
    """Readings delayed or lagged by construction are balanced after correction."""
    truth = SAMPLES.contact_force
    late = np.concatenate([np.repeat(truth[:1], 3, axis=0), truth[:-3]])
    lagged, _ = first_order_lag(SAMPLES.time, truth, 0.05)
    load = SAMPLES.measured_wrench
    inner = slice(30, -30)
    for effect, theta, force in (
        ("time_offset:body", 0.03, late),
        ("sensor_lag", 0.05, lagged),
    ):
        samples = replace(SAMPLES, contact_force=force)
        delta = create_effect(effect).wrench(samples, INERTIA, np.array([theta]))
        before = np.abs(samples.measured_wrench - load)[inner].max()
        after = np.abs(samples.measured_wrench + delta - load)[inner].max()
        assert after < 0.02 * before


def test_forces_that_lead_are_no_lag():
    for label in ("sensor_lag", "sensor_lag:sensor", "sensor_lag:world"):
        effect = create_effect(label)
        assert not effect.wrench(SAMPLES, INERTIA, np.array([-0.005])).any()
        assert effect.wrench(SAMPLES, INERTIA, np.array([0.005])).any()


def test_world_frame_lag_and_offset():
    world = np.einsum("nij,ncj->nci", SAMPLES.rotation, SAMPLES.contact_force)
    late = np.concatenate([np.repeat(world[:1], 3, axis=0), world[:-3]])
    lagged, _ = first_order_lag(SAMPLES.time, world, 0.05)
    load = SAMPLES.measured_wrench
    for effect, theta, force in (
        ("time_offset", 0.03, late),
        ("sensor_lag:world", 0.05, lagged),
    ):
        back = np.einsum("nji,ncj->nci", SAMPLES.rotation, force)
        samples = replace(SAMPLES, contact_force=back)
        delta = create_effect(effect).wrench(samples, INERTIA, np.array([theta]))
        inner = slice(30, -30)
        before = np.abs(samples.measured_wrench - load)[inner].max()
        after = np.abs(samples.measured_wrench + delta - load)[inner].max()
        assert after < 0.03 * before


def test_one_finger_that_was_put_elsewhere_shows_the_axes_of_its_sensor():
    """A bias turns with the sensor of a finger that moves half-way; the others stay."""
    rotation = np.broadcast_to(SAMPLES.contact_rotation[:1], SAMPLES.contact_rotation.shape).copy()
    still = replace(SAMPLES, contact_rotation=rotation)
    rotation = rotation.copy()
    rotation[len(rotation) // 2 :, 1] = rotation[0, 1] @ exp_so3(np.array([0.0, 0.0, 0.8]))
    put_elsewhere = replace(SAMPLES, contact_rotation=rotation)
    bias = create_effect("force_bias")
    assert [effect.reading for effect in bias.readings(still)] == [""]
    assert [effect.reading for effect in bias.readings(put_elsewhere)] == ["", "@sensor"]


def test_unknown_names_and_readings_are_refused():
    with pytest.raises(BadInputError, match="viscous_drag"):
        create_effect("viscus_drag")
    with pytest.raises(BadInputError, match="world"):
        create_effect("sensor_lag:moon")
    with pytest.raises(BadInputError, match="thumb"):
        create_effect("force_bias:toe").wrench(SAMPLES, INERTIA, np.zeros(3))


class WrongDrag(LinearEffect):
    name = "wrong_drag"
    family = "user"
    formula = "f = -c v"
    looks_like = "A force."
    remedy = "None."

    def parameters(self, samples):
        return (EffectParameter("c", "N s/m", 1.0, "drag"),)

    def jacobian(self, samples, inertia, theta):
        world = -samples.velocity
        return np.concatenate([np.zeros_like(world), world], axis=1)[..., None]


def test_check_effect_finds_a_forgotten_change_of_frame():
    report = check_effect(WrongDrag())
    assert not report.passed
    assert "choice of" in str(report)


def test_check_effect_finds_a_wrong_jacobian():
    class Wrong(type(create_effect("hanging_cable"))):
        def jacobian(self, samples, inertia, theta):
            return 2.0 * super().jacobian(samples, inertia, theta)

    assert "finite differences" in str(check_effect(Wrong()))


def test_check_effect_finds_wrong_factors_of_a_jacobian():
    class Wrong(type(create_effect("sensor_rotation"))):
        def factored(self, samples, theta):
            columns, weights = super().factored(samples, theta)
            return columns, 2.0 * weights

    assert "factored" in str(check_effect(Wrong()))


def test_check_effect_finds_wrong_coefficients():
    class Wrong(type(create_effect("hanging_cable"))):
        def coefficients(self, samples, theta):
            return 2.0 * super().coefficients(samples, theta)

    assert "coefficients" in str(check_effect(Wrong()))


def test_what_is_remembered_of_a_motion_is_shared_by_other_forces_only():
    samples = example_samples()
    pressed = samples.with_forces(2.0 * samples.contact_force)
    assert load_regressor(pressed) is load_regressor(samples)
    turned = replace(pressed, angular_velocity=2.0 * samples.angular_velocity)
    assert not np.allclose(load_regressor(turned), load_regressor(samples))


def test_an_effect_of_forces_has_to_say_what_it_is():
    class Crosstalk(LinearEffect):
        name, formula, looks_like, remedy = "mine", "a f", "a gain", "none"

        def parameters(self, samples):
            return (EffectParameter("a", "1", 0.1, "share"),)

        def jacobian(self, samples, inertia, theta):
            return samples.measured_wrench[..., None]

    assert "external" in str(check_effect(Crosstalk()))
    Crosstalk.external = False
    assert check_effect(Crosstalk()).passed


def test_whole_numbers_are_parameters_as_well():
    """Whoever writes 2 Hz means 2.0 Hz, also where a response is remembered by its parameters."""
    whole = np.array([1, 2, 1, 0, 0, 0])
    expected = applied("sloshing_mass", whole)
    found = create_effect("sloshing_mass").wrench(SAMPLES, INERTIA, whole)
    assert np.abs(expected).max() > 0.0
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("label", "theta"),
    [
        ("contact_offset:common", [0.4, 0.0, 0.0]),
        ("sloshing_mass", [-0.05, 2.0, 0.1, 0.0, 0.0, 0.0]),
        ("sloshing_mass", [0.05, -0.39, 0.1, 0.0, 0.0, 0.0]),
        ("force_scale", [-1.1, 0.0, 0.0, 0.0]),
    ],
)
def test_offsets_of_metres_and_the_like_cannot_be(label, theta):
    effect, possible = create_effect(label), 0.05 * np.abs(theta)
    assert not effect.is_possible(SAMPLES, INERTIA, np.array(theta))
    assert effect.is_possible(SAMPLES, INERTIA, possible)


def test_damping_beyond_any_ringing_is_no_sloshing():
    effect = create_effect("sloshing_mass")
    theta = np.array([0.1, 3.0, 1.5, 0.0, 0.0, 0.0])
    assert effect.is_possible(SAMPLES, INERTIA, theta)
    assert not effect.is_possible(SAMPLES, INERTIA, theta + [0.0, 0.0, 10.0, 0.0, 0.0, 0.0])
