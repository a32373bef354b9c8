"""A straight push: where it goes, how fast, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.actions.straight import (
    Leg,
    StraightConfig,
    Travel,
    freeing,
    straight_action,
)

NOW = np.array([0.3, -0.2, 0.3, 0.4])
START, END = np.array([0.45, 0.0]), np.array([0.55, 0.05])
CONFIG = StraightConfig()
SLOW = Travel(0.05, CONFIG.acceleration)


STEP = 0.01


def sampled(action, step=STEP):
    """Return names of legs, places (K, 3), widths and turns (K,) at even times."""
    moments = [action.at(t) for t in np.arange(0.0, action.duration + 0.1, step)]
    places = np.array([moment.pose[:3, 3] for moment in moments])
    turns = np.array([np.arctan2(m.pose[1, 0], m.pose[0, 0]) for m in moments])
    return [m.leg for m in moments], places, np.array([m.width for m in moments]), turns


def test_a_push_is_one_path_without_jumps_that_passes_through_both_places():
    legs, places, widths, turns = sampled(straight_action(NOW, START, END, SLOW, CONFIG))
    assert list(dict.fromkeys(legs)) == ["travel", "descend", "push", "retreat", "rise"]
    assert_allclose(places[0], NOW[:3])
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / STEP
    assert speed.max() < CONFIG.travel_speed + 1e-6
    assert np.abs(np.diff(speed)).max() < 1.01 * STEP * CONFIG.acceleration
    along = places[[leg == "push" for leg in legs]]
    assert_allclose(along[[0, -1]], [[*START, CONFIG.height], [*END, CONFIG.height]], atol=1e-4)
    assert_allclose(turns, NOW[3], atol=1e-12)
    assert not widths.any()
    descending = places[[leg == "descend" for leg in legs]]
    assert_allclose(descending[:, :2], np.broadcast_to(START, descending[:, :2].shape))


@pytest.mark.parametrize("length", [0.001, 0.3])
def test_speed_is_a_trapezoid_or_a_triangle(length):
    leg = Leg("push", np.zeros(4), np.array([length, 0.0, 0.0, 0.0]), 0.0, Travel(0.1, 1.0))
    time = np.linspace(0.0, leg.duration, 501)
    x = np.array([leg.at(t)[0] for t in time])
    speed = np.gradient(x, time)
    assert x[-1] == pytest.approx(length)
    assert speed.max() == pytest.approx(min(0.1, np.sqrt(length)), rel=5e-3)
    expected = np.minimum(np.minimum(time, time[-1] - time), 0.1)
    assert_allclose(speed[1:-1], expected[1:-1], atol=4e-3)


def test_a_pull_stands_across_the_way_grips_and_lets_go():
    legs, _, widths, turns = sampled(straight_action(NOW, START, END, SLOW, CONFIG, pull=True))
    assert list(dict.fromkeys(legs))[-5:] == ["grip", "pull", "release", "rise", "close"]
    pulling = np.array([leg in ("grip", "pull") for leg in legs])
    assert legs.index("descend") - legs.index("open") == round(CONFIG.grip_time / STEP)
    closing = np.array([leg == "close" for leg in legs])
    assert not widths[pulling | closing].any()
    assert_allclose(widths[~pulling & ~closing], CONFIG.opening)
    way = np.arctan2(*(END - START)[::-1])
    assert np.sin(turns[pulling] - way) == pytest.approx(0.0, abs=1e-9)
    assert np.abs(turns - NOW[3]).max() < np.pi / 2.0 + 1e-9  # the jaws are alike: least turn


def test_the_table_lifts_all_heights():
    _, low, *_ = sampled(straight_action(NOW, START, END, SLOW, CONFIG))
    _, high, *_ = sampled(straight_action(NOW + [0, 0, 0.1, 0], START, END, SLOW, CONFIG, 0.1))
    assert high[:, 2].min() == pytest.approx(low[:, 2].min() + 0.1)


@pytest.mark.parametrize(
    ("end", "speed", "complaint"),
    [(START, 0.1, "is no way"), (END, 0.0, "speed 0.0"), (END, 3.0, "at most 2")],
)
def test_a_push_that_makes_no_sense_is_refused(end, speed, complaint):
    with pytest.raises(BadInputError, match=complaint):
        straight_action(NOW, START, end, Travel(speed, 1.0), CONFIG)


def test_the_simulator_refuses_scenes_and_objects_that_do_not_exist(capsys):
    assert main(["sim", "--scene", "moon"]) == 2
    assert "expected hand or table" in capsys.readouterr().err
    assert main(["sim", "--scene", "table", "--object", "mug"]) == 2
    assert "expected a number" in capsys.readouterr().err


def test_a_hard_stop_takes_its_own_deceleration_and_the_same_way():
    travel = Travel(0.3, 2.0, 10.0)
    time = np.linspace(0.0, travel.duration(0.1), 2001)
    way = travel.at(time, 0.1)
    rate = np.gradient(np.gradient(way, time), time)
    assert way[-1] == pytest.approx(0.1)
    assert rate[5] == pytest.approx(2.0, rel=0.01)
    assert rate[-6] == pytest.approx(-10.0, rel=0.01)


def test_a_shake_goes_to_and_fro_on_the_way_and_begins_and_ends_at_rest():
    travel, plain = Travel(0.03, 1.0, 0.0, 0.01, 2.0), Travel(0.03, 1.0)
    time = np.linspace(0.0, travel.duration(0.06), 4001)
    shake = travel.at(time, 0.06) - plain.at(time, 0.06)
    assert shake.max() == pytest.approx(0.01, rel=1e-3)
    assert shake.min() > -1e-9
    assert abs(shake[-1]) < 1e-9
    pace = np.gradient(shake, time)
    assert abs(pace[0]) < 1e-3
    assert np.sum(np.diff(np.sign(pace[np.abs(pace) > 1e-4])) != 0) == 7  # four whole periods


def test_jaws_that_hold_something_open_before_they_rise():
    now = np.array([0.5, 0.1, 0.012, 0.3])
    legs, places, widths, _ = sampled(freeing(now, CONFIG, 0.0))
    assert list(dict.fromkeys(legs)) == ["release", "rise", "close"]
    assert_allclose(places[[leg == "release" for leg in legs]], now[None, :3].repeat(200, 0))
    assert_allclose(widths[[leg == "rise" for leg in legs]], CONFIG.opening)
    assert widths[-1] == 0.0
