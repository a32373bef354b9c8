"""Pulls, hard stops and shakes: where they hold, when they are chosen, what they move."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.actions.affordances import (
    ExploreConfig,
    Surroundings,
    fits,
    pulls,
    pushes,
)
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer
from tactile_dynamics_ros.core.planar.actions.grips import grasps
from tactile_dynamics_ros.core.planar.actions.information import (
    Belief,
    PredictedObject,
    expected_gain,
    informations,
    updated,
)
from tactile_dynamics_ros.core.planar.control.performance import (
    Guard,
    GuardConfig,
    Performance,
    Seen,
    WayConfig,
    action_of,
)
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTable, SimulatedTableConfig

BOX = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
TRIANGLE = np.array([[-0.05, -0.03], [0.05, 0.0], [-0.05, 0.03]])
THING = PredictedObject(BOX, points=16)
ALL = ("push", "stop", "pull", "shake")
ROOM = (np.array([0.2, -0.45]), np.array([0.85, 0.45]))
QUICK = ExploreConfig(manners=ALL, places=4, speeds=(0.08,))
INSIDE, OUTSIDE = np.array([0.5, 0.0, 0.3]), np.array([0.5, 0.36, 0.3])


def belief(*stds):
    mean = np.array([np.log(0.25), np.log(0.9), 0.0, 0.0])
    return Belief(mean, np.diag(np.square(stds)))


UNKNOWN = belief(0.7, 0.6, 0.01, 0.01)
MASS_WANTED = belief(0.04, 0.6, 0.001, 0.001)


def test_pads_hold_opposite_faces_that_are_nearer_than_the_jaws_open():
    found = grasps(BOX, 0.078, 8)
    assert found
    for grasp in found:
        assert grasp.width == pytest.approx(0.06)
        assert_allclose(np.abs(grasp.closing), [0.0, 1.0], atol=1e-9)
        assert grasp.middle[1] == pytest.approx(0.0, abs=1e-9)
    assert np.ptp([grasp.middle[0] for grasp in found]) > 0.05
    assert not grasps(BOX, 0.06, 8)


def test_faces_that_are_not_opposite_are_not_gripped():
    assert not grasps(TRIANGLE, 0.078, 8)


def test_pads_come_down_beside_other_parts():
    beside = BOX + [0.0, 0.065]  # 5 mm are left between them
    assert not grasps(BOX, 0.078, 8, [beside])
    half = beside * [0.5, 1.0] + [0.025, 0.0]  # beside the right half alone
    assert all(grasp.middle[0] < 0.0 for grasp in grasps(BOX, 0.078, 8, [half]))


def test_well_inside_it_pushes_where_the_place_decides():
    explorer = Explorer(THING, replace(QUICK, inside="place"), room=ROOM)
    assert explorer.choose(UNKNOWN, INSIDE).candidate.manner in ("push", "stop")


def test_near_the_border_it_pulls_the_object_inwards():
    choice = Explorer(THING, QUICK, room=ROOM).choose(UNKNOWN, OUTSIDE)
    assert choice.candidate.grips
    around = Surroundings(OUTSIDE)
    assert QUICK.beyond_border(around.moved(choice.candidate)) < 0.02
    assert "near the border objects are pulled" in choice.because
    assert choice.to_json(OUTSIDE)["kind"] == choice.candidate.manner


def test_near_the_border_what_no_grip_holds_is_pushed_and_that_is_said():
    thing = PredictedObject(TRIANGLE, points=16)
    choice = Explorer(thing, QUICK, room=ROOM).choose(UNKNOWN, OUTSIDE)
    assert not choice.candidate.grips
    assert "no grip pulls it away from the border" in choice.because


def along_pads(found):
    return [c for c in found if abs(c.direction @ c.normal) < 0.5]


def test_a_load_beyond_the_friction_of_the_pads_is_not_pulled_along_them():
    heavy = Belief(np.array([np.log(0.8), np.log(1.5), 0.0, 0.0]), MASS_WANTED.covariance)
    explorer = Explorer(THING, QUICK, room=ROOM)
    for known, held in ((MASS_WANTED, True), (heavy, False)):
        found = explorer._pulls(known, Surroundings(INSIDE, room=ROOM))
        assert bool(along_pads(found)) == held


def test_a_shake_far_from_the_centre_of_mass_would_turn_in_the_grip():
    mean = np.array([np.log(0.4), np.log(1.4), 0.0, 0.0])
    known = Belief(mean, belief(0.04, 0.1, 1e-3, 1e-3).covariance)
    found = Explorer(THING, QUICK, room=ROOM)._pulls(known, Surroundings(INSIDE, room=ROOM))
    levers = {
        manner: max(
            abs(c.point[0])
            for c in found
            if c.manner == manner and abs(c.direction @ c.normal) > 0.5
        )
        for manner in ("pull", "shake")
    }
    assert levers["shake"] < 0.03 < levers["pull"]


@pytest.mark.parametrize("manners", [("push", "stop"), ALL])
def test_where_the_mass_is_wanted_a_stop_or_a_shake_is_chosen_over_slow_pushes(manners):
    explorer = Explorer(THING, replace(QUICK, manners=manners), room=ROOM)
    choice = explorer.choose(MASS_WANTED, INSIDE)
    assert isinstance(choice, Choice)
    assert choice.candidate.manner in ("stop", "shake")
    assert "tells mass from friction" in choice.because


def test_a_shake_tells_more_of_the_mass_than_the_same_pull():
    around = Surroundings(INSIDE, room=ROOM)
    found = pulls(BOX, QUICK, around)
    stds = {}
    for manner in ("pull", "shake"):
        first = next(c for c in found if c.manner == manner)
        information = informations(THING, UNKNOWN, [first])[0]
        stds[manner] = updated(UNKNOWN, information).std[1]
    assert stds["shake"] < 0.6 * stds["pull"]


def test_gain_of_some_parameters_leaves_the_others_out():
    information = np.diag([0.0, 30.0, 1e6, 1e6])
    mass = np.array([False, True, False, False])
    gain = expected_gain(UNKNOWN, information[None], mass)[0]
    assert gain == pytest.approx(0.5 * np.log(1.0 + 30.0 * 0.36))


def test_the_tip_comes_down_clear_of_other_parts():
    other = BOX + [0.102, 0.0]
    around = Surroundings(INSIDE, others=(other,), room=ROOM)
    kept = [c for c in pushes(BOX, QUICK) if fits(c, around)]
    assert 0 < len(kept) < len(pushes(BOX, QUICK))
    assert all(c.point[0] < 0.049 for c in kept)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"manners": ("throw",)}, "push, stop, pull, shake"), ({"inside": "never"}, "gain or place")],
)
def test_manners_that_do_not_exist_are_refused(options, words):
    with pytest.raises(BadInputError, match=words):
        ExploreConfig(**options)


@pytest.fixture
def table():
    config = SimulatedTableConfig(object_number=126, seed=3, vision_rate_hz=30.0, depth_rate_hz=0)
    made = SimulatedTable(config)
    yield made
    made.world.close()


def seen(table):
    pose = table.outlines[0].pose()
    flat = np.array([*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])])
    return Seen(table.world.time, table.pusher.frame.copy(), flat, table.world.time)


@pytest.mark.parametrize("manner", ["pull", "shake"])
def test_a_chosen_pull_moves_the_object_along_and_lets_it_go(table, manner):
    part = table.outlines[0]
    thing = PredictedObject(part.corners, push_height=0.012)
    before = seen(table)
    border = {"inside_low": (0.5, 0.4), "inside_high": (0.7, 0.45)}  # it lies outside
    config = replace(QUICK, manners=(manner,), **border)
    choice = Explorer(thing, config, room=ROOM).choose(UNKNOWN, before.pose)
    way = replace(WayConfig(), grip_time=2.0, travel_speed=0.6)
    action = action_of(choice.candidate, before, way, 0.0, 0.006, 0.006)
    performance, most = Performance(action, Guard(GuardConfig())), 0.0
    while not performance.finished:
        target = performance.advance(seen(table))
        pose = np.eye(4)
        c, s = np.cos(target[3]), np.sin(target[3])
        pose[:2, :2], pose[:3, 3] = [[c, -s], [s, c]], target[:3]
        table.pusher.go_to(pose)
        table.pusher.open_to(performance.width)
        measured = [
            np.linalg.norm(f.force) for f in table.advance(looking=False).touch if f.touching
        ]
        most = max([most, *measured])
    after = seen(table)
    assert not performance.why
    wanted = Surroundings(before.pose).moved(choice.candidate)
    assert_allclose(after.pose[:2], wanted, atol=2e-3)
    assert after.pose[2] == pytest.approx(before.pose[2], abs=0.02)
    assert config.beyond_border(after.pose[:2]) < config.beyond_border(before.pose[:2]) - 0.02
    assert 10.0 < most < GuardConfig().most_force
    assert table.pusher.width < 0.002  # closed again, for pushes
    assert after.tip[2] == pytest.approx(way.clearance, abs=1e-3)
