"""A change is told from friction that differs, at a stated rate; what came with it is diagnosed."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.planar.actions.directions import DirectionExplorer
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, ExploreConfig
from tactile_dynamics_ros.core.planar.actions.information import Belief, PredictedObject
from tactile_dynamics_ros.core.planar.diagnosis import changed
from tactile_dynamics_ros.core.planar.filter.change import ChangeConfig, ChangeMonitor
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, SeenPose
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

BOX = np.array([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]])
MEAN = np.array([np.log(0.3), np.log(1.0), 0.0, 0.0])
KNOWN = np.diag(np.square([0.02, 0.3, 1e-3, 1e-3]))
STEP, SPEED = 0.01, 0.1


STATE_STD = np.diag(np.square([2e-4, 2e-4, 1e-3, 2e-3, 2e-3, 0.05]))


def monitor(config=None):
    made = ChangeMonitor(PatchProcess(BOX), config)
    made.refer(MEAN, KNOWN)
    return made


def push(watch, rng, start, heading, pull=(0.0, 0.0), factor=1.0, spread=0.05, bend=0.0):
    """Show a push of 60 mm, seen at 50 Hz, over friction that differs every 20 mm.

    The filter believes that the object moves `bend` rad off where it does, as it would after
    forces that it cannot explain.
    """
    way, off = (np.array([np.cos(a), np.sin(a)]) for a in (heading, heading + bend))
    for k in range(60):
        if k % 20 == 0:
            here = factor * (1.0 + spread * rng.standard_normal())
        before = np.append(SPEED * STEP * k * way, 0.0)
        motion = PusherMotion(before, before + np.append(SPEED * STEP * way, 0.0), STEP)
        force = 9.81 * 0.3 * here * way - pull + 0.03 * rng.standard_normal(2)
        state = np.concatenate([before, SPEED * off, [0.0]]), STATE_STD
        seen = before + [5e-4, 5e-4, 3e-3] * rng.standard_normal(3)
        poses = (SeenPose(seen, np.array([5e-4, 5e-4, 3e-3]), STEP),) if k % 2 else ()
        watch.see(start + STEP * k, state, motion, MeasuredWrench(force, np.full(2, 0.03)), poses)
    watch.release(start + 0.6)


def test_a_lean_is_noticed_within_seconds_of_touch_and_friction_that_differs_is_not():
    rng, watch = np.random.default_rng(5), monitor()
    for k in range(60):
        push(watch, rng, 2.0 * k, 2.4 * k)
    assert watch.alarm is None
    assert watch.calm
    began = watch.touch
    for k in range(60, 66):
        push(watch, rng, 2.0 * k, 2.4 * k, pull=(0.6, 0.3))
    assert watch.alarm is not None
    assert watch.alarm.touch - began < 3.0
    assert watch.alarm.since == pytest.approx(120.0, abs=3.0)
    assert not watch.calm
    assert "slides unlike before" in watch.alarm.text


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_another_friction_is_noticed_and_told_as_one(factor):
    rng, watch = np.random.default_rng(6), monitor()
    for k in range(6):
        push(watch, rng, 2.0 * k, 2.4 * k, factor=factor)
    assert watch.alarm is not None
    assert watch.change.friction == pytest.approx(factor - 1.0, abs=0.1)
    assert np.linalg.norm(watch.change.force) < 0.3


@pytest.mark.parametrize("seed", [24, 27, 30])
def test_no_push_from_before_the_change_is_among_those_since(seed):
    """A clean push that chance makes look changed a little would hide what the others lack."""
    rng, watch = np.random.default_rng(seed), monitor()
    for k in range(8):
        push(watch, rng, 2.0 * k, 2.4 * k)
    k = 8
    while watch.alarm is None:
        push(watch, rng, 2.0 * k, 2.4 * k, pull=(0.5, 0.25))
        k += 1
    assert watch.alarm.since > 15.5


def test_what_is_not_known_of_the_reference_raises_no_alarm():
    rng, watch = np.random.default_rng(7), ChangeMonitor(PatchProcess(BOX))
    push(watch, rng, 0.0, 0.0, factor=2.0)
    assert watch.change is None
    assert not watch.watches
    watch.refer(MEAN, KNOWN + np.diag([0.5, 0.0, 0.0, 0.0]))
    push(watch, rng, 2.0, 0.0, factor=1.4)
    assert watch.alarm is None


def test_a_pull_is_measured_though_the_filter_believes_in_a_turn_that_explains_it():
    """Forces bend the believed motion; what poses say of it tells pull and friction apart."""
    rng, watch = np.random.default_rng(8), monitor()
    for k in range(4):
        push(watch, rng, 2.0 * k, 1.6 * k, pull=(0.6, 0.3), spread=0.01, bend=0.3)
    assert watch.change.force == pytest.approx([0.6, 0.3], abs=0.15)
    assert watch.alarm is not None


def test_an_object_whose_motion_is_not_known_tells_nothing():
    """A piece is left out where errors of its motion could turn its friction about."""
    rng, watch = np.random.default_rng(9), monitor()
    wide = 50.0 * STATE_STD
    for k in range(40):
        before = np.append(SPEED * STEP * k * np.array([1.0, 0.0]), 0.0)
        motion = PusherMotion(before, before + [SPEED * STEP, 0.0, 0.0], STEP)
        measured = MeasuredWrench(rng.normal(0.0, 3.0, 2), np.full(2, 0.03))
        seen = SeenPose(before, np.array([0.02, 0.02, 0.5]), STEP)
        watch.see(STEP * k, (np.append(before, [SPEED, 0.0, 0.0]), wide), motion, measured, (seen,))
    watch.release(0.4)
    assert watch.change is None


def test_a_rarer_false_alarm_asks_for_more():
    often, seldom = (monitor(ChangeConfig(false_alarms_per_hour=rate)) for rate in (10.0, 0.1))
    assert often.threshold < seldom.threshold


def test_pushes_after_a_change_go_different_ways():
    thing = PredictedObject(BOX)
    explorer = DirectionExplorer(thing, ExploreConfig(speeds=(0.08,)))
    pose, headings = np.array([0.5, 0.0, 0.3]), []
    while True:
        choice = explorer.choose(Belief.unknown(BOX), pose)
        if not isinstance(choice, Choice):
            break
        headings.append(np.arctan2(*choice.to_json(pose)["direction"][::-1]))
    assert "3 pushes" in choice
    off = np.subtract.outer(headings, headings)
    apart = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi)[~np.eye(3, dtype=bool)]
    assert apart.min() > np.deg2rad(70.0)


def recorded():
    time = np.arange(0.0, 4.0, 0.01)
    link = LinkStream(time, np.zeros((400, 3)), None, BOX)
    many = np.zeros((400, 3))
    contact = PushContact("pusher", time, many, None, time[::2], many[::2], many[::2])
    return PushedStreams((link,), {"pusher": contact})


def test_only_what_came_since_the_change_is_diagnosed_first(monkeypatch):
    asked = []

    def diagnose(streams, effects):
        asked.append(streams.links[0].time[0])
        effect = "friction_change" if asked[-1] == 0.0 else None
        error = {"before": 1.02, "noise_floor": 0.98}
        verdict = "missing_effect" if effect else "unexplained"
        return {"verdict": verdict, "effect": effect, "error": error}

    monkeypatch.setattr(changed, "diagnose_pushes", diagnose)
    check = changed.ChangeCheck()
    check.diagnose(recorded(), ())
    assert asked == [0.0]
    check.since = 2.005
    assert check.diagnose(recorded(), ())["effect"] == "friction_change"
    assert asked[1:] == [pytest.approx(2.01), 0.0]
    cut = changed.streams_since(recorded(), 2.005).contacts["pusher"]
    assert len(cut.time) == 199
    assert len(cut.point) == len(cut.pose_time) == 99
