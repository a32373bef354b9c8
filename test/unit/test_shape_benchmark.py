"""The benchmark of shapes: objects by number, and one trial of it."""

import numpy as np
import pytest

from benchmarks.shape.trial import run_trial
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.sim.objects import planar_object


def test_an_object_is_the_same_whenever_it_is_drawn():
    first, again = planar_object(57), planar_object(57)
    for one, other in zip(first.parts, again.parts, strict=True):
        np.testing.assert_array_equal(one.corners, other.corners)
        assert (one.height, one.mass, one.friction) == (other.height, other.mass, other.friction)


def test_kinds_outlines_and_ranges_are_those_of_the_file():
    things = {number: planar_object(number) for number in range(1, 157)}
    assert {things[n].kind for n in (1, 40, 121, 132)} == {"homogeneous"}
    assert {things[n].kind for n in (41, 80, 133, 144)} == {"two_parts"}
    assert {things[n].kind for n in (81, 120, 145, 156)} == {"jointed"}
    assert len({things[n].parts[0].outline for n in range(1, 41)}) == 6
    for thing in things.values():
        assert 0.35 <= sum(part.mass for part in thing.parts) <= 1.6
        assert (thing.joint is not None) == (thing.kind == "jointed")
        for part in thing.parts:
            solid = part.solid()
            assert solid.is_watertight
            assert solid.volume > 0.0
            assert 0.15 <= part.friction <= 0.5
    with pytest.raises(BadInputError, match="1 to 164"):
        planar_object(165)


def test_a_trial_grades_what_was_found():
    trial = run_trial(121, looks=1)
    assert not trial.failure
    assert trial.parts == [1]
    assert trial.chamfer[0] < 0.002
    assert max(trial.axes_error) < 0.004


def test_daily_objects_have_their_published_properties():
    things = [planar_object(number) for number in range(157, 165)]
    assert [thing.parts[0].mass for thing in things] == [
        1.0,
        1.1,
        1.61,
        1.24,
        0.67,
        0.35,
        0.82,
        1.2,
    ]
    assert things[-1].kind == "hammer"
    for thing in things:
        part = thing.parts[0]
        assert np.hypot(*part.com) < 0.5 * np.ptp(part.corners[:, 0])
        assert part.solid().is_watertight
