"""A straight push: where it goes, how fast, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.actions.straight import (
    Leg,
    StraightConfig,
    straight_action,
)

NOW = np.array([0.3, -0.2, 0.3, 0.4])
START, END = np.array([0.45, 0.0]), np.array([0.55, 0.05])
CONFIG = StraightConfig()


STEP = 0.01


def sampled(action, step=STEP):
    """Return names of legs, places (K, 3), widths and turns (K,) at even times."""
    moments = [action.at(t) for t in np.arange(0.0, action.duration + 0.1, step)]
    places = np.array([moment.pose[:3, 3] for moment in moments])
    turns = np.array([np.arctan2(m.pose[1, 0], m.pose[0, 0]) for m in moments])
    return [m.leg for m in moments], places, np.array([m.width for m in moments]), turns


def test_a_push_is_one_path_without_jumps_that_passes_through_both_places():
    legs, places, widths, turns = sampled(straight_action(NOW, START, END, 0.05, CONFIG))
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
    leg = Leg("push", np.zeros(4), np.array([length, 0.0, 0.0, 0.0]), 0.0, 0.1, 1.0)
    time = np.linspace(0.0, leg.duration, 501)
    x = np.array([leg.at(t)[0] for t in time])
    speed = np.gradient(x, time)
    assert x[-1] == pytest.approx(length)
    assert speed.max() == pytest.approx(min(0.1, np.sqrt(length)), rel=5e-3)
    expected = np.minimum(np.minimum(time, time[-1] - time), 0.1)
    assert_allclose(speed[1:-1], expected[1:-1], atol=4e-3)


def test_a_pull_stands_across_the_way_grips_and_lets_go():
    legs, _, widths, turns = sampled(straight_action(NOW, START, END, 0.05, CONFIG, pull=True))
    assert list(dict.fromkeys(legs))[-4:] == ["grip", "pull", "release", "rise"]
    pulling = np.array([leg in ("grip", "pull") for leg in legs])
    assert not widths[pulling].any()
    assert_allclose(widths[~pulling], CONFIG.opening)
    way = np.arctan2(*(END - START)[::-1])
    assert np.sin(turns[pulling] - way) == pytest.approx(0.0, abs=1e-9)
    assert np.abs(turns - NOW[3]).max() < np.pi / 2.0 + 1e-9  # the jaws are alike: least turn


def test_the_table_lifts_all_heights():
    _, low, *_ = sampled(straight_action(NOW, START, END, 0.05, CONFIG))
    _, high, *_ = sampled(straight_action(NOW + [0, 0, 0.1, 0], START, END, 0.05, CONFIG, 0.1))
    assert high[:, 2].min() == pytest.approx(low[:, 2].min() + 0.1)


@pytest.mark.parametrize(
    ("end", "speed", "complaint"),
    [(START, 0.1, "is no way"), (END, 0.0, "speed 0.0"), (END, 3.0, "at most 2")],
)
def test_a_push_that_makes_no_sense_is_refused(end, speed, complaint):
    with pytest.raises(BadInputError, match=complaint):
        straight_action(NOW, START, end, speed, CONFIG)


def test_the_simulator_refuses_scenes_and_objects_that_do_not_exist(capsys):
    assert main(["sim", "--scene", "moon"]) == 2
    assert "expected hand or table" in capsys.readouterr().err
    assert main(["sim", "--scene", "table", "--object", "mug"]) == 2
    assert "expected a number" in capsys.readouterr().err
