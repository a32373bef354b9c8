"""The generator of recordings with hidden effects obeys mechanics and its own promises."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.synthetic import (
    CATALOGUE,
    OUTSIDE,
    Scenario,
    ScenarioOptions,
    SensorOptions,
    create_hidden_effect,
    generate,
    generate_at_whitened_rms,
)
from tactile_dynamics_ros.synthetic.grasp import friction_margin

SHORT = ScenarioOptions(duration=6.0, regrasp=True, contact_breaks=1)
QUIET = SensorOptions(force_std=0.0, position_std=0.0, rotation_std_deg=0.0)


@pytest.fixture(scope="module")
def truth():
    return Scenario.draw(5, SHORT).simulate()


def test_derivatives_match_finite_differences():
    scenario = Scenario.draw(3)
    step = 1e-5
    before, now, after = (
        scenario.motion.evaluate(np.linspace(1.0, 9.0, 50) + shift) for shift in (-step, 0.0, step)
    )
    velocity = (after.position - before.position) / (2 * step)
    acceleration = (after.velocity - before.velocity) / (2 * step)
    turned = Rotation.from_matrix(after.rotation @ before.rotation.transpose(0, 2, 1))
    angular_acceleration = (after.angular_velocity - before.angular_velocity) / (2 * step)
    assert velocity == pytest.approx(now.velocity, abs=1e-7)
    assert acceleration == pytest.approx(now.acceleration, abs=1e-6)
    assert turned.as_rotvec() / (2 * step) == pytest.approx(now.angular_velocity, abs=1e-6)
    assert angular_acceleration == pytest.approx(now.angular_acceleration, abs=1e-5)


def test_contacts_balance_inertia(truth):
    assert np.abs(truth.imbalance()).max() < 1e-10


def test_contacts_balance_the_regressor_of_the_package(truth):
    scene, body = truth.scene, truth.scene.body
    motion = scene.motion
    model = regressor(
        motion.to_body(motion.acceleration - scene.gravity),
        motion.to_body(motion.angular_velocity),
        motion.to_body(motion.angular_acceleration),
    )
    parameters = InertialParameters(body.mass, body.com, body.inertia_com).dynamic_parameters
    torque = np.cross(scene.contacts.point, truth.contact_force).sum(1)
    applied = np.concatenate([torque, truth.contact_force.sum(1)], axis=1)
    assert applied == pytest.approx(model @ parameters, abs=1e-10)


@pytest.mark.parametrize("name", CATALOGUE + OUTSIDE)
def test_dynamics_hold_with_every_effect(name):
    scenario = Scenario.draw(11, ScenarioOptions(duration=4.0))
    truth = scenario.simulate((create_hidden_effect(name, 1.0, 11, scenario),))
    assert np.abs(truth.imbalance()).max() < 1e-10


@pytest.mark.parametrize("name", CATALOGUE + OUTSIDE)
def test_effect_is_seen_when_on_and_absent_at_zero(name):
    options = ScenarioOptions(duration=4.0)
    clean = _numbers(generate(11, {}, options))
    assert _equal(_numbers(generate(11, {name: 0.0}, options)), clean)
    assert not _equal(_numbers(generate(11, {name: 1.0}, options)), clean)


def test_grip_stays_inside_the_friction_cones():
    for seed in range(5):
        truth = Scenario.draw(seed).simulate(stride=20)
        margin = friction_margin(truth.scene.contacts, truth.contact_force)
        assert np.mean(margin < 0) < 0.02


def test_lifted_finger_bears_nothing_and_sends_nothing(truth):
    lifted = truth.scene.contacts.weight == 0.0
    assert lifted.any()
    assert np.all(truth.contact_force[lifted] == 0.0)
    streams = generate(5, {}, SHORT).streams
    longest_silence = max(np.diff(contact.time).max() for contact in streams.contacts.values())
    assert longest_silence > 0.3


def test_regrasp_moves_three_fingers():
    contacts = Scenario.draw(5, SHORT).simulate(stride=10).scene.contacts
    moved = np.linalg.norm(contacts.point[-1] - contacts.point[0], axis=-1)
    assert np.sum(moved > 1e-4) == 3


def test_equal_seeds_give_equal_recordings():
    first, again, other = (
        _numbers(generate(seed, {"sloshing_mass": 1.0}, SHORT)) for seed in (8, 8, 9)
    )
    assert _equal(first, again)
    assert not _equal(first, other)


def test_noise_is_as_stated():
    quiet, noisy = generate(4, {}, sensors=QUIET).streams, generate(4).streams
    rotations = Rotation.from_matrix(noisy.pose.rotation @ quiet.pose.rotation.transpose(0, 2, 1))
    assert np.degrees(rotations.as_rotvec().std()) == pytest.approx(0.2, rel=0.03)
    assert (noisy.pose.position - quiet.pose.position).std() == pytest.approx(5e-4, rel=0.03)
    stated = np.sqrt(np.diagonal(noisy.pose.covariance[0]))
    assert stated == pytest.approx(np.repeat([np.radians(0.2), 5e-4], 3))
    for name, contact in noisy.contacts.items():
        error = contact.force - quiet.contacts[name].force
        assert error.std() == pytest.approx(0.03, rel=0.04)
        assert np.all(contact.force_std == 0.03)


def test_sensor_options_change_stamps_and_statements():
    options = SensorOptions(force_rate_hz=50.0, stagger=True, pose_gaps=4, state_force_std=False)
    streams = generate(4, {}, SHORT, options).streams
    starts = {contact.time[0] for contact in streams.contacts.values()}
    assert len(starts) > 1
    assert np.diff(streams.pose.time).max() > 0.03
    for contact in streams.contacts.values():
        assert contact.force_std is None
        assert np.median(np.diff(contact.time)) == pytest.approx(0.02)


def test_time_offset_moves_stamps_only():
    seed = next(s for s in range(20) if _offset_reading(s) == "forces")
    clean, late = generate(seed, {}, SHORT), generate(seed, {"time_offset": 1.0}, SHORT)
    offset = late.effects[0].parameters["offset"].value
    shift = late.streams.contacts["index"].time - clean.streams.contacts["index"].time
    assert abs(offset) == pytest.approx(0.01)
    assert shift == pytest.approx(offset)
    assert np.array_equal(late.streams.pose.time, clean.streams.pose.time)


def test_size_for_a_whitened_error_grows_with_the_target():
    sizes = [
        generate_at_whitened_rms(2, {"viscous_drag": target}).effects[0].magnitude
        for target in (1.0, 1.3, 2.0, 4.0)
    ]
    assert sizes[0] == 0.0
    assert sizes[2] / sizes[1] == pytest.approx(np.sqrt(3.0 / 0.69), rel=0.05)
    assert sizes[3] / sizes[2] == pytest.approx(np.sqrt(5.0), rel=0.05)


def _offset_reading(seed):
    return create_hidden_effect("time_offset", 1.0, seed, Scenario.draw(seed, SHORT)).reading


def _numbers(recording):
    streams = recording.streams
    arrays = [streams.pose.time, streams.pose.position, streams.pose.rotation]
    for contact in streams.contacts.values():
        arrays += [contact.time, contact.pose_time, contact.force, contact.position]
    return arrays


def _equal(first, second):
    return all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
