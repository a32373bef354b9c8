"""What a model of two pushed parts lacks: each structure, and effects that have a law there."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis import two_parts
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.core.planar.diagnosis.innovations import Innovations
from tactile_dynamics_ros.core.planar.diagnosis.linearisation import Linearisation
from tactile_dynamics_ros.core.planar.diagnosis.separating_push import plan_push
from tactile_dynamics_ros.core.planar.diagnosis.two_parts import TwoParts
from tactile_dynamics_ros.core.planar.diagnosis.variation import Table
from tactile_dynamics_ros.core.planar.effects.acting import described
from tactile_dynamics_ros.core.planar.effects.part import OF_ONE_PART, on_part
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.linked.outlines import distance_outside
from tactile_dynamics_ros.core.planar.linked.pushes import TellingPush
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.core.planar.properties.linked_fit import (
    fit_jointed,
    fit_rigid,
    with_expected_force,
)
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

ACTIONS = ActionOptions(count=2, speed=(0.1, 0.2), travel=0.06)


def _model(kind, fit):
    """Two pushes of two parts in which nothing is hidden, fitted as what they are."""
    options = pushed.PushOptions(kind=kind, actions=ACTIONS)
    [made] = pushed.generate([107], {}, options)
    pushes = TwoParts(with_expected_force(fit(Pair.of_streams(made.streams))))
    values = pushes.common[pushes.own]
    linear = Linearisation(pushes, Table(0.003))
    return PushDiscrepancy(linear, values, (), (), pushes.catalogue).settled()


@pytest.fixture(scope="module")
def rigid():
    """Two boxes that are glued together."""
    return _model("rigid_pair", fit_rigid)


@pytest.fixture(scope="module")
def jointed():
    """Two discs on a joint that turns by more than 5 degrees."""
    return _model("jointed", fit_jointed)


@pytest.fixture(params=["rigid", "jointed"])
def model(request):
    """Either."""
    return request.getfixturevalue(request.param)


def test_innovations_of_both_parts_are_white(model):
    white = model.residual.reshape(len(model.linear.filter.order), 6)
    assert np.sqrt(np.mean(white**2)) == pytest.approx(1.0, abs=0.12)
    rho = np.mean(white[1:] * white[:-1], axis=0) / np.mean(white**2, axis=0)
    assert np.max(np.abs(rho)) < 4.0 / np.sqrt(len(white))
    across = np.corrcoef(white.T) - np.eye(6)
    assert np.max(np.abs(across)) < 4.0 / np.sqrt(len(white))


def test_a_pose_without_a_fellow_is_used_and_not_judged(rigid):
    rows = rigid.linear.rows
    second = np.flatnonzero(rows.poses.part == 1)
    order = rigid.linear.filter.order
    gone = order[len(order) // 2, 1]
    kept = np.setdiff1d(np.arange(len(rows.poses.time)), [gone])
    names = rows.poses.__dataclass_fields__
    poses = replace(rows.poses, **{name: getattr(rows.poses, name)[kept] for name in names})
    left = Innovations.of(replace(rows, poses=poses))
    assert gone in second
    assert len(left.order) == len(order) - 1
    assert np.all(rows.poses.middle[order[:, 0]] == rows.poses.middle[order[:, 1]])


def test_effects_are_absent_at_zero_and_lie_in_their_families(model):
    for name in model.catalogue:
        families = model.families_of(name)
        effect = families[0].source if families else PUSHED.create(name)
        zero = np.append(model.x, np.zeros(len(effect.parameters)))
        before = model.lack(model.x, ())
        assert np.allclose(model.lack(zero, (effect,)), before, atol=1e-9), name
        small = 1e-3 * np.array([p.typical for p in effect.parameters])
        change = model.whiten(model.lack(np.append(model.x, small), (effect,)) - before)
        assert bool(families) == effect.identifiable, name
        if families and not effect.sudden:
            columns = families[0].columns
            left = change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0]
            assert np.linalg.norm(left) < 0.05 * np.linalg.norm(change) + 1e-9, name


def test_what_acts_at_a_point_acts_on_one_part_of_two_on_a_joint(rigid, jointed):
    assert set(rigid.catalogue) == set(jointed.catalogue)
    assert "loose_joint" not in rigid.catalogue
    for name in OF_ONE_PART:
        families, starts = jointed.families_of(name), jointed.pushes.intervals.push_starts
        often = len(starts) - 1 if name == "load_change" else 1
        assert [family.source.part for family in families] == [0, 1] * often, name
        assert len({family.label for family in families}) == 2 * often
        assert all(family.choices == 2 * often for family in families)
        for family in families:
            assert family.label == f"{family.source.inner.label} on link_{family.source.part + 1}"
        assert all("link_" not in family.label for family in rigid.families_of(name))
    assert [family.label for family in jointed.families_of("support_tilt")] == ["support_tilt"]


@pytest.mark.parametrize("part", [0, 1])
def test_a_pull_at_one_part_is_felt_by_its_own_balance(jointed, part):
    pushes, [pull] = jointed.pushes, PUSHED.create_all(["constant_pull"])
    common, force = pushes.common, np.array([0.3, -0.2])
    theta = [*force, 0.0, 0.0]
    change = pushes.lack(np.append(common, theta), (on_part(pull, part),), jointed.linear.friction)
    change -= pushes.lack(common, (), jointed.linear.friction)
    np.testing.assert_allclose(change[:, :2], np.tile(-force, (len(change), 1)), atol=1e-9)
    model = pushes.fit.model
    body = model.pressed(pushes.kinematics, common, jointed.linear.friction)[part]
    centre = body.part.pose[:, :2] + body.part.place(body.patch.centroid)
    arm = centre - model.intervals.point[pushes.middle, :2] - common[15:17]
    np.testing.assert_allclose(change[:, 2], -(arm[:, 0] * -0.2 - arm[:, 1] * 0.3), atol=1e-9)
    joint = body.part.place(common[18 + 2 * part : 20 + 2 * part])
    lever = centre - body.part.pose[:, :2] - joint
    free = (model.data.touched[pushes.middle] != part) & model.data.turning[pushes.middle]
    expected = np.where(free, -(lever[:, 0] * -0.2 - lever[:, 1] * 0.3), 0.0)
    assert free.any()
    np.testing.assert_allclose(change[:, 3], expected, atol=1e-9)


@pytest.mark.parametrize("part", [0, 1])
def test_a_load_on_one_part_is_more_mass_and_friction_of_it_from_its_time_on(jointed, part):
    pushes, [load] = jointed.pushes, PUSHED.create_all(["load_change"])
    time = pushes.intervals.time[pushes.middle]
    effect, common = on_part(load, part).from_time(float(np.median(time))), pushes.common
    found = pushes.lack(np.append(common, [0.3, 0.004, 0.0]), (effect,), jointed.linear.friction)
    heavier = common.copy()
    names = [f"ln_product_{part + 1}", f"ln_mass_{part + 1}"]
    heavier[[pushes.names.index(name) for name in names]] += np.log(1.3)
    heavier[pushes.names.index(f"com_x_{part + 1}")] += 0.004
    after = time >= effect.start
    assert 10 < after.sum() < len(after) - 10
    expected = pushes.lack(heavier, (), jointed.linear.friction)
    np.testing.assert_allclose(found[after], expected[after], atol=1e-9)
    before = pushes.lack(common, (), jointed.linear.friction)
    np.testing.assert_allclose(found[~after], before[~after], atol=1e-9)


def test_an_effect_on_one_part_survives_a_pickle_and_tells_its_part(jointed):
    [pull] = PUSHED.create_all(["constant_pull"])
    effect = pickle.loads(pickle.dumps(on_part(pull, 1)))
    assert (effect.name, effect.part, effect.label) == (
        "constant_pull",
        1,
        "constant_pull on link_2",
    )
    table = described((effect,), np.zeros(4), np.ones(4))
    assert table["constant_pull"]["link"] == {"value": 2.0, "std": 0.0, "unit": ""}
    theta = np.array([0.1, 0.2, 0.0, 0.0])
    told = jointed.with_parameters(jointed.own, (effect,), (theta,)).parameters()
    assert told["constant_pull"]["link"]["value"] == 2.0
    model = jointed.with_parameters(jointed.own, (effect,), (theta,))
    assert model.sentence("constant_pull").startswith("at link_2 something pulls")
    assert jointed.sentence("constant_pull").startswith("something pulls")


def test_the_same_change_under_all_points_is_more_friction_of_each_part(model):
    pushes, sharp = model.pushes, model.linear.sharp
    friction, motion = pushes.friction(sharp), pushes.kinematics
    everywhere = np.ones(pushes.feet().shape[:2])
    told = pushes.lack_by_shares(sharp, [everywhere])[:, :, 0]
    local = motion.local.copy()
    local[:, ::3] += 1e-4
    lack = pushes.fit.model.lack
    change = lack(replace(motion, local=local), pushes.common, friction)
    change -= lack(motion, pushes.common, friction)
    tipped = 0.02 if model.pushes.structure == "rigid" else 0.1  # friction tips parts on a joint
    assert np.linalg.norm(told - change / 1e-4) < tipped * np.linalg.norm(told)


def test_a_lean_pulls_at_the_mass_of_each_part(model):
    pushes = model.pushes
    [effect] = PUSHED.create_all(["support_tilt"])
    there = np.append(pushes.common, [0.0, 1e-3])
    change = pushes.lack(there, (effect,), model.linear.friction)
    change -= pushes.lack(pushes.common, (), model.linear.friction)
    mass = sum(np.exp(pushes.common[place]) for _, place in pushes.frictions)
    np.testing.assert_allclose(change[:, 1], -mass * 9.81e-3, rtol=0.02)


def test_a_film_under_both_parts_resists_each_by_its_area(jointed):
    pushes = jointed.pushes
    [effect] = PUSHED.create_all(["viscous_support"])
    change = pushes.lack(np.append(pushes.common, 1.0), (effect,), jointed.linear.friction)
    change -= pushes.lack(pushes.common, (), jointed.linear.friction)
    model = pushes.fit.model
    pressed = model.pressed(pushes.kinematics, pushes.common, jointed.linear.friction)
    speeds = [body.part.velocity_of(body.patch.centroid) for body in pressed]
    outlines = [(body.patch.outline, np.roll(body.patch.outline, -1, axis=0)) for body in pressed]
    areas = np.array([abs(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])) for a, b in outlines])
    expected = (areas[0] * speeds[0] + areas[1] * speeds[1]) / areas.sum()
    np.testing.assert_allclose(change[:, :2], expected, atol=0.05 * np.abs(expected).max())


def test_no_model_is_questioned_on_a_guess(jointed, monkeypatch):
    class Seen:
        slack = None
        hinge = replace(jointed.pushes.fit.model.hinge, turned=0.05)
        probability = {"rigid": 0.6, "jointed": 0.35, "separate": 0.05}
        name = "undecided"

    class Parts:
        structure = Seen()
        telling_push = TellingPush(0, np.zeros(2), np.array([1.0, 0.0]), 0.5, 0.03, 0.2, 0.04)

    parts = Parts()
    with pytest.raises(
        NotIdentifiableError, match=r"undecided \(rigid 0.60.*push sideways.*link_1"
    ):
        two_parts._decided(parts)
    parts.structure.name = "separate"
    with pytest.raises(NotIdentifiableError, match="one by one"):
        two_parts._decided(parts)
    parts.structure.name = "jointed"
    with pytest.raises(
        NotIdentifiableError, match="turned by 2.9 degrees only, expected 5: push so.*link_1 at"
    ):
        two_parts._decided(parts)
    monkeypatch.setattr(two_parts, "_decided", lambda pair: "jointed")
    monkeypatch.setattr(two_parts.Pair, "of_streams", lambda streams: parts)
    with pytest.raises(BadInputError, match="loose_joint: has no law for jointed parts"):
        TwoParts.of_streams(None, PUSHED.create_all(["loose_joint"]))


def test_a_lean_is_foretold_in_pushes_of_either_part_where_the_tip_sticks(jointed):
    pushes, [lean] = jointed.pushes, PUSHED.create_all(["support_tilt"])
    steady, common = pushes.steady(), pushes.common
    level = steady.predict(common, ())
    size = np.linalg.norm(level[:, :2], axis=1)
    whole = 9.81 * sum(np.exp(common[product]) for product, _ in pushes.frictions)
    assert np.all(size < 1.1 * whole)  # both slide together at most
    assert np.abs(np.sum(level[:, :2] * steady.pushes.way, axis=1) / size).min() > 0.9
    away = steady.predict(np.append(common, [0.02, -0.01]), (lean,)) - level
    mass = sum(np.exp(common[place]) for _, place in pushes.frictions)
    pulled = mass * 9.81 * np.array([-0.02, 0.01])
    np.testing.assert_allclose(np.median(away[:, :2], axis=0), pulled, rtol=0.05)
    np.testing.assert_allclose(away[:, :2], np.tile(pulled, (len(away), 1)), rtol=0.2)
    assert {*steady.pushes.part} == {0, 1}


def test_the_push_that_tells_a_lean_from_a_film_names_a_place_of_a_part(model):
    pushes = model.pushes
    lean, film = (PUSHED.create_all([name]) for name in ("support_tilt", "viscous_support"))
    steady, common = pushes.steady(), pushes.common

    def best(predict):
        return predict(np.append(common, [0.03, 0.0]), lean)

    rivals = {"viscous_support": lambda predict: predict(np.append(common, 3.0), film)}
    plan = plan_push(best, rivals, steady, 0.003)
    assert plan["separates_from"] == ["viscous_support"]
    assert plan["differs_by_n"] > 0.2
    part = int(plan["link"][-1]) - 1
    point, outline = np.array(plan["point"]), pushes.fit.model.data.patches[part].outline
    assert abs(distance_outside(outline, point[None])[0]) < 1e-6
    words = plan["description"]
    assert words.startswith(f"push {plan['link']} at ({1e3 * point[0]:.0f}, {1e3 * point[1]:.0f})")
    assert f"towards {plan['heading_deg']:.0f} deg" in words
    assert words.endswith(f"the forces differ there by {plan['differs_by_n']:.2f} N")
    assert plan_push(best, {"same": best}, steady, 0.003) is None


def test_an_estimate_of_two_parts_takes_effects_that_have_a_law_there():
    actions = replace(ACTIONS, count=3)
    options = pushed.PushOptions(kind="rigid_pair", actions=actions)
    [made] = pushed.generate([100], {"support_tilt": 1.5}, options)
    found = estimate(made.streams, ["support_tilt"])
    assert found.structure == "rigid"
    told, truth = found.effects["support_tilt"], made.truth()["effects"]["support_tilt"]
    for name, way in zip(("t_x", "t_y"), truth["parameters"]["direction"], strict=True):
        away = told[name]["value"] - truth["parameters"]["angle"] * way
        assert abs(away) < 3.0 * told[name]["std"]
    assert found.covariance_names[-2:] == ("support_tilt.t_x", "support_tilt.t_y")
    assert found.covariance.shape == (len(found.covariance_names),) * 2
