"""Laws that no catalogue has: found jointly with the model, or not at all; as files of effects."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.local_terms import LAWS, NOISE, ScalarModel, Term, make
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.contract import central_differences
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.laws.documents import learn_file
from tactile_dynamics_ros.core.discrepancy.laws.learning import Law, NothingLearnt, learn_law
from tactile_dynamics_ros.core.discrepancy.laws.search import search_laws
from tactile_dynamics_ros.core.effects import create_effects
from tactile_dynamics_ros.core.effects.check import example_inertia, example_samples
from tactile_dynamics_ros.core.effects.formula.file import read_effect
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import expand_files
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.diagnosis.law_forms import held_forms
from tactile_dynamics_ros.core.inertia.diagnosis.live_check import learn_from_streams
from tactile_dynamics_ros.core.inertia.live.refit import RefittedModel, fit_live
from tactile_dynamics_ros.core.planar.diagnosis.law_forms import pushed_forms
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms
from tactile_dynamics_ros.synthetic.recordings import write_bag


@dataclass(frozen=True)
class PowerLaw:
    """Force size |q|^power sign(q) of the driven mass, q its place or its speed."""

    name: str = "power_law"
    of: str = "place"
    formula: str = "size |q|^power"
    sentence: str = "a power acts"

    def force(self, motion, theta):
        """Return the force (N,)."""
        quantity = getattr(motion, self.of)
        return theta[0] * np.sign(quantity) * np.abs(quantity) ** theta[1]


@dataclass(frozen=True)
class Driven(ScalarModel):
    """The driven mass of the benchmark, with laws beside its terms; stated noise over the white."""

    catalogue: tuple[str, ...] = ("drag", "dry_friction")
    stated: float = 1.0

    def predict(self, x, effects):
        total = x[0] * self.motion.place + x[1] * self.motion.speed
        first = 2
        for effect in effects:
            if isinstance(effect, PowerLaw):
                total, first = total + effect.force(self.motion, x[first : first + 2]), first + 2
            else:
                total, first = total + x[first] * effect.column(self.motion), first + 1
        return total

    def parameters_of(self, effect):
        both = (EffectParameter("size", "", 10.0, ""), EffectParameter("power", "", 5.0, ""))
        return both if isinstance(effect, PowerLaw) else both[:1]

    def whiten(self, rows):
        return super().whiten(rows) / self.stated

    def law_forms(self):
        return [PowerForm(), PowerForm("twin_law")]

    def plan_against(self, rivals):
        return {"description": f"move farther ({len(rivals)} rival)"}

    def draw_noise(self, random):
        return self.stated * super().draw_noise(random)


@dataclass(frozen=True)
class PowerForm:
    """Powers of place or speed at three exponents."""

    name: str = "power_law"
    of: str = "place"
    words: str = "a force ~ distance^{power}"
    linear: tuple[str, ...] = ("size",)
    reference: tuple[float, str] = (1.0, "m")

    def require_name(self, name, where):
        pass

    def entry_of(self, found):
        return {"power": found["power"]["value"]}

    def term_of(self, found):
        return {"formula": "size |q|^power"}

    @cached_property
    def effect(self):
        return PowerLaw(self.name, self.of)

    def starts(self, model, frequencies):
        return [np.array([1.0, power]) for power in (0.5, 2.0, 4.0)]

    def columns(self, model, start):
        return model.whiten(self.effect.force(model.motion, start))[:, None]

    def completed(self, start, coefficients):
        return np.array([coefficients[0], start[1]])


def driven(seed, law=lambda motion: 0.0, stated=1.0):
    """Return the fitted model of a mass on which a law acts."""
    motion = make("none", seed)
    motion = replace(motion, force=motion.force + law(motion))
    return Driven(motion, np.zeros(2), stated=stated).refined()


def cubic(motion):
    """Return the force of a law of place."""
    return 0.8 * np.sign(motion.place) * np.abs(motion.place) ** 3.4


def test_what_a_law_leaves_is_held_against_the_noise_that_is_stated():
    def lasting(motion):
        return cubic(motion) + 2.0 * NOISE * np.sin(2.0 * np.pi * 0.07 * motion.time)

    law = learn_law(diagnose(driven(3, lasting, stated=2.0)), [PowerForm()])
    assert isinstance(law, Law)
    assert law.floor < 0.6, "white noise is half of what is stated"
    assert 1.2 * law.floor < law.after.rms < 1.0, "more than white noise is left"
    assert isinstance(learn_law(diagnose(driven(3, lasting)), [PowerForm()]), NothingLearnt)


def test_two_laws_add_up_and_each_has_its_own_exponent():
    both = [PowerForm(), PowerForm("power_drag", "speed")]
    model = driven(4, lambda m: cubic(m) + 0.3 * m.speed * np.abs(m.speed) ** 1.5)
    law = learn_law(diagnose(model), both)
    assert isinstance(law, Law)
    assert {form.name for form in law.forms} == {"power_law", "power_drag"}
    found = law.model.parameters()
    for name, power in (("power_law", 3.4), ("power_drag", 2.5)):
        assert abs(found[name]["power"]["value"] - power) < 3.0 * found[name]["power"]["std"] < 0.3


def test_a_law_is_learnt_beside_a_known_effect():
    model = driven(8, lambda m: cubic(m) + 0.3 * LAWS["dry_friction"](m))
    law = learn_law(diagnose(model), [PowerForm()])
    assert isinstance(law, Law)
    assert [form.name for form in law.forms] == ["power_law"]
    assert law.beside == ("dry_friction",) or "dry_friction" in law.base.effect_names


def test_a_law_is_learnt_jointly_with_the_parameters_of_the_model():
    model = driven(3, cubic)
    law = learn_law(diagnose(model), [PowerForm()])
    assert isinstance(law, Law)
    found = law.model.parameters()["power_law"]
    assert abs(found["power"]["value"] - 3.4) < 3.0 * found["power"]["std"] < 0.2
    assert law.after.rms < 1.05 < 1.5 < law.before.rms
    spread = np.sqrt(np.diag(law.model.covariance))[:2]
    assert np.all(np.abs(law.model.own - [2.0, 0.5]) < 3.0 * spread), "not bent by the law"
    assert abs(model.own[0] - 2.0) > 10.0 * spread[0], "alone it is bent"


def test_the_chance_of_a_find_on_noise_alone_pays_for_the_search():
    values = [search_laws(driven(seed), [PowerForm()], 1.0, seed).p_value for seed in range(40)]
    assert np.mean(np.array(values) <= 0.2) == pytest.approx(0.2, abs=0.15)
    assert np.mean(values) == pytest.approx(0.5, abs=0.15)


def test_nothing_is_learnt_where_nothing_is_missing_or_a_known_effect_is():
    clean = learn_law(diagnose(driven(5)), [PowerForm()])
    assert clean == NothingLearnt("nothing is missing")
    rubbed = driven(6, lambda m: 0.4 * LAWS["dry_friction"](m))
    found = learn_law(diagnose(rubbed), [PowerForm()])
    assert isinstance(found, NothingLearnt)
    assert "dry_friction of the catalogue" in found.reason


def test_two_laws_that_explain_as_well_are_both_kept_with_what_tells_them_apart(tmp_path):
    found = learn_file(diagnose(driven(3, cubic)), tmp_path / "law.yaml")["law"]
    [other] = found["others"]
    assert {found["form"], other["form"]} == {"power_law", "twin_law"}
    assert found["separating_motion"] == {"description": "move farther (1 rival)"}
    assert f"As good: {other['form']}; move farther" in found["sentence"]
    powers = [
        yaml.safe_load(Path(file).read_text())["effects"]["law"]["power"]
        for file in (found["file"], other["file"])
    ]
    assert powers == pytest.approx([3.4, 3.4], abs=0.1)


def test_what_merely_goes_with_the_cause_is_no_law():
    random = np.random.default_rng(0)
    coarse = 2.0 * NOISE * np.repeat(random.normal(size=50), 30)
    model = driven(7, lambda m: 0.2 * m.place**3 + coarse)
    found = learn_law(diagnose(model), [PowerForm()])
    assert isinstance(found, NothingLearnt)
    assert "no law of these forms" in found.reason


def test_terms_of_the_benchmark_are_unchanged_by_laws_beside_them():
    model, plain = driven(1), ScalarModel(make("none", 1), np.zeros(2)).refined()
    np.testing.assert_allclose(model.own, plain.own, rtol=1e-6)
    assert Term("drag").column(model.motion).shape == model.time.shape


@pytest.mark.parametrize("form", held_forms(), ids=lambda form: form.name)
def test_every_form_is_an_effect_with_right_derivatives_before_and_after_it_is_learnt(form):
    table = {
        p.name: {"value": 0.3 + 0.1 * k, "std": 0.01, "unit": p.unit}
        for k, p in enumerate(form.effect.definition)
    }
    learnt = read_effect("learnt", form.entry_of(table), "test")()
    samples, load = example_samples(), example_inertia()
    theta = np.array([entry["value"] for entry in table.values()])
    changes = [0.0 if "_change" in p.name else table[p.name]["value"] for p in learnt.definition]
    same = learnt.wrench(samples, load, np.array(changes))
    np.testing.assert_allclose(same, form.effect.wrench(samples, load, theta), rtol=1e-9)
    steps = 1e-6 * np.ones(len(changes))
    exact = central_differences(
        lambda at: learnt.wrench(samples, load, at), np.array(changes), steps
    )
    found = learnt.jacobian(samples, load, np.array(changes))
    np.testing.assert_allclose(found, exact, atol=1e-5 * np.abs(exact).max())
    assert learnt.screening_basis(samples, load).shape[2] > 0, "it can be screened"


@pytest.mark.parametrize("form", pushed_forms(), ids=lambda form: form.name)
def test_every_law_of_pushes_is_the_same_once_it_is_read_from_its_file(form, tmp_path):
    table = {
        p.name: {"value": 0.3 + 0.1 * k, "std": 0.01} for k, p in enumerate(form.kind.parameters)
    }
    path = tmp_path / f"pushed_{form.name}.yaml"
    path.write_text(yaml.safe_dump({"effects": {path.stem: form.entry_of(table)}}))
    [label] = expand_files([str(path)])
    learnt = PUSHED.create(label)
    random = np.random.default_rng(1)
    motion = PlanarMotion(
        np.linspace(0.0, 2.0, 9), 0.2 * random.normal(size=(9, 2)), random.normal(size=(9, 2)),
        random.normal(size=9), random.normal(size=9), 1e-3, np.zeros(2),
    )  # fmt: skip
    theta = np.array([entry["value"] for entry in table.values()])
    sizes = [theta[k] if name in form.linear else 0.0 for k, name in enumerate(form.names)]
    for part in ("wrench", "friction", "rise"):
        expected = getattr(form.effect, part)(motion, theta)
        found = getattr(learnt, part)(motion, np.array(sizes))
        assert (found is None) == (expected is None)
        if expected is not None:
            np.testing.assert_allclose(found, expected, rtol=1e-9)
    with pytest.raises(BadInputError, match="taken by the catalogue"):
        form.require_name("constant_pull", "law.yaml")


def test_axes_of_the_world_turn_with_the_body():
    entry = {
        "parameters": {"size": {"unit": "N", "prior_std": 1.0}},
        "wrench": {"axes": "body", "force": "size*world_y"},
    }
    samples = example_samples()
    wrench = read_effect("push", entry, "test")().wrench(
        samples, example_inertia(), np.array([2.0])
    )
    np.testing.assert_allclose(wrench[:, 3:], 2.0 * samples.rotation[:, 1, :])


@pytest.fixture(scope="module")
def magnet(tmp_path_factory):
    """Return a recording near a magnet, its file of the law, and what the command says."""
    folder = tmp_path_factory.mktemp("magnet")
    made = generate_at_whitened_rms(21, {"dipole_pull": 2.0}, ScenarioOptions(duration=10.0))
    write_bag(made.streams, folder / "run.mcap")
    return made, folder


def test_the_command_learns_a_law_that_is_an_effect_at_once(magnet, capsys):
    made, folder = magnet
    path = folder / "law.yaml"
    assert main(["diagnose", str(folder / "run.mcap"), "--learn", str(path), "--json"]) == 0
    law = json.loads(capsys.readouterr().out)["law"]
    assert law["form"] == "central_force"
    assert law["name"] == "law"
    [term] = law["terms"]
    assert term["unit"] == "N"
    assert law["close_to"]["error"] > 1.02 * law["error"]["after"]
    power = law["parameters"]["power"]
    assert abs(power["value"] + 3.0) < 3.0 * power["std"]
    assert "law" in yaml.safe_load(path.read_text())["effects"]
    [effect] = create_effects([str(path)])
    assert effect.name == "law"
    assert main(["compare", str(folder / "run.mcap"), "--effects", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["adequate"]
    live = RefittedModel()
    live.set_effects([str(path)])
    fit = fit_live(made.streams, live.effects)
    assert set(fit.effects) == {"law"}
    assert fit.error.whitened_rms < 1.05


def test_of_the_last_seconds_nothing_is_learnt_where_nothing_is_missing(tmp_path):
    made = generate_at_whitened_rms(22, {}, ScenarioOptions(duration=5.0))
    document = learn_from_streams(made.streams, (), tmp_path / "laws")
    assert (document["verdict"], document["law"]) == ("adequate", None)
    assert document["nothing_learnt"] == "nothing is missing"
    assert "law" not in document["sentence"]
    assert list((tmp_path / "laws").iterdir()) == []
