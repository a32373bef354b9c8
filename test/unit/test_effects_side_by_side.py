"""Effects beside sensors that are late: what the forces show of a drag is as late as the load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.effects.cases import Case
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.effects.check import example_inertia, example_samples
from tactile_dynamics_ros.core.effects.held.gravity import load_regressor
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

SAMPLES, INERTIA = example_samples(), example_inertia()
SETS = [
    (("sensor_lag", [0.05]), ("viscous_drag", [2.0])),
    (("time_offset:sensor", [0.037]), ("added_mass", [0.1])),
    (("time_offset:contact", [-0.033]), ("force_bias:thumb", [0.3, -0.2, 0.1])),
    (("sensor_lag", [0.05]), ("gravity_tilt", [0.05, -0.03]), ("mass_change", [0.02])),
    (("sensor_lag:world", [0.08]), ("time_offset", [0.018]), ("rotational_drag", [0.05])),
]


def present(chosen):
    effects = tuple(create_effect(label) for label, _ in chosen)
    return PresentEffects(effects, tuple(np.array(theta) for _, theta in chosen))


def test_added_mass_beside_a_shifted_clock_leaves_white_noise():
    """The noise of the motion that acts on the added mass is that of the shifted motion."""
    names = ("time_offset", "added_mass")
    recording = generate(313, dict.fromkeys(names, 4.0), ScenarioOptions(duration=12.0))
    fitted = fit_with_readings(recording.streams, tuple(map(create_effect, names)))
    assert 0.97 < fitted.whitened_rms < 1.03


@pytest.mark.parametrize("chosen", SETS)
def test_derivatives_are_those_of_the_sum(chosen):
    both = present(chosen)
    jacobians = both.jacobians(SAMPLES, INERTIA)
    for index, theta in enumerate(both.theta):
        for k in range(len(theta)):
            step, moved = 1e-6 * np.eye(len(theta))[k], []
            for sign in (1.0, -1.0):
                parts = [t + sign * step if i == index else t for i, t in enumerate(both.theta)]
                moved.append(PresentEffects(both.effects, parts).wrench(SAMPLES, INERTIA))
            slope = (moved[0] - moved[1]) / 2e-6
            np.testing.assert_allclose(jacobians[index][..., k], slope, atol=2e-5)
    by_phi = np.sum(both.inertia_jacobians(SAMPLES, INERTIA), axis=0)
    for k, step in enumerate(1e-6 * np.eye(10)):
        change = both.wrench(SAMPLES, INERTIA + step) - both.wrench(SAMPLES, INERTIA - step)
        np.testing.assert_allclose(by_phi[..., k], change / 2e-6, atol=2e-5)


def test_noise_of_the_motion_acts_on_added_mass_too():
    """A fluid that weighs many times the object leaves white noise, and its mass is measured."""
    options = Case("calm", ("added_mass",), 2.0, 351).scenario()
    recording = generate(351, {"added_mass": 95.0}, replace(options, duration=15.0))
    fitted = fit_with_readings(recording.streams, (create_effect("added_mass"),))
    truth = recording.truth()["effects"]["added_mass"]["parameters"]["mass"]["value"]
    assert truth > 5.0 * fitted.phi[0]
    assert fitted.theta[0][0] == pytest.approx(truth, rel=0.03)
    assert 0.95 < fitted.whitened_rms < 1.05


def test_late_forces_show_a_drag_late():
    """Forces that lag behind load and drag leave nothing once both effects are known."""
    time, tau = SAMPLES.time, 0.05
    drag = create_effect("viscous_drag").wrench(SAMPLES, INERTIA, np.array([2.0]))
    borne = load_regressor(SAMPLES) @ INERTIA - drag
    late, step = borne.copy(), time[1] - time[0]
    for k in range(1, len(time)):
        late[k] = late[k - 1] + (1 - np.exp(-step / tau)) * (
            0.5 * (borne[k] + borne[k - 1]) - late[k - 1]
        )
    still = SAMPLES.with_forces(np.zeros_like(SAMPLES.contact_force))
    both = present((("sensor_lag", [tau]), ("viscous_drag", [2.0])))
    shown = load_regressor(SAMPLES) @ INERTIA - both.wrench(still, INERTIA)
    apart = load_regressor(SAMPLES) @ INERTIA - sum(
        e.wrench(still, INERTIA, t) for e, t in zip(both.effects, both.theta, strict=True)
    )
    size = np.abs(late - borne).max()
    assert np.abs(shown - late).max() < 0.01 * size
    assert np.abs(apart - late).max() > 0.02 * size


def test_an_effect_beside_late_sensors_is_measured():
    recording = generate(
        312, {"sensor_lag": 4.0, "added_mass": 4.0}, ScenarioOptions(duration=12.0)
    )
    fitted = fit_with_readings(
        recording.streams, (create_effect("sensor_lag"), create_effect("added_mass"))
    )
    truth = recording.truth()["effects"]
    found = {
        effect.name: theta[0] for effect, theta in zip(fitted.effects, fitted.theta, strict=True)
    }
    lag, mass = (truth[name]["parameters"] for name in ("sensor_lag", "added_mass"))
    alone = generate(312, {"sensor_lag": 4.0}, ScenarioOptions(duration=12.0))
    left_alone = fit_with_readings(alone.streams, (create_effect("sensor_lag"),)).whitened_rms
    assert left_alone < 1.03
    assert fitted.whitened_rms < 1.01 * left_alone
    assert found["sensor_lag"] == pytest.approx(lag["time_constant"]["value"], rel=0.02)
    assert found["added_mass"] == pytest.approx(mass["mass"]["value"], rel=0.02)


def test_effects_that_hide_each_other_are_found():
    """Either of them alone explains a fifth of the error only."""
    recording = generate(
        313, {"time_offset": 2.2, "viscous_drag": 0.85}, ScenarioOptions(duration=12.0)
    )
    diagnosis = diagnose(HeldObjectModel.from_fit(fit_with_readings(recording.streams, ())))
    assert {step.name for step in diagnosis.steps} == {"time_offset", "viscous_drag"}
    assert diagnosis.verdict == "missing_effect"
    assert diagnosis.steps[-1].after.rms < 1.03


def test_what_was_removed_no_longer_makes_others_late():
    """Screening foresees what a refit gains, whatever the thorough fit behind it contained."""
    recording = generate(
        312, {"sensor_lag": 4.0, "viscous_drag": 3.0}, ScenarioOptions(duration=6.0)
    )
    names = ("sensor_lag", "viscous_drag")
    both = fit_with_readings(recording.streams, [create_effect(name) for name in names])
    model = HeldObjectModel.from_fit(both).without_effect("viscous_drag")
    [score] = screen(model, model.families(["viscous_drag"]))
    fitted = model.with_effect(score.family, score.coefficients)
    gain = model.residual @ model.residual - fitted.residual @ fitted.residual
    assert score.gain == pytest.approx(gain, rel=0.1)
    bare = model.without_effect("sensor_lag")
    [plain] = screen(bare, bare.families(["viscous_drag"]))
    drag = create_effect("viscous_drag")
    columns = bare.whitening.family_columns(drag, PresentEffects())
    np.testing.assert_array_equal(plain.family.columns, columns)
    beside = both.effects[0], both.theta[0]
    assert not np.array_equal(
        columns, bare.whitening.family_columns(drag, PresentEffects(*([x] for x in beside)))
    )


def test_an_offset_of_one_finger_is_not_spread_over_others():
    """Signals denoised with offsets of two fingers make both look significant."""
    recording = Case("single", ("contact_offset",), 1.35, 15000).record()
    diagnosis = diagnose(HeldObjectModel.from_fit(fit_with_readings(recording.streams)))
    assert diagnosis.effect == "contact_offset"
    assert diagnosis.steps[0].choice.best.label == "contact_offset:middle"


def test_an_offset_is_found_though_offsets_of_all_contacts_drown_in_noise():
    """The reading for all contacts makes so much noise that it is none; that of one is it."""
    recording = Case("single", ("contact_offset",), 1.35, 42000, duration=22.0).record()
    diagnosis = diagnose(HeldObjectModel.from_fit(fit_with_readings(recording.streams)))
    assert diagnosis.effect == "contact_offset"
    assert diagnosis.steps[0].choice.best.label == "contact_offset:middle"
