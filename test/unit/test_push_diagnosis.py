"""What a model of pushes lacks: white where nothing does, named where something does."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis import one_part
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.core.planar.diagnosis.variation import SLOPE, VARIATION, Table
from tactile_dynamics_ros.core.planar.effects.regional import STEP
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

THREE = ActionOptions(count=3, speed=(0.08, 0.15), travel=0.05)
FOUR = ActionOptions(count=4, speed=(0.04, 0.25), travel=0.06)


@pytest.fixture(scope="module")
def model():
    """Three pushes in which nothing is hidden, fitted."""
    made = pushed.generate([41], {}, pushed.PushOptions(actions=THREE))[0]
    return PushDiscrepancy.of_streams(made.streams)


@pytest.fixture(scope="module")
def tilted():
    """Four pushes on a table that leans by 4 degrees."""
    return pushed.generate([45], {"support_tilt": 2.0}, pushed.PushOptions(actions=FOUR))[0]


def test_innovations_of_a_right_model_are_white(model):
    white = model.residual.reshape(-1, 3)
    assert np.sqrt(np.mean(white**2, axis=0)) == pytest.approx(1.0, abs=0.2)
    rho = np.mean(white[1:] * white[:-1], axis=0) / np.mean(white**2, axis=0)
    assert np.max(np.abs(rho)) < 4.0 / np.sqrt(len(white))
    assert model.table.along <= 0.02
    assert model.table.field == 0.0


def test_the_same_change_under_all_points_is_more_friction(model):
    balance, motion, common = model.fit.model.balance, model.pushes.kinematics, model.fit.common
    slip = model.linear.sharp.slip
    everywhere = np.ones(balance.feet(motion).shape[:2])
    told = balance.lack_by_shares(motion, common, slip, [everywhere])[:, :, 0]
    friction = balance.linear_friction(motion, common, slip)
    more = replace(motion, local=motion.local + [1e-4, 0.0, 0.0])
    change = balance.lack(more, common, friction) - balance.lack(motion, common, friction)
    assert np.allclose(told, change / 1e-4, atol=2e-3 * np.abs(told).max())


def test_a_slope_acts_under_each_point_of_the_object(model):
    """The effect, whose points share one factor and a centre, does what each point does alone."""
    balance, motion, common = model.fit.model.balance, model.pushes.kinematics, model.fit.common
    feet = balance.feet(motion) - balance.middle
    told = balance.lack_by_shares(motion, common, model.linear.sharp.slip, feet.transpose(2, 0, 1))
    effect, noise = model.effect_named(SLOPE), model.fit.model.noise(model.linear.sharp.floor)
    made, _ = model._spanned(effect)
    made = made[model.fit.model.middle] * noise[:, :, None]
    assert np.linalg.norm(made - told) < 0.15 * np.linalg.norm(told)
    assert np.linalg.norm((made - told)[:, 2]) < 0.3 * np.linalg.norm(told[:, 2])


def test_what_a_field_may_do_is_no_evidence_for_a_slope(model):
    uneven = model.on_table(Table(model.table.along, 2.0, 0.1))
    told = [np.linalg.norm(m.families_of(SLOPE)[0].columns) for m in (model, uneven)]
    assert told[1] < 0.7 * told[0]
    noise = uneven.draw_noise(np.random.default_rng(1))
    assert np.sqrt(np.mean(uneven.whiten(noise) ** 2)) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(np.mean(noise**2)) > 1.1


def test_a_slope_that_a_field_could_be_is_named_with_it(model):
    alike = model.on_table(Table(0.003, imitating=0.05))
    assert alike.imitators(SLOPE) == (VARIATION,)
    assert alike.imitators("support_tilt") == ()
    assert model.on_table(Table(0.003)).imitators(SLOPE) == ()
    assert "push over more of the table" in alike.plan_against([])["description"]


def test_a_slope_is_as_uncertain_as_the_field_that_may_make_it(model):
    even = model.on_table(Table(model.table.along))
    sloped = even.fitted_from((model.effect_named(SLOPE),), (np.zeros(2),))
    alike = sloped.on_table(replace(sloped.table, imitating=0.05, length=0.1))
    told = [one.parameters()[SLOPE]["g_x"]["std"] for one in (sloped, alike)]
    assert told[1] > told[0]
    double = alike.on_table(replace(alike.table, imitating=0.1)).parameters()
    added = [np.sqrt(std**2 - told[0] ** 2) for std in (told[1], double[SLOPE]["g_x"]["std"])]
    assert added[1] == pytest.approx(2.0 * added[0], rel=1e-3)


def test_effects_are_as_uncertain_as_the_field_that_may_be_there(model):
    even = model.on_table(Table(model.table.along))
    assert_allclose(even.covariance, even.on_table(replace(even.table, unsure=0.05)).covariance)
    biased = even.fitted_from((model.effect_named("force_bias"),), (np.zeros(2),))
    unsure = biased.on_table(replace(biased.table, unsure=0.05))
    double = biased.on_table(replace(biased.table, unsure=0.1))
    added = [one.covariance - biased.covariance for one in (unsure, double)]
    assert added[0][-1, -1] > 0.0
    assert_allclose(added[1], 4.0 * added[0], rtol=1e-6, atol=1e-12)


def test_beside_a_field_the_slope_is_told_that_looks_the_same(model):
    uneven = model.on_table(Table(model.table.along, 0.05, 0.03))
    told = re.search(
        r"A slope of up to (\S+) per metre would look the same: push over", uneven.remark
    )
    wider = model.on_table(Table(model.table.along, 0.14, 0.1)).remark
    more = re.search(r"A slope of up to (\S+) per metre", wider)
    assert 0.0 < float(told[1]) < float(more[1]) < 5.0
    assert model.remark == ""


def test_what_is_clearly_likelier_in_a_regime_is_named_beside_what_acts_everywhere(model):
    film = "viscous_support[y>0.2]"
    table = replace(model.table, regional=film)
    wet = model.on_table(table)
    assert wet.imitators("support_tilt") == (film,)
    assert wet.imitators("viscous_support") == ()
    assert wet.imitators(film) == ()
    assert wet.refined().table.regional == film


def test_hypotheses_in_a_regime_part_the_recording(model):
    motion = model.pushes.motion()
    found = model.pushes.regional()
    assert len({effect.name for effect in found}) == len(found) < 130
    shares = np.array([effect.share(motion).mean() for effect in found])
    assert np.all((shares > 0.02) & (shares < 0.98))
    kinds = {(name.split("[")[0], name.split("[")[1][0]) for name in (e.name for e in found)}
    places = {(name, axis) for name in ("viscous_support", STEP, "constant_pull") for axis in "xy"}
    assert places < kinds


GOOD = {"inertia": 0.1, "error": 0.9}


@pytest.mark.parametrize(
    ("first", "leaning", "kept"),
    [
        ({"inertia": 0.2, "error": 0.95}, GOOD, "first"),
        ({"inertia": -1.2, "error": 1.1}, GOOD, "leaning"),
        ({"inertia": 0.0, "error": 1.5}, GOOD, "leaning"),
        ({"inertia": 0.0, "error": 0.95, "bound": True}, GOOD, "leaning"),
        ({"inertia": 0.0, "error": 0.85, "bound": True}, GOOD, "first"),
        ({"inertia": -1.2, "error": 1.1}, GOOD | {"variation": 0.1}, "first"),
    ],
)
def test_a_fit_where_no_object_is_is_tried_with_a_lean(model, monkeypatch, first, leaning, kept):
    def made(inertia, error, bound=False, variation=0.03):
        common = np.array([-1.0, -1.0 - np.log(0.01 if bound else 0.3), *np.zeros(9)])
        common[4] = inertia
        return replace(model.fit, common=common, whitened_rms=error, variation=variation)

    fits = {(): made(**first), ("support_tilt",): made(**leaning)}
    monkeypatch.setattr(one_part, "with_expected_force", lambda fit: fit)
    monkeypatch.setattr(one_part, "fit_push", lambda _, effects: fits[names_of(effects)])
    found = one_part.OnePart.of_streams(None, ()).fit
    assert found is fits[() if kept == "first" else ("support_tilt",)]


def names_of(effects):
    return tuple(effect.name for effect in effects)


FILM, PULL = "viscous_support[y>0.2]", "constant_pull[t>3]"


@pytest.mark.parametrize(
    ("inertia", "film", "kept"),
    [(-1.2, 0.03, FILM), (-1.2, 0.14, ""), (0.1, 0.03, "")],
)
def test_a_fit_where_no_object_is_is_tried_with_what_may_act_in_a_regime(
    model, monkeypatch, inertia, film, kept
):
    common = np.zeros(11)
    common[:2], common[4] = (-1.0, -1.0 - np.log(0.3)), inertia
    plain = replace(model.fit, common=common, whitened_rms=0.94, variation=0.1)
    fits = {
        PULL: replace(plain, whitened_rms=0.95),
        FILM: replace(plain, whitened_rms=0.96, variation=film),
    }
    monkeypatch.setattr(one_part, "with_expected_force", lambda fit: fit)
    monkeypatch.setattr(one_part, "fit_push", lambda _, effects: fits[effects[0].name])
    found = one_part.OnePart(plain).suspecting(None, (PULL, FILM)).fit
    assert found is fits.get(kept, plain)


@pytest.mark.parametrize(
    ("unconverged", "name", "converged", "whole"),
    [
        ("streams", PULL, True, True),
        ("streams", PULL, False, False),
        ("streams", "constant_pull", True, False),
        (None, PULL, True, False),
    ],
)
def test_what_acts_in_a_regime_is_fitted_whole_where_a_fit_has_not_converged(
    model, monkeypatch, unconverged, name, converged, whole
):
    anew, from_there = replace(model.fit, converged=converged), replace(model.fit)
    monkeypatch.setattr(one_part, "with_expected_force", lambda fit: fit)
    monkeypatch.setattr(one_part, "fit_push", lambda streams, _: streams and anew)
    monkeypatch.setattr(one_part, "refit", lambda *_: from_there)
    found = one_part.OnePart(model.fit, unconverged).refitted((PUSHED.create(name),), None, 0.1)
    assert found.fit is (anew if whole else from_there)
    assert found.unconverged is unconverged


def test_an_effect_that_helped_to_find_the_motion_is_missing_again(tilted):
    """Else its residual is judged as if the effect were there, and nothing explains what it did."""
    names = ("support_tilt",)
    leaning = one_part.OnePart.of_streams(tilted.streams, PUSHED.create_all(names))
    models = [PushDiscrepancy._of_pushes(leaning, kept) for kept in ((), names)]
    assert [model.effect_names for model in models] == [(), names]
    without, beside = (m._whitened(0.01, *m.linear.lasting_rows)[0] for m in models)
    assert np.mean(without**2) > 1.3 * np.mean(beside**2)


@pytest.mark.parametrize("name", PUSHED.names())
def test_effects_are_absent_at_zero_and_lie_in_their_families(model, name):
    effect = PUSHED.create(name)
    if effect.sudden:
        effect = effect.from_time(float(model.fit.model.intervals.time.mean()))
    zero = np.append(model.x, np.zeros(len(effect.parameters)))
    before = model.lack(model.x, ())
    assert np.allclose(model.lack(zero, (effect,)), before, atol=1e-9)
    small = 1e-3 * np.array([p.typical for p in effect.parameters])
    change = model.whiten(model.lack(np.append(model.x, small), (effect,)) - before)
    families = model.families_of(name)
    assert bool(families) == effect.identifiable
    if not families or effect.sudden:
        return
    columns = families[0].columns
    left = change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0]
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(change) + 1e-9


def test_a_hidden_effect_is_named_added_and_the_error_falls(tilted, tmp_path, capsys):
    bag = tmp_path / "bag"
    PushedRecording(tilted.streams, "made").to_bag(bag)
    assert main(["diagnose", str(bag), "--json", "--out", str(tmp_path / "report")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "missing_effect"
    assert found["effect"] == "support_tilt"
    before, after = (found["error"][key] for key in ("before", "after"))
    assert before > 1.1 > 1.05 > after
    assert (tmp_path / "report" / "report.html").is_file()


def test_an_effect_in_the_model_leaves_noise_alone(tilted):
    with_tilt = estimate(tilted.streams, ["support_tilt"])
    assert with_tilt.error < 1.1
    value, std = with_tilt.values["friction_force_n"]
    assert abs(value - tilted.truth()["links"][0]["friction_force_n"]) < 3.0 * std
    down = [with_tilt.effects["support_tilt"][name] for name in ("t_x", "t_y")]
    truth = tilted.truth()["effects"]["support_tilt"]["parameters"]
    for told, way in zip(down, truth["direction"], strict=True):
        assert abs(told["value"] - truth["angle"] * way) < 3.5 * told["std"]


def test_a_wrong_sign_is_told_in_one_line(tilted, tmp_path, capsys):
    wrong = {n: replace(c, force=-c.force) for n, c in tilted.streams.contacts.items()}
    bag = tmp_path / "bag"
    PushedRecording(replace(tilted.streams, contacts=wrong), "made").to_bag(bag)
    assert main(["compare", str(bag)]) == 2
    assert "--assume force_sign" in capsys.readouterr().err


def test_a_few_poses_while_it_slides_judge_nothing(tilted):
    link = tilted.streams.links[0]
    touched = min(contact.time[0] for contact in tilted.streams.contacts.values())
    few = link.between(link.time[0], touched + 0.35)
    with pytest.raises(NotIdentifiableError, match="push it further"):
        PushDiscrepancy.of_streams(replace(tilted.streams, links=(few,)))
