"""Effects that act only in a regime: written, gated, found, bounded, or not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from benchmarks.friction.generator import draw_surface, generate_events
from benchmarks.local_terms import CASES, TRUE, ScalarModel, ask, make
from benchmarks.support.regimes import acts_at, generate_in_regime
from tactile_dynamics_ros.core.discrepancy.comparison import compare
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.discrepancy.regimes.search import RegimeSearch
from tactile_dynamics_ros.core.effects.check import example_samples
from tactile_dynamics_ros.core.effects.registry import create_effect, create_effects
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
from tactile_dynamics_ros.core.friction.slip_log import tabulate_slips
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.numerics.regime import Regime, split_label
from tactile_dynamics_ros.synthetic import ScenarioOptions

DRAWS = 40


def fitted(motion) -> ScalarModel:
    return ScalarModel(motion, np.zeros(2)).refined()


@pytest.mark.parametrize("text", ["z<0.42", "load_index>3", "12<t<20", "z<0.42&speed>0.1"])
def test_a_regime_is_written_as_it_is_read(text):
    assert str(Regime.parse(text)) == text


@pytest.mark.parametrize("text", ["z=0.42", "20<t<12", "0.42", "z<1&x<1&y<1", "z<deep"])
def test_a_regime_that_cannot_be_read_is_refused(text):
    with pytest.raises(BadInputError, match="regime"):
        Regime.parse(text)


def test_a_label_has_the_regime_between_name_and_reading():
    plain, regime = split_label("tether_spring[12<t<20]:rest_length")
    assert (plain, str(regime)) == ("tether_spring:rest_length", "12<t<20")
    assert split_label("sensor_lag:world") == ("sensor_lag:world", None)


def test_a_gated_effect_is_the_effect_inside_and_nothing_outside():
    samples = example_samples(200)
    gate = float(np.median(samples.position[:, 2]))
    for name in ("viscous_drag", "tether_spring:rest_length", "force_scale:index"):
        plain = create_effect(name)
        head, _, reading = name.partition(":")
        label = f"{head}[z<{gate:.5g}]" + (f":{reading}" if reading else "")
        gated = create_effect(label)
        assert gated.label == label
        inside = samples.position[:, 2] < float(f"{gate:.5g}")
        assert 0 < inside.sum() < len(inside)
        theta, phi = plain.typical(samples), np.array([0.5, *np.zeros(9)])
        for law in ("wrench", "jacobian", "inertia_jacobian"):
            found, whole = (getattr(e, law)(samples, phi, theta) for e in (gated, plain))
            assert_array_equal(found[~inside], 0.0)
            assert_allclose(found[inside], whole[inside])


def test_sensors_are_not_late_in_a_regime_and_unknown_scalars_are_named():
    with pytest.raises(BadInputError, match="late everywhere"):
        create_effect("sensor_lag[t>3]")
    with pytest.raises(BadInputError, match="'depth' is unknown; there are t, x, y, z"):
        samples = example_samples(50)
        create_effect("viscous_drag[depth>3]").wrench(samples, np.ones(10), np.ones(1))
    both = create_effects(["viscous_drag", "viscous_drag[z<0.6]"])
    assert [effect.name for effect in both] == ["viscous_drag", "viscous_drag[z<0.6]"]


@pytest.mark.parametrize("case", [case for case in CASES if case != "none"])
def test_terms_of_a_scalar_system_are_found_where_they_act(case):
    found = ask(case, 7)
    named = sorted(split_label(name)[0] for name in found["effects"])
    assert named == sorted(split_label(name)[0] for name, _ in CASES[case])
    assert found["f1"] > 0.98
    assert_allclose(np.add(found["bias"], TRUE), TRUE, atol=0.02)


class Impossible(ScalarModel):
    """Terms in a regime have parameters that cannot be, such as a spring that pushes."""

    def is_possible(self, name):
        return split_label(name)[1] is None


def test_what_cannot_be_is_not_found_in_a_regime_either():
    motion = make(
        next(c for c, terms in CASES.items() if len(terms) == 1 and "[" in terms[0][0]), 7
    )
    named = diagnose(ScalarModel(motion, np.zeros(2)).refined())
    assert split_label(named.effect)[1] is not None
    refused = diagnose(Impossible(motion, np.zeros(2)).refined())
    assert refused.effect is None or split_label(refused.effect)[1] is None
    assert all(split_label(name)[1] is None for name in refused.group)


def test_a_regime_of_chance_predicts_other_blocks_no_better_than_chance():
    motion = make("none", 1)
    random = np.random.default_rng(2)
    values = []
    for _ in range(DRAWS):
        noise = fitted(replace(motion, force=random.normal(0.0, 0.05, len(motion.time))))
        search = RegimeSearch.of(noise, 1.0)
        values.append(search.split_p_value(search.families))
    assert np.mean(np.array(values) < 0.05) < 0.1
    assert np.min(values) > 1e-4


def test_no_regime_is_told_of_noise_or_of_a_term_that_acts_everywhere():
    for case in ("none", "cubic everywhere"):
        for seed in range(20, 26):
            assert diagnose(fitted(make(case, seed))).regime is None


def test_compare_tells_the_regime_of_the_error_with_its_p_value():
    document = compare(fitted(make("rubbing for a while", 8))).to_json()
    place = document["fails_where"][0]
    assert place["regime"] == "7.5275<t<15.01"
    assert place["p_value"] < 1e-3
    assert place["share_of_error"] > 0.95
    assert not any("regime" in p for p in compare(fitted(make("none", 8))).to_json()["fails_where"])


def test_skin_that_sticks_from_a_time_on_is_found_in_a_probe_and_not_gated_if_it_always_does():
    slips = tabulate_slips(generate_events(draw_surface("none", 503), 503))
    half = len(slips) // 2
    later = (np.arange(len(slips)) >= half)[:, None]
    sticky = replace(slips, tangential=slips.tangential + np.where(later, 0.12, 0.0))
    diagnosis = diagnose(FrictionModel.fit(sticky))
    assert diagnosis.effect == f"adhesion[{diagnosis.regime.gate}]"
    time = slips.time - slips.time[0]
    assert time[half - 3] <= diagnosis.regime.gate.low <= time[half + 2]
    always = tabulate_slips(generate_events(draw_surface("adhesion", 502), 502))
    assert diagnose(FrictionModel.fit(always)).effect == "adhesion"


def test_drag_below_a_water_line_is_found_in_a_held_object_and_kept_out_of_its_mass():
    made = generate_in_regime(
        710, "drag below the water line", options=ScenarioOptions(duration=20.0)
    )
    model = HeldObjectModel.from_fit(fit_with_readings(made.streams))
    document = diagnosis_document(diagnosis := diagnose(model))
    assert document["effect"].startswith("viscous_drag[z<")
    bounds, regime = made.effects[0].bounds, document["regime"]
    assert (regime["condition"], regime["from"]) == ("z", None)
    assert regime["to"] == pytest.approx(bounds.high, abs=3.0 * regime["std"])
    assert document["sentence"].startswith("Below z = ")
    assert "above it nothing is missing" in document["sentence"]
    truly = acts_at(made, model.time[::6] + model.fitted.stretches[0].problem.start)
    found = diagnosis.regime.gate.inside(diagnosis.regime.condition.values)
    assert np.mean(found == truly) > 0.98
    c = document["candidates"][0]["parameters"]["c"]
    assert c["value"] == pytest.approx(made.effects[0].sized.coefficient, abs=4.0 * c["std"])
