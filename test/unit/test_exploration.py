"""Exploring: what pushes would tell, which is chosen, when it ends."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.actions.exploration import (
    Choice,
    ExploreConfig,
    Explorer,
    next_choice,
)
from tactile_dynamics_ros.core.planar.actions.information import (
    Belief,
    Candidate,
    PredictedObject,
    SensingConfig,
    expected_gain,
    informations,
    updated,
)

BOX = np.array([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]])
THING = PredictedObject(BOX, points=16)
QUICK = {"places": 4, "speeds": (0.2,), "length": 0.04}
POSE = np.array([0.5, 0.0, 0.3])


def push(point, normal, speed=0.2, acceleration=4.0):
    normal = np.array(normal, dtype=float)
    return Candidate(np.array(point), normal, normal, speed, 0.04, acceleration)


@pytest.fixture(scope="module")
def belief():
    return Belief.unknown(BOX)


def test_a_push_along_an_axis_tells_the_centre_across_it_alone(belief):
    along_x, along_y = informations(
        THING, belief, [push((-0.05, 0.0), (1, 0)), push((0.0, -0.04), (0, 1))]
    )
    before = belief.std
    x, y = updated(belief, along_x).std, updated(belief, along_y).std
    assert x[3] < 0.3 * before[3]
    assert x[2] > 0.8 * before[2]
    assert y[2] < 0.3 * before[2]
    assert y[3] > 0.8 * before[3]


def test_a_hard_stop_tells_more_of_the_mass_than_a_slow_start(belief):
    stds = [
        updated(
            belief, informations(THING, belief, [push((-0.05, 0.01), (1, 0), speed, brake)])[0]
        ).std[1]
        for speed, brake in ((0.2, 8.0), (0.1, 1.0))
    ]
    assert stds[0] < 0.7 * stds[1]


def test_friction_that_varies_from_push_to_push_bounds_what_one_tells_of_it(belief):
    candidate = [push((-0.05, 0.01), (1, 0))]
    for variation in (0.05, 0.2):
        sensing = SensingConfig(variation=variation, local=0.0)
        found = informations(THING, belief, candidate, sensing)[0]
        assert updated(belief, found).std[0] == pytest.approx(variation, rel=0.1)


def test_gain_is_half_the_fall_of_the_log_determinant(belief):
    information = np.diag([10.0, 0.0, 0.0, 4e4])
    after = updated(belief, information)
    fall = np.linalg.slogdet(belief.covariance)[1] - np.linalg.slogdet(after.covariance)[1]
    assert expected_gain(belief, information[None])[0] == pytest.approx(0.5 * fall)


def test_gain_is_the_mean_divergence_of_what_is_believed_after_from_before(belief):
    root = np.random.default_rng(3).normal(size=(4, 4)) / np.array([0.5, 0.5, 0.01, 0.01])[:, None]
    information = root @ root.T
    after = updated(belief, information).covariance
    before = np.linalg.inv(belief.covariance)
    shift = np.random.default_rng(4).multivariate_normal(
        np.zeros(4), belief.covariance - after, 100_000
    )
    square = np.mean(np.sum(shift @ before * shift, axis=1))
    fall = np.linalg.slogdet(belief.covariance)[1] - np.linalg.slogdet(after)[1]
    mean = 0.5 * (np.trace(before @ after) - 4.0 + square + fall)
    assert expected_gain(belief, information[None])[0] == pytest.approx(mean, rel=0.01)


def test_the_most_telling_push_is_chosen_and_beats_chance(belief):
    gains = {}
    for chooser in ("gain", "uniform", "random"):
        explorer = Explorer(THING, ExploreConfig(chooser=chooser, **QUICK))
        choice = explorer.choose(belief, POSE)
        assert isinstance(choice, Choice)
        gains[chooser] = choice.gain
    assert gains["gain"] > max(gains["uniform"], gains["random"]) - 1e-9


def test_it_ends_when_all_is_known_and_says_so():
    known = Belief(np.array([np.log(0.3), 0.0, 0.0, 0.0]), np.diag([1e-4, 1e-4, 1e-7, 1e-7]))
    explorer = Explorer(THING, ExploreConfig(**QUICK))
    explorer.count = 2
    assert "known to the wanted width" in explorer.choose(known, POSE)


def test_it_ends_when_pushes_no_longer_narrow_what_is_wanted(belief):
    stuck = Belief(belief.mean, np.diag([1e-4, 0.25, 1e-8, 1e-8]))
    explorer = Explorer(THING, ExploreConfig(budget=20, **QUICK))
    said = [explorer.choose(stuck, POSE) for _ in range(5)]
    assert all(isinstance(word, Choice) for word in said[:4])
    assert "hardly narrowed" in said[4]
    assert said[4].endswith(": mass")


def test_it_ends_when_the_budget_is_spent_and_names_what_is_wide(belief):
    explorer = Explorer(THING, ExploreConfig(budget=2, **QUICK))
    explorer.count = 2
    said = explorer.choose(belief, POSE)
    assert said.startswith("2 pushes were made")
    assert said.endswith("force, mass, centre")


def test_pushes_stay_where_the_arm_may_be(belief):
    room = (np.array([0.3, -0.3]), np.array([0.52, 0.3]))
    explorer = Explorer(THING, ExploreConfig(**QUICK), room=room)
    explorer, choice = next_choice(explorer, belief, POSE)
    told = choice.to_json(POSE)
    assert told["point"][0] + 0.04 * told["direction"][0] < 0.52
    nowhere = Explorer(THING, ExploreConfig(**QUICK), room=(room[0], room[0] + 0.01))
    assert "no push keeps" in nowhere.choose(belief, POSE)


def test_an_unknown_way_to_choose_is_refused():
    with pytest.raises(BadInputError, match="gain, uniform, random"):
        ExploreConfig(chooser="best")


def test_after_too_much_force_pushes_are_half_as_fast_and_begin_elsewhere(belief):
    explorer = Explorer(THING, ExploreConfig(**QUICK))
    hit = explorer.choose(belief, POSE).candidate
    explorer.soften()
    again = explorer.choose(belief, POSE).candidate
    assert (again.speed, again.acceleration) == (0.5 * hit.speed, 0.5 * hit.acceleration)
    assert np.linalg.norm(again.point - hit.point) > 0.02
    for _ in range(10):
        explorer.soften()
    assert explorer.config.acceleration == 0.1  # the limits of the configuration hold
    around = explorer.around(POSE, ())
    explorer._bad = [candidate.point for candidate in explorer.pushes(around)]
    assert explorer.pushes(around)  # where no other place is left
