"""A change is told from friction that differs, at a stated rate; what came with it is diagnosed."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.planar.actions.directions import DirectionExplorer
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, ExploreConfig
from tactile_dynamics_ros.core.planar.actions.information import Belief, PredictedObject
from tactile_dynamics_ros.core.planar.diagnosis import changed
from tactile_dynamics_ros.core.planar.filter.change import ChangeConfig, ChangeMonitor
from tactile_dynamics_ros.core.planar.filter.observation import FeltWrench
from tactile_dynamics_ros.core.planar.filter.process import Prediction, PusherMotion
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

BOX = np.array([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]])
MEAN = np.array([np.log(0.3), np.log(1.0), 0.0, 0.0, np.log(0.4)])
KNOWN = np.diag(np.square([0.02, 0.3, 1e-3, 1e-3]))
STEP, SPEED = 0.01, 0.1


class Sliding:
    """A model in which the force is friction along the motion of the pusher."""

    links = 1

    def predict(self, states, parameters, motion):
        way = (motion.after - motion.before)[:2]
        force = 9.81 * np.exp(parameters[:, :1]) * way / np.linalg.norm(way)
        return Prediction(states, np.column_stack([force, np.zeros(len(states))]))


def monitor():
    made = ChangeMonitor(Sliding())
    made.refer(MEAN, KNOWN)
    return made


def push(watch, rng, start, heading, pull=(0.0, 0.0), factor=1.0, spread=0.05):
    """Show a push of 60 mm over friction that differs every 20 mm."""
    way = np.array([np.cos(heading), np.sin(heading)])
    for k in range(60):
        if k % 20 == 0:
            here = factor * (1.0 + spread * rng.standard_normal())
        before = np.append(SPEED * STEP * k * way, 0.0)
        motion = PusherMotion(before, before + np.append(SPEED * STEP * way, 0.0), STEP)
        force = 9.81 * 0.3 * here * way - pull + 0.03 * rng.standard_normal(2)
        watch.see(start + STEP * k, np.zeros(6), motion, FeltWrench(force, np.full(2, 0.03)))
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


def test_what_is_not_known_of_the_reference_raises_no_alarm():
    rng, watch = np.random.default_rng(7), ChangeMonitor(Sliding())
    push(watch, rng, 0.0, 0.0, factor=2.0)
    assert watch.change is None
    assert not watch.watches
    watch.refer(MEAN, KNOWN + np.diag([0.5, 0.0, 0.0, 0.0]))
    push(watch, rng, 2.0, 0.0, factor=1.4)
    assert watch.alarm is None


def test_a_rarer_false_alarm_asks_for_more():
    often, seldom = (
        ChangeMonitor(Sliding(), ChangeConfig(false_alarms_per_hour=rate)) for rate in (10.0, 0.1)
    )
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
