"""The benchmark of models of pushing: what it counts of intervals, and what pads feel of a pull."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.planar import choices
from benchmarks.planar.__main__ import Kept, calibration, table
from benchmarks.planar.ablations import Clipped
from benchmarks.planar.daily import daily_things
from benchmarks.planar.pictures import draw_beliefs, draw_errors, traced
from benchmarks.planar.scores import nrmse, scored
from benchmarks.planar.trial import SETTINGS, Population, _distance
from tactile_dynamics_ros.cli import train_pushing_rounds
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.synthetic.pushed.objects import GRAVITY
from tactile_dynamics_ros.synthetic.pushed.recordings import PushOptions, draw_scene, generate
from tactile_dynamics_ros.synthetic.pushed.sensed import arrived, force_of_pads, pulled
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions


def told(z, **more):
    return {"z": {"m1": [z], "com1": [0.0, 2.0 * z]}, **more}


def test_intervals_are_counted_where_something_is_stated():
    times = {"nees": 2.0, "step_ms": 3.0, "step_ms_p99": 5.0}
    rows = [told(1.0, **times), told(-3.0, **times), {"z": {}, **times}]
    found = calibration(rows)
    assert found["inside_90"] == {"m1": 0.5, "com1": 0.5}
    assert found["stated"] == {"m1": 2, "com1": 4}
    assert found["worst_z"] == 6.0
    assert found["within_3"] == [1, 2]
    assert found["nees"]["mean"] == 2.0


def test_refused_fits_are_counted_and_told():
    found = calibration([told(0.5, cpu_s=2.0), {"z": {}, "refused": "too little"}])
    assert (found["refused"], found["cpu_s"]) == (1, 2.0)
    values = [{"m1": 1.2, "f1": 0.3, "com1": 0.0}] * 2
    truths = [{"m1": 1.0, "f1": 0.3, "com1": 0.0}] * 2
    scores = scored(values, truths, dict.fromkeys(truths[0], 2.0))
    assert scores["m1"]["mean"] == pytest.approx(0.1)
    rows = {"prior mean": scores, "estimate": scores | found}
    said = table("single", {"setting": "slow", "action": "push", "n": 2, "filter": rows})
    assert "2.0 s, 1 refused" in said
    assert "m1 100% of 1" in said


def test_an_unknown_centre_is_guessed_to_lie_as_far_off_as_it_does_on_average():
    assert _distance(np.zeros(2), 1e-4 * np.eye(2)) == pytest.approx(
        0.01 * np.sqrt(np.pi / 2), 0.03
    )
    assert _distance(np.array([0.02, 0.0]), 1e-12 * np.eye(2)) == pytest.approx(0.02, rel=1e-4)


def test_errors_are_over_the_range_of_the_set():
    assert nrmse(np.array([3.0, -4.0]), 10.0)["mean"] == pytest.approx(np.sqrt(12.5) / 10.0)


def test_a_step_in_which_the_pusher_jumps_begins_where_it_arrives():
    place = np.zeros((12, 2))
    place[:, 0] = 1e-5 * np.arange(12)
    assert arrived(place, 2, 10) == 2
    place[6:] += 0.1
    assert arrived(place, 2, 10) == 6
    turned = np.zeros((12, 3))
    turned[7:, 2] = 2.0
    assert arrived(turned, 2, 10) == 7


def test_pads_feel_the_sum_of_forces_and_their_torque_about_the_gripper():
    count = 300
    point = np.zeros((count, 3, 2))
    point[:, 1], point[:, 2] = [0.1, 0.03], [0.1, -0.03]
    force = np.zeros((count, 3, 2))
    force[:, 1], force[:, 2] = [1.0, -5.0], [0.5, 5.0]
    pusher = np.column_stack([0.1 + 1e-4 * np.arange(count), np.zeros(count), np.zeros(count)])
    motion = SimpleNamespace(
        pusher=pusher, point=point, force=force, touched=np.zeros(count, dtype=int)
    )
    scene = SimpleNamespace(tip=SimpleNamespace(height=0.02))
    moved = pulled(scene, motion, 0, 0.01)
    assert moved.grip
    measured = force_of_pads(motion, slice(1, 10), moved, np.zeros((2, 2)))
    np.testing.assert_allclose(measured.value, [1.5, 0.0, -0.015], atol=1e-12)


def test_daily_objects_have_their_published_numbers_and_do_not_tip_over():
    things = daily_things()
    assert len(things) == 8
    hammer = things[164].links[0]
    assert (hammer.mass, hammer.friction, hammer.com[0]) == (1.2, 0.2, 0.07)
    for number, thing in things.items():
        link = thing.links[0]
        assert draw_scene(number, PushOptions(things=things)).thing is thing
        assert link.friction * link.height < 0.5 * np.ptp(link.corners, axis=0).min()


def test_clipped_hypotheses_lie_on_the_edge_of_what_is_possible():
    block = 0.05 * np.array([[-1.0, -0.6], [1.0, -0.6], [1.0, 0.6], [-1.0, 0.6]])
    process = PatchProcess(block)
    mean, covariance = process.prior
    wide = covariance.copy()
    wide[3, 3] = 0.05**2
    found = Clipped(process, np.zeros(3), np.full(3, 1e-3), None, (mean, wide))
    values, _ = found._hypotheses()
    assert process.feasible(values[:, :5]).all()
    assert np.abs(values[:, 3]).max() == pytest.approx(0.03, abs=1e-4)


def test_needed_pushes_are_read_where_a_curve_crosses_what_all_reach():
    pushes = np.array([10.0, 20.0, 30.0])
    errors = {
        "active": np.array([[1.0, 0.5, 0.3]]),
        "uniform": np.array([[1.0, 1.2, 0.6]]),
        "random": np.array([[1.0, 0.8, 0.5]]),
    }
    found = choices.needed_pushes(pushes, errors)
    assert {name: row[0] for name, row in found.items()} == pytest.approx(
        {"active": 18.0, "uniform": 30.0, "random": 80.0 / 3.0}
    )


def curves_of(*last):
    start = [{"pushes": 10, "error": 1.0}]
    ends = zip(("active", "uniform", "random"), last, strict=True)
    return {name: [*start, {"pushes": 20, "error": end}] for name, end in ends}


def test_a_saving_is_claimed_only_where_its_interval_is_on_one_side():
    clear = choices.compared([curves_of(0.25, 0.5, 0.5), curves_of(0.24, 0.52, 0.5)])
    assert clear["needed"]["uniform"]["mean"] == pytest.approx(20.0)
    saved = clear["saved"]["active beside uniform"]
    assert 0.0 < saved["low"] < saved["mean"] < 0.2
    assert clear["error_ratio"]["active beside random"]["mean"] == pytest.approx(
        np.sqrt(0.25 * 0.24) / 0.5
    )
    mixed = choices.compared([curves_of(0.25, 0.5, 0.5), curves_of(0.6, 0.5, 0.3)])
    saved = mixed["saved"]["active beside uniform"]
    assert saved["low"] < 0.0 < saved["high"]
    about = {"kind": "single", "learnt": choices.TRUE}
    said = choices.table(about | mixed)
    assert said.count("no difference to be seen") == 2
    assert "it needs fewer" in choices.table(about | clear)
    turned = [curves_of(0.5, 0.25, 0.25), curves_of(0.52, 0.25, 0.24)]
    assert "it needs more" in choices.table(about | choices.compared(turned))


def test_intervals_of_two_seeds_are_those_of_student():
    found = choices.interval(np.array([1.0, 3.0]))
    assert found["mean"] == 2.0
    assert found["high"] - 2.0 == pytest.approx(12.706, rel=1e-3)


def test_choices_begin_alike_choose_from_the_same_pushes_and_go_on_from_what_is_kept(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(train_pushing_rounds, "_CANDIDATES", 3)
    monkeypatch.setattr(train_pushing_rounds, "_KEPT", 1)
    keep = Kept(tmp_path, "small").of
    size = choices.Size(objects=2, rounds=2, epochs=2, width=8, judges=2)
    found = choices.measure("single", (1, 2), keep, size)
    assert found["pushes"] == [1, 2]
    first = [found["error"][choice][0] for choice in choices.training.CHOICES]
    assert len(set(map(str, first))) == 1
    last = {found["error"][choice][1]["mean"] for choice in choices.training.CHOICES}
    assert len(last) > 1
    for name in ("learn", "candidate_pushes", "judging_steps"):
        monkeypatch.setattr(train_pushing_rounds, name, lambda *_: pytest.fail("made again"))
    assert choices.measure("single", (1, 2), keep, size) == found


def test_candidates_and_judges_of_a_jointed_pair_are_pushes_of_its_first_link(monkeypatch):
    monkeypatch.setattr(train_pushing_rounds, "_CANDIDATES", 2)
    setting = train_pushing_rounds.SETTINGS["slow"]
    (pushes,) = train_pushing_rounds.candidate_pushes("jointed", [200_000], setting)
    one, other = (push.steps for push in pushes)
    assert [one.push.link, other.push.link] == [0, 0]
    assert one.thing is not other.thing
    np.testing.assert_array_equal(one.parameters[0, :8], other.parameters[0, :8])
    judges = train_pushing_rounds.judging_steps("jointed", 1, setting)
    assert judges.motion.shape[1] == 2
    assert len(judges) < 60


def test_pictures_show_what_is_believed_after_each_interaction():
    actions = replace(SETTINGS["slow"][1], count=2, duration=1.0, travel=0.025)
    sensors = SensorOptions(rate_hz=15.0, force_rate_hz=15.0)
    options = PushOptions(actions=actions, sensors=sensors)
    trace = traced(generate([335], None, options)[0], Population.of("single"), 0)
    assert len(trace.ends) == len(trace.values) == 2
    assert trace.ends[-1] == len(trace.mean) == len(trace.error)
    assert np.all(trace.std[-1] < trace.std[0])
    panels = draw_beliefs({("single", "push"): trace}).axes
    line = panels[0].lines[0].get_ydata()
    np.testing.assert_allclose(line, GRAVITY * np.exp(trace.mean[:, 0]))
    rows = [{"q1": {"mean": 0.2}, "com1": {"mean": 0.3}}, {"q1": {"mean": 0.1}}]
    drawn = [axes.lines for axes in draw_errors({("single", "push"): rows}).axes]
    assert [list(lines[0].get_ydata()) for lines in drawn[:2]] == [[0.2, 0.1], [0.3]]
    assert not drawn[2]
