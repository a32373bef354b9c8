"""The held object under the diagnosis: effects are added to and taken from a fitted model."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.trials import square, try_effect
from tactile_dynamics_ros.core.effects.registry import create_effect, registered_names
from tactile_dynamics_ros.core.inertia.batch.batch import fit_body
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.quick_fit import (
    ExtendedSystem,
    FactoredSystem,
    extended_system,
)
from tactile_dynamics_ros.core.inertia.diagnosis.twins import imitators
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions


@pytest.fixture(scope="module")
def tethered() -> HeldObjectModel:
    """With the spring that pulls at an object in a tilted world, but without the tilt."""
    options = ScenarioOptions(duration=6.0)
    recording = generate(328, {"tether_spring": 0.36, "gravity_tilt": 2.5}, options)
    model = HeldObjectModel.from_fit(fit_body(recording.streams))
    scores = screen(model, model.families(["tether_spring"]))
    return try_effect(model, scores, "tether_spring", 1.0).model.refined()


def white_rms(model: HeldObjectModel) -> float:
    return float(np.sqrt(np.mean(model.residual**2)))


def test_an_effect_that_moves_the_present_ones_far_is_fitted_jointly(tethered):
    score = screen(tethered, tethered.families(["gravity_tilt"]))[0]
    both = tethered.with_effect(score.family, score.coefficients)
    assert white_rms(tethered) > 1.15
    assert white_rms(both) < 1.05


def test_a_model_is_gone_with_its_last_name():
    """Each holds a hundred megabytes, and the collector of cycles may not come for long."""
    recording = generate(328, {"tether_spring": 0.36}, ScenarioOptions(duration=4.0))
    gc.collect()
    gc.disable()
    try:
        model = HeldObjectModel.from_fit(fit_body(recording.streams))
        scores = screen(model, model.families(["tether_spring"]))
        added = try_effect(model, scores, "tether_spring", 1.0).model
        left = [weakref.ref(each.fitted.stretches[0]) for each in (model, added)]
        del model, scores, added
        assert [each() for each in left] == [None, None]
    finally:
        gc.enable()


def test_an_effect_is_taken_away_again(tethered):
    score = screen(tethered, tethered.families(["gravity_tilt"]))[0]
    both = tethered.with_effect(score.family, score.coefficients)
    left = both.without_effect("gravity_tilt")
    assert left.effect_names == ("tether_spring",)
    assert white_rms(left) == pytest.approx(white_rms(tethered), rel=0.02)


@pytest.mark.parametrize(
    "name", ["hanging_cable", "unsensed_contact", "force_bias", "force_scale", "sensor_rotation"]
)
def test_few_rows_say_the_same_as_all_of_them(tethered, name):
    """Cost, gradient and information of an effect with fixed columns beside a spring."""
    effect = create_effect(name)
    few, every = extended_system(tethered, effect), ExtendedSystem(tethered, effect)
    assert isinstance(few, FactoredSystem)
    theta = 0.3 * effect.typical(tethered.samples)
    point = np.concatenate([1e-3 * np.ones(every.present), theta])
    assert few.square(point) == pytest.approx(every.square(point), rel=1e-9)
    (short, by_short), (whole, by_whole) = few.evaluate(point), every.evaluate(point)
    scale = np.linalg.norm(by_whole, axis=0)
    for found, expected in (
        (by_short.T @ short / scale, by_whole.T @ whole / scale),
        (
            by_short.T @ by_short / np.outer(scale, scale),
            by_whole.T @ by_whole / np.outer(scale, scale),
        ),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)


def test_readings_that_are_screened_alike_have_the_same_basis(tethered):
    shared = 0
    for name in registered_names():
        seen: dict[str, np.ndarray] = {}
        for reading in create_effect(name).readings(tethered.samples):
            basis = reading.screening_basis(tethered.samples, tethered.phi)
            known = seen.setdefault(reading.screened_as, basis)
            np.testing.assert_array_equal(basis, known)
            shared += known is not basis
    assert shared >= 3


def test_a_joint_fit_starts_where_the_present_effects_were(monkeypatch):
    """A spring with a rest length is hardly determined: its linear change leads far off."""
    recording = generate(361, {"magnetic_pull": 3.0}, ScenarioOptions(duration=6.0))
    model = HeldObjectModel.from_fit(fit_body(recording.streams))
    springs = screen(model, model.families(["tether_spring"]))
    [spring] = [score for score in springs if score.family.label.endswith("rest_length")]
    present = model.with_effect(spring.family, spring.coefficients)
    starts, fit = [], HeldObjectModel.fitted_from

    def watched(self, effects, theta):
        starts.append(square(self))
        return fit(self, effects, theta)

    monkeypatch.setattr(HeldObjectModel, "fitted_from", watched)
    for score in screen(present, present.families(["added_mass", "time_offset"])):
        both = present.with_effect(score.family, score.coefficients)
        assert square(both) < square(present)
    assert len(starts) >= 3
    assert max(starts) < 2.0 * square(present)


def test_a_pull_straight_up_at_the_centre_of_mass_may_be_fluid():
    """Body m with added mass m_a is body m + m_a with the pull m_a g at its centre of mass."""
    phi = np.concatenate([[0.23, 0.02, -0.008, 0.007], np.full(6, 1e-3)])
    centre, spread = phi[1:4] / phi[0], np.diag(np.full(16, 1e-6))
    upward = np.concatenate([[0.0005, -0.0004, 1.13], centre + 5e-4])
    assert imitators("hanging_cable", phi, {"hanging_cable": upward}, spread) == ("added_mass",)
    for change in (np.eye(6)[0] * 0.01, np.eye(6)[5] * 0.02, -np.eye(6)[2] * 2.3):
        pulls = {"hanging_cable": upward + change}
        assert imitators("hanging_cable", phi, pulls, spread) == ()
    level = np.concatenate([[0.1, 0.05, 0.0125 / (2.0 * 0.23 * 9.81)], centre])
    pulls = {"viscous_drag": np.ones(1), "hanging_cable": level}
    exact = np.diag(np.full(17, 1e-8))
    assert imitators("hanging_cable", phi, pulls, exact) == ("gravity_tilt",)
    assert imitators("viscous_drag", phi, {"viscous_drag": np.ones(1)}, np.eye(11)) == ()
