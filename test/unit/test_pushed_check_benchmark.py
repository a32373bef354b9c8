"""Pushes that `check` proposes are made in the simulator, and bring what was promised."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import pushed_check
from tactile_dynamics_ros.api.pushed_checks import _evenness_is_unknown, _promise, check_pushes
from tactile_dynamics_ros.core.planar.actions.affordances import ExploreConfig, pushes
from tactile_dynamics_ros.core.planar.actions.continuation import continued
from tactile_dynamics_ros.core.planar.actions.information import Belief, PredictedObject
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import straight_push

SLOW = pushed.ActionOptions(count=2, speed=(0.03, 0.04), travel=0.04, duration=1.2, pauses=0)

OPTIONS = pushed.PushOptions(actions=SLOW, sensors=pushed.SensorOptions(systematic=1.0))


@pytest.fixture(scope="module")
def slow():
    """Two slow pushes, which hardly tell the mass."""
    return pushed.generate([25920], {}, OPTIONS)[0]


@pytest.fixture(scope="module")
def checked(slow):
    return check_pushes(PushedRecording(slow.streams, "slow"))


@pytest.fixture(scope="module")
def second(slow, checked):
    return pushed_check.push_on(slow, checked, OPTIONS.sensors)


def test_the_proposed_push_is_recorded_and_tells_what_was_lacking(slow, checked, second):
    both = estimate(pushed_check.join_pushes([slow.streams, second.streams]))
    got = pushed_check.relative(both, slow)[pushed_check.PARAMETERS.index("mass")]
    assert "mass" in checked.lacking
    assert got < 0.7 * checked.relative["mass"]
    assert 1 / 1.5 < got / checked.promised["mass"] < 1.5


def test_it_goes_on_from_where_the_object_lay_with_the_same_sensors_and_new_noise(slow, second):
    before, after = slow.streams.links[0], second.streams.links[0]
    assert after.time[0] < 0.1
    np.testing.assert_allclose(after.pose[:10].mean(0), before.pose[-10:].mean(0), atol=2e-3)
    heights = [made.streams.contacts["pusher"].point[0, 2] for made in (slow, second)]
    assert heights[0] == heights[1] != slow.scene.tip.height
    assert slow.streams.com_height == second.streams.com_height
    count = 20
    white = [link.pose[:count] - link.pose[:count].mean(0) for link in (before, after)]
    assert not np.allclose(*white)


def test_a_planned_push_keeps_its_way_speed_and_accelerations(slow):
    step = 0.002
    for speed, top in ((0.1, 0.1), (0.3, np.sqrt(2 * 0.06 / (1 / 1.0 + 1 / 2.0)))):
        planned = pushed.PlannedPush(np.zeros(2), np.array([0.0, 1.0]), speed, 0.06, 1.0, 2.0)
        path = straight_push(slow.scene.thing, planned, step).path
        pace = np.diff(path[:, 0], prepend=0.0) / step
        forward = pace[pace > 0.0]
        assert path[:, 0].max() == pytest.approx(0.06, abs=3e-4)
        assert forward.max() == pytest.approx(top, abs=5e-3)
        change = np.diff(forward) / step
        assert change.max() == pytest.approx(1.0, abs=1e-6)
        assert change.min() == pytest.approx(-2.0, abs=1e-6)


def test_what_is_proposed_is_what_was_simulated(checked):
    """A hard stop tells a mass half as well as the gentle ramps that were promised."""
    told = checked.to_json()["addition"]
    assert (told["acceleration"], told["braking"]) == (1.0, 1.0)
    assert "from rest to rest at 1 m/s^2" in checked.addition.words


class _Silent:
    """Noise of no size."""

    def normal(self, size):
        return np.zeros(size)


def test_simulated_forces_are_means_between_samples(slow):
    """At single instants the ringing of the tip is aliased."""
    thing = PredictedObject(slow.scene.thing.links[0].corners)
    belief, push = Belief.unknown(thing.outline), pushes(thing.outline, ExploreConfig())[0]
    contact, forces = slow.streams.contacts["pusher"], []
    for period in (0.002, 0.02):
        timed = replace(contact, time=period * np.arange(len(contact.time)))
        streams = replace(slow.streams, contacts={"pusher": timed})
        longer = continued(streams, thing, belief, push, _Silent())
        forces.append(longer.contacts["pusher"].force[len(contact.time) :])
    fine, coarse = forces
    for k in range(1, 6):
        np.testing.assert_allclose(coarse[k], fine[10 * k - 5 : 10 * k + 5].mean(0), rtol=1e-9)
    assert np.abs(fine[10:60:10] - coarse[1:6]).max() > 0.05


def test_no_push_at_one_place_promises_that_the_table_is_even(slow, checked):
    choice, size, share = checked.addition.choice, np.ones(4), 0.07
    here = np.diag([0.02, 0.3, 0.01, 0.01]) ** 2
    lying = np.diag([share, 0.0, 0.0, 0.0]) ** 2
    found = replace(checked.found, here=here, covariance=here + lying)
    after = replace(found, here=here / 4.0, covariance=here / 4.0)
    for one in (found, replace(found, covariance=here)):
        promise = _promise(choice, one, after, size, goal=0.1)
        elsewhere = one.covariance[0, 0] - here[0, 0]
        # 0.3 to 0.1 takes (9 - 1) / (4 - 1) pushes: three, with 1 + 3 * 3 times the information
        assert promise.count == 3
        expected = np.sqrt(here[0, 0] / 10.0 + elsewhere)
        assert promise.relative[0] == pytest.approx(expected)
    told_less = replace(after, covariance=after.covariance + lying)
    promise = _promise(choice, replace(found, covariance=here), told_less, size, goal=0.1)
    assert promise.relative[0] > share


def test_where_an_even_table_is_likeliest_but_not_told_a_promise_says_so(checked):
    here = np.diag([0.02, 0.3, 0.01, 0.01]) ** 2
    wide = here + np.diag([0.07, 0.0, 0.0, 0.0]) ** 2
    untold = replace(checked.found, here=here, covariance=wide, unevenness=0.003)
    assert _evenness_is_unknown(untold)
    assert not _evenness_is_unknown(replace(untold, covariance=here))
    assert not _evenness_is_unknown(replace(untold, unevenness=0.03))
    said = any("from place to place" in remark for remark in checked.remarks)
    assert said == _evenness_is_unknown(checked.found)
