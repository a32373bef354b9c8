"""The contract of models holds for ours, and each fault that is planted breaks it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from benchmarks.friction.generator import draw_surface, generate_events
from tactile_dynamics_ros.core.discrepancy.model.check import check_residual_model
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
from tactile_dynamics_ros.core.friction.effects import Adhesion
from tactile_dynamics_ros.core.friction.slip_log import tabulate_slips
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions


@pytest.fixture(scope="module")
def slips():
    return tabulate_slips(generate_events(draw_surface("skin_creep", 501), 501))


@pytest.fixture(scope="module")
def friction(slips):
    return FrictionModel.fit(slips, ["adhesion"])


def test_the_friction_of_a_probe_keeps_the_contract(slips, friction):
    assert str(check_residual_model(FrictionModel.fit(slips))).endswith("all requirements hold")
    assert check_residual_model(friction).passed


def test_a_held_object_keeps_the_contract():
    """With an effect that delays and one that does not, and effects of every kind tried beside."""
    recording = generate(328, {"tether_spring": 0.36, "sensor_lag": 0.01}, options())
    model = HeldObjectModel.from_fit(fit_recording(recording.streams, ())).refined()
    names = ["viscous_drag", "sloshing_mass", "added_mass", "force_scale", "time_offset"]
    assert str(check_residual_model(model, names)).endswith("all requirements hold")
    lagging = model.with_effect(*first_family(model, "sensor_lag"))
    assert check_residual_model(lagging, ["tether_spring"]).failures == ()


def options():
    return ScenarioOptions(duration=6.0)


def first_family(model, name):
    family = model.families([name])[0]
    return family, np.zeros(family.columns.shape[1])


def planted(model, **members):
    """The same model with members of the class replaced."""
    kind = type("Planted", (FrictionModel,), members)
    return kind(**{field.name: getattr(model, field.name) for field in fields(model)})


def wrong_derivative(self, x, effects):
    residual, jacobian = FrictionModel.evaluate(self, x, effects)
    return residual, jacobian * np.where(np.arange(len(x)) == 1, 1.02, 1.0)


def residual_of_another_noise(self, x, effects):
    residual, jacobian = FrictionModel.evaluate(self, x, effects)
    return 1.1 * residual, 1.1 * jacobian


def whiten_too_little(self, rows):
    return 0.9 * FrictionModel.whiten(self, rows)


def whiten_one_channel_too_much(self, rows):
    white = np.array(FrictionModel.whiten(self, rows))
    white[1::2] *= 1.1
    return white


def forget_what_slips_share(self, rows):
    shape = (-1, *[1] * (rows.ndim - 1))
    own = self.noise.scatter(self.whitening_mu, self.slips)
    return rows / own.reshape(shape) / np.sqrt(3.9)


def forget_the_tilt(self, rows):
    alone = replace(self, noise=replace(self.noise, tilt_std_deg=0.0))
    return FrictionModel.whiten(alone, rows)


def families_of_something_else(self, name):
    return [
        replace(family, columns=np.roll(family.columns[::-1], 7, axis=0))
        for family in FrictionModel.families_of(self, name)
    ]


def no_families(self, name):
    return []


def refuse_to_fit(self, family, coefficients):
    return self


def never_forget(self, name):
    return self


def fit_at_random(self, family, coefficients):
    fitted = FrictionModel.with_effect(self, family, coefficients)
    moved = fitted.mu * (1.0 + 1e-6 * np.random.default_rng().normal(size=2))
    return fitted.with_parameters(moved, fitted.effects, fitted.theta)


def parameters_without_prior(self, effect):
    return tuple(replace(p, prior_std=0.0) for p in FrictionModel.parameters_of(self, effect))


def parameters_of_one_name(self, effect):
    return tuple(replace(p, name="p") for p in FrictionModel.parameters_of(self, effect))


def raise_of_it(self, name):
    raise KeyError(name)


FAULTS = [
    ({"evaluate": wrong_derivative}, "jacobian of the model, column 1"),
    ({"evaluate": residual_of_another_noise}, "residual differs from whiten(lack)"),
    ({"whiten": whiten_too_little}, "own noise has variance 0.8"),
    ({"whiten": whiten_one_channel_too_much}, "in channel 1"),
    ({"whiten": forget_what_slips_share}, "is correlated by"),
    ({"whiten": forget_the_tilt}, "own noise has variance"),
    ({"families_of": families_of_something_else}, "its family leaves"),
    ({"families_of": no_families}, "has no family"),
    ({"with_effect": refuse_to_fit}, "the model that was fitted with it has"),
    ({"without_effect": never_forget}, "is still there after without_effect"),
    ({"with_effect": fit_at_random}, "not deterministic"),
    ({"parameters_of": parameters_without_prior}, "expected a positive number"),
    ({"parameters_of": parameters_of_one_name}, "parameter names repeat"),
    ({"sentence": lambda self, name: ""}, "sentence is empty"),
    ({"sentence": raise_of_it}, "raised KeyError"),
    ({"time": property(lambda self: FrictionModel.time.func(self)[::-1])}, "time decreases"),
    ({"measured": property(lambda self: self.slips.tangential[:, 0])}, "raised ValueError"),
]


@pytest.mark.parametrize(("members", "line"), FAULTS, ids=[line for _, line in FAULTS])
def test_a_planted_fault_is_found(friction, members, line):
    names = ["load_dependent_friction", "anisotropic_friction"]
    report = check_residual_model(planted(friction, **members), names)
    assert line in str(report)


def test_an_effect_that_is_there_at_zero_is_found(slips, monkeypatch):
    monkeypatch.setattr(Adhesion, "factor", lambda self, slips, theta: 1.01 + 0.0 * slips.normal)
    report = check_residual_model(FrictionModel.fit(slips), ["adhesion"])
    assert "adhesion: changes the residual at theta = 0" in report.failures


def test_an_effect_whose_term_bends_unseen_by_its_family_is_found(slips, monkeypatch):
    """A law that acts only far from zero has nothing of it in its linear form."""

    def far(self, slips, mu, theta):
        size = theta[0] if abs(theta[0]) > 0.01 else 0.0
        return size * np.outer(np.sin(9.0 * slips.angle), [1.0, 1.0])

    monkeypatch.setattr(Adhesion, "term", far)
    report = check_residual_model(FrictionModel.fit(slips), ["adhesion"])
    assert any("adhesion: its family leaves" in line for line in report.failures)


def test_a_parameter_states_what_checks_need():
    assert EffectParameter("c", "N", 2.0, "size").typical == pytest.approx(0.4)
