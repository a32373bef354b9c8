"""Exploring two parts: first whether a joint holds them, then the numbers of what they are."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.planar.actions.affordances import ExploreConfig
from tactile_dynamics_ros.core.planar.actions.candidate import Candidate
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer
from tactile_dynamics_ros.core.planar.actions.information import (
    Belief,
    PredictedObject,
    informations,
)
from tactile_dynamics_ros.core.planar.actions.pair import (
    JOINTED,
    RIGID,
    PairExplorer,
    PredictedPair,
    joint_shows,
    pair_belief,
)

BOX = np.array([[-0.04, -0.03], [0.04, -0.03], [0.04, 0.03], [-0.04, 0.03]])
BESIDE = np.array([0.084, 0.0, 0.0])
POSES = np.array([[0.4, 0.0, 0.0], BESIDE + [0.4, 0.0, 0.0]])
UNKNOWN = [Belief.unknown(BOX)] * 2
QUICK = ExploreConfig(places=4, speeds=(0.2,), length=0.04, budget=4)


def pair(joint, offset=BESIDE):
    return PredictedPair(BOX, points=16, second=BOX, offset=offset, joint=joint)


def push(point, way):
    way = np.array(way, dtype=float)
    return Candidate(np.array(point), way, way, 0.2, 0.04, 1.0)


def explorer(config=QUICK):
    return PairExplorer([Explorer(PredictedObject(BOX, points=16), config) for _ in range(2)])


def estimate(structure, relative, chance=0.99):
    """An estimate of two parts with one relative std of all that is no place."""
    names = RIGID if structure == "rigid" else JOINTED
    std = [0.05 * relative if name.startswith("com") else relative for name in names]
    value = {"value": 2.0, "std": 1.0}
    place = {"value": [0.042, 0.0], "std": [0.001, 0.001]}
    link = {"friction": {"value": 0.3}, "mass": {"value": 0.5}, "friction_force_n": value}
    others = {"rigid": "jointed", "jointed": "rigid", "undecided": "jointed"}
    return {
        "structure": structure,
        "structure_probability": {
            structure.replace("undecided", "rigid"): chance,
            others[structure]: 1.0 - chance,
        },
        "whole": {"mass": {"value": 1.0}, "friction_force_n": value, "com": place},
        "links": [link | {"carried_at": {"value": [0.0, 0.0]}}] * 2,
        "joint": {"friction_torque_nm": {"value": 0.05}},
        "covariance": {"names": [*names], "matrix": np.diag(np.square(std)).tolist()},
    }


def test_a_joint_shows_in_a_push_across_the_parts_and_not_in_one_along_them():
    mean = np.array([-2.0, -1.0, 0.0, 0.0, -2.0, -1.0, 0.0, 0.0, 0.0])
    along = push((-0.04, 0.0), (1, 0))
    across = push((-0.025, -0.03), (0, 1))
    through, aside = joint_shows(pair(np.array([0.042, 0.0])), mean, 0.01, [along, across])
    assert through < 0.1
    assert aside > 0.3


def test_a_push_along_the_second_part_tells_the_centre_across_it_in_the_first_ones_frame():
    turned = np.array([0.0, 0.074, 0.5 * np.pi])  # its x is the first one's y
    asking = explorer()
    poses = np.array([[0.4, 0.0, 0.0], turned + [0.4, 0.0, 0.0]])
    found = estimate("rigid", 0.3)
    found["whole"]["com"]["value"] = [0.0, 0.037]  # the push goes through it
    belief = pair_belief(found, UNKNOWN, asking._pair(0, poses, False))
    seen = asking._pair(1, poses, False)
    told = asking._told(1, [push((0.04, 0.0), (-1, 0))], belief, seen)[0]
    assert told[2, 2] > 4.0 * told[3, 3]


def test_of_one_body_faces_that_rub_differently_are_known_from_a_push_that_turns_it():
    mean = np.array([np.log(0.3), 0.0, 0.042, 0.0, 0.0])
    belief = Belief(mean, np.diag([0.5, 0.5, 1e-4, 1e-4, 0.5]) ** 2)
    steady, turning = informations(
        pair(None), belief, [push((-0.04, 0.0), (1, 0)), push((-0.025, -0.03), (0, 1))]
    )
    assert turning[4, 4] > 5.0 * steady[4, 4]


def test_each_part_is_asked_once_what_holds_them_and_then_numbers_count():
    asking = explorer()
    said = [asking.choose(None, UNKNOWN, POSES) for _ in range(5)]
    assert [choice.part for choice in said[:2]] in ([0, 1], [1, 0])
    assert all("whether the parts are one body" in choice.because for choice in said[:2])
    assert all("one body" not in choice.because for choice in said[2:4])
    assert said[4] == "4 pushes were made"


def test_where_the_structure_is_known_pushes_narrow_its_numbers_until_they_are_known():
    asking = explorer()
    choice = asking.choose(estimate("rigid", 0.3), UNKNOWN, POSES)
    assert "one body" not in choice.because
    assert choice.gain > 0.0
    assert choice.expected.std.shape == (5,)
    asking.count = QUICK.least
    said = asking.choose(estimate("rigid", 0.01), UNKNOWN, POSES)
    assert said == "what pushes of both parts tell is known to the wanted width"


@pytest.mark.parametrize(("known", "words"), [(7, "mass from friction of part 2"), (8, "joint")])
def test_on_a_joint_it_says_of_which_part_a_push_tells_what(known, words):
    found = estimate("jointed", 0.3)
    covariance = np.diag([1e-8] * 9)
    at = {7: 5, 8: 8}[known]
    covariance[at, at] = 0.25
    found["covariance"]["matrix"] = covariance.tolist()
    choice = explorer().choose(found, UNKNOWN, POSES)
    assert isinstance(choice, Choice)
    assert words in choice.because


def test_a_manner_that_does_not_bring_what_it_promised_gives_way_to_another():
    asking = explorer(replace(QUICK, manners=("push", "stop"), budget=9))
    found = estimate("rigid", 0.3)
    first = asking.choose(found, UNKNOWN, POSES)
    std = np.sqrt(np.diag(found["covariance"]["matrix"]))
    found["covariance"]["matrix"] = np.diag(np.square(0.99 * std)).tolist()  # next to nothing
    second = asking.choose(found, UNKNOWN, POSES)
    assert second.candidate.manner != first.candidate.manner
    kept = asking._kept[RIGID, first.candidate.manner]
    promised = first.expected.std**-2.0 - std**-2.0
    np.testing.assert_allclose(kept * promised, (0.99 * std) ** -2.0 - std**-2.0, rtol=1e-6)


def test_separate_parts_are_pushed_in_turn_each_as_if_it_were_alone():
    asking = explorer()
    said = [asking.choose({"structure": "separate"}, UNKNOWN, POSES) for _ in range(2)]
    assert [choice.part for choice in said] == [0, 1]
    assert asking.count == 2


def test_a_joint_is_where_it_was_found_seen_from_either_part():
    found = {"joint": {"position": [0.043, 0.01]}}
    first, second = (explorer()._pair(k, POSES, True, found) for k in (0, 1))
    np.testing.assert_allclose(first.joint, [0.043, 0.01])
    np.testing.assert_allclose(second.joint, [0.043 - 0.084, 0.01])
    assert explorer()._pair(0, POSES, False, found).joint is None


def test_a_joint_that_hardly_turned_is_turned_before_numbers_are_asked():
    found = estimate("jointed", 0.3)
    found["joint"]["friction_torque_nm"] = None
    choice = explorer().choose(found, UNKNOWN, POSES)
    assert "turns the joint" in choice.because
    arm = np.array([0.042, 0.0]) * (1 - 2 * choice.part) - choice.candidate.point
    way = choice.candidate.direction
    assert abs(arm[0] * way[1] - arm[1] * way[0]) > 0.03  # a lever about where outlines meet
