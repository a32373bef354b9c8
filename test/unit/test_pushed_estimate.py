"""Mass, friction and centre of an object that is pushed: right where told, told where not known."""

import json
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.numerics.bordered import NormalEquations, Solution
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties import fit as fitting
from tactile_dynamics_ros.core.planar.properties.balance import NAMES
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.core.planar.properties.intervals import cut_intervals, smoothed
from tactile_dynamics_ros.core.planar.properties.latent_model import USUAL_FRICTION, Sharpness
from tactile_dynamics_ros.core.planar.properties.optimum import VARIATIONS, Optimum
from tactile_dynamics_ros.core.planar.properties.push_model import USUAL_UNEVENNESS, PushModel
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions

QUICK = ActionOptions(count=2, speed=(0.08, 0.15), travel=0.05)
SLOW = ActionOptions(count=2, speed=(0.02, 0.025), travel=0.04, pauses=0, hard_stop=False)


@pytest.fixture(scope="module")
def quick():
    """Two pushes that stop hard, at 100 Hz."""
    return pushed.generate([7], {}, pushed.PushOptions(actions=QUICK))[0]


@pytest.fixture(scope="module")
def model(quick):
    """Residuals of these pushes, with the first guess of the motion."""
    cut = cut_intervals(quick.streams)
    patch = SupportPatch(np.asarray(quick.streams.links[0].footprint))
    curve, spread = smoothed(cut, cut.poses[0])
    nodes = np.column_stack([curve, np.zeros_like(curve)])
    return fitting._prepared(quick.streams, cut, patch, nodes, spread), nodes


def test_what_two_pushes_tell_is_right(quick):
    found, truth = estimate(quick.streams), quick.truth()["links"][0]
    force, std = found.values["friction_force_n"]
    assert force == pytest.approx(truth["friction_force_n"], rel=0.015)
    assert abs(force - truth["friction_force_n"]) < 3.0 * std
    for axis, name in enumerate(("com_x", "com_y")):
        value, std = found.values[name]
        assert abs(value - truth["com"][axis]) < min(3.0 * std, 2e-3)
    mass, std = found.values["mass"]
    assert abs(mass - truth["mass"]) < 2.0 * std
    assert 0.7 < found.error < 1.2
    assert found.is_answer


def test_slow_pushes_at_15_hz_tell_the_product_alone():
    sensors = SensorOptions(force_rate_hz=15.0, rate_hz=15.0)
    options = pushed.PushOptions(actions=SLOW, sensors=sensors)
    hidden = pushed.generate([8], {}, options)[0]
    found = estimate(hidden.streams)
    assert {"mass", "friction"} <= set(found.undetermined)
    force, std = found.values["friction_force_n"]
    assert abs(force - hidden.truth()["links"][0]["friction_force_n"]) < 3.0 * std
    said = "\n".join(found.lines())
    assert "known only as a product" in said
    assert "mass      " not in said


def test_an_interval_holds_the_table_though_all_pushes_were_on_a_rough_part_of_it():
    """Its places differ from the table as they differ among themselves."""
    options = pushed.PushOptions(
        actions=ActionOptions(count=6, speed=(0.03, 0.2)), variation=0.1, uneven=0.1
    )
    [hidden] = pushed.generate([442], {}, options)
    found = estimate(hidden.streams)
    value, std = found.values["friction_force_n"]
    away = value - hidden.truth()["links"][0]["friction_force_n"]
    assert 0.04 * value < away < 2.5 * std
    assert found.is_answer


def test_gradient_of_the_cost_is_its_derivative(model):
    residuals, nodes = model
    rng = np.random.default_rng(0)
    sharp = Sharpness(5e-3, 3.0, 0.03)
    mean, std = residuals.prior
    common = mean + 0.1 * std * rng.normal(size=len(NAMES))
    common[:2] = np.log(residuals.typical_force / 9.81), np.log(residuals.typical_force / 3.0)
    around = rng.normal(size=nodes.shape) * np.append(residuals.intervals.poses[0].std, [0.01] * 3)
    across = rng.normal(size=len(NAMES)) * std * np.append([0.1, 0.1], np.ones(len(NAMES) - 2))
    here = residuals.linearise(nodes, common, sharp)
    by_formula = 2.0 * (np.sum(here.gradient * around) + here.common_gradient @ across)
    step = 1e-5
    ahead, behind = (
        residuals.linearise(nodes + k * around, common + k * across, sharp).cost
        for k in (step, -step)
    )
    assert (ahead - behind) / (2.0 * step) == pytest.approx(by_formula, rel=1e-3)
    slope = across
    whole = residuals.linearise(nodes, common, sharp, slope).cost
    assert residuals.cost(nodes, common, sharp, slope) == pytest.approx(whole, rel=1e-9)


def test_numbers_move_with_residuals_as_a_fit_of_changed_residuals_does(model):
    residuals, nodes = model
    sharp = Sharpness(5e-3, 3.0, 0.03)
    common = residuals.prior[0].copy()
    common[:2] = np.log(residuals.typical_force / 9.81), np.log(residuals.typical_force / 3.0)
    lack, by_nodes, by_common = residuals.dynamics(nodes, common, sharp)
    change = np.random.default_rng(1).normal(size=(*lack.shape, 2))
    loose = np.broadcast_to(np.repeat([1.0, 1.0], 3), nodes.shape)

    def factored(lack):
        equations = NormalEquations(len(nodes), 6, len(common))
        equations.add(residuals.middle, lack, by_nodes, by_common)
        residuals.add_seen(equations, nodes, common, sharp)
        return equations.factor(loose, np.zeros(len(common)))

    factor = factored(lack)
    moved = factor.moved_by(residuals.middle, change, by_nodes, by_common)
    for k in range(2):
        after = factored(lack + change[:, :, k]).step()[1] - factor.step()[1]
        assert_allclose(moved[:, k], after, rtol=1e-6, atol=1e-12)


def test_the_error_of_a_fit_counts_squares_alone():
    equations = NormalEquations(4, 1, 2)
    equations.count(np.full(12, 2.0))
    found = Solution(np.zeros((4, 1)), np.zeros(2), equations, True)
    before = found.misfit
    equations.add_slope(np.array([100.0, 0.0]), np.array([3.0, 0.0]))
    assert equations.cost < 0.0 < before == found.misfit


def _stopped(fit, common):
    """An optimum that is said to be at these numbers."""
    sharp = fitting.final_sharpness(fit.model, fit.nodes, fit.variation)
    at = Solution(fit.nodes, common, fit.model.linearise(fit.nodes, common, sharp), True)
    return Optimum(at, fit.covariance, 0.0, 0.0, fit.variation)


def test_a_fit_that_stopped_at_odd_numbers_is_made_again_from_usual_ones(quick):
    fit = fitting.fit_push(quick.streams)
    mass, inertia = NAMES.index("ln_mass"), NAMES.index("ln_inertia")
    odd, usual = fit.common.copy(), fit.model.prior[0].copy()
    odd[[mass, inertia]] += 1.5, -1.0
    [other] = fitting._other(fit.model, [_stopped(fit, odd)])
    assert other.solution.common[mass] == pytest.approx(fit.common[mass], abs=0.3)
    usual[:2] = fit.common[0], fit.common[0] - np.log(USUAL_FRICTION)
    assert fitting._other(fit.model, [_stopped(fit, usual)]) == []


def test_where_a_table_is_not_told_even_the_product_is_that_of_a_usual_one(quick):
    fit = fitting.fit_push(quick.streams)
    mass = NAMES.index("ln_mass")
    known, vague = np.array(fit.covariance), np.array(fit.covariance)
    known[mass, mass], vague[mass, mass] = 0.05**2, 0.14**2  # averages double these std
    near = replace(_stopped(fit, fit.common), variation=VARIATIONS[0], covariance=known)

    def told(near, other, evidence):
        return fitting._averaged(
            fit.model, [near, replace(near, variation=other, evidence=evidence)]
        )

    even = told(near, 0.1, -50.0)
    assert even.told_even
    assert even.place_std[0] < USUAL_UNEVENNESS
    for other in (
        told(near, 0.1, -5.0),
        told(near, 0.1, 50.0),
        told(replace(near, covariance=vague), 0.1, -50.0),
    ):
        assert not other.told_even
        assert other.place_std[0] >= USUAL_UNEVENNESS


def test_evidence_of_an_optimum_is_that_of_the_data_at_its_numbers(quick, monkeypatch):
    """Where the slope of the volume led is no evidence: it moves optima, and evidence by little."""
    fit = fitting.fit_push(quick.streams)
    start = _stopped(fit, fit.common).solution
    led = fitting._optimum(fit.model, start, fit.variation)
    monkeypatch.setattr(PushModel, "volume_slope", lambda model, *_: np.zeros(len(start.common)))
    free = fitting._optimum(fit.model, start, fit.variation)
    assert led.solution.common[1] != free.solution.common[1]
    assert led.evidence == pytest.approx(free.evidence, abs=10.0)


def test_where_a_face_carries_moves_a_fit_as_its_interval_says(quick, monkeypatch):
    """One draw of pressure, and outlines aside: fits that are made beside what is stated."""
    fit = fitting.fit_push(quick.streams)
    model, patch, start = fit.model, fit.model.patch, fit.common
    places = [NAMES.index(name) for name in ("ln_product", "com_x", "com_y")]
    found = _stopped(fit, start)
    back = fitting.refit(fit, (), start, fit.variation).common[places]
    draw = 0.1 * np.random.default_rng(3).normal(size=(1, len(patch.share)))
    [[draw]] = patch.balanced(patch.share[None], draw)
    balanced = SupportPatch.balanced

    def stated(aside, amount):
        monkeypatch.setattr(fitting, "_ASIDE", aside)
        monkeypatch.setattr(
            SupportPatch, "balanced", lambda p, load, _: balanced(p, load, amount * draw[None])
        )
        return np.sqrt(np.diag(fitting._by_face(model, found)))[places]

    def moved(other, shift=(0.0, 0.0)):
        begin = start - np.pad(shift, (2, len(start) - 4))
        trial = replace(fit, model=replace(model, data=replace(model.data, patches=(other,))))
        there = fitting.refit(trial, (), begin, fit.variation).common[places]
        return there + [0.0, *shift] - back

    uneven = replace(patch)
    kept = {"centroid": patch.centroid, "offset": patch.offset}
    uneven.__dict__.update(kept, share=patch.share * (1.0 + draw))
    assert_allclose(stated(0.0, 1.0), np.abs(moved(uneven)), rtol=0.3, atol=2e-5)
    shifts = 0.02 * np.sqrt(patch.gyration) * np.eye(2)
    aside = [moved(replace(patch, outline=patch.outline + shift), shift) for shift in shifts]
    assert_allclose(stated(0.02, 0.0), np.hypot(*aside), rtol=0.3, atol=2e-5)


def test_a_force_after_the_last_sample_is_unknown(quick):
    """Sensors that speak while something is touched say nothing of the slide to a stop."""
    last = max(contact.time[-1] for contact in quick.streams.contacts.values())
    cut = cut_intervals(quick.streams)
    after = cut.time > last + cut.step
    assert after.sum() > 5
    assert not cut.measured[after].any()
    assert not cut.touching[after].any()
    assert cut.measured[(cut.time > last - 0.05) & (cut.time <= last)].all()


def test_motions_that_a_light_object_could_make_do_not_count_for_it(model):
    residuals, nodes = model
    common = residuals.prior[0].copy()
    common[:2] = np.log(residuals.typical_force / 9.81), np.log(residuals.typical_force / 5.0)
    slope = residuals.volume_slope(nodes, common, Sharpness(5e-4, 1.0, 0.03))
    assert slope[NAMES.index("ln_mass")] > 0.05


def test_command_estimates_pushes_and_says_what_it_does_not_take(quick, tmp_path, capsys):
    bag = str(PushedRecording(quick.streams, "pushes").to_bag(tmp_path / "pushes"))
    assert main(["estimate", bag, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["model"] == "pushed"
    truth = quick.truth()["links"][0]
    told = document["links"][0]["friction_force_n"]
    assert told["value"] == pytest.approx(truth["friction_force_n"], rel=0.02)
    assert main(["diagnose", bag, bag, "--between", "0,1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["estimate", bag, "--export", "urdf"]) == 2
    assert "--export" in capsys.readouterr().err


def test_pads_that_touch_nothing_are_left_out(quick):
    """A gripper that was open meanwhile sends forces of zero and no place."""
    tip = quick.streams.contacts["pusher"]
    none = np.zeros((0, 3))
    pad = replace(
        tip, name="pad_left", force=0.0 * tip.force, pose_time=np.zeros(0), point=none, normal=none
    )
    both = replace(quick.streams, contacts={"pusher": tip, "pad_left": pad})
    np.testing.assert_array_equal(cut_intervals(both).force, cut_intervals(quick.streams).force)
    with pytest.raises(BadInputError, match="with force and pose"):
        cut_intervals(replace(quick.streams, contacts={"pad_left": pad}))


def test_three_parts_are_refused_in_one_line(quick):
    link = quick.streams.links[0]
    three = type(quick.streams)((link, link, link), quick.streams.contacts)
    with pytest.raises(Exception, match="3 links"):
        estimate(three)


def test_a_first_plan_that_misses_the_optimum_is_followed_by_the_next(monkeypatch, model):
    made = iter([_Fit(True, 9.0), _Fit(True, 0.9)])
    monkeypatch.setattr(fitting, "_staged", lambda model, *_: (model, None))
    monkeypatch.setattr(fitting, "_optima", lambda *_: [])
    monkeypatch.setattr(fitting, "_averaged", lambda *_: next(made))
    assert fitting._best_planned(*model).whitened_rms == 0.9
    made = iter([_Fit(True, 0.9)])
    assert fitting._best_planned(*model).whitened_rms == 0.9
    made = iter([_Fit(True, 3.0), _Fit(False, 1.0)])
    assert fitting._best_planned(*model).whitened_rms == 3.0


class _Fit(NamedTuple):
    converged: bool
    whitened_rms: float
