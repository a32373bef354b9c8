"""Looks at a table: which points are used, which object is kept to, and what is said of others."""

import numpy as np
import pytest
import trimesh

from benchmarks.following.stage import LENS, Stage
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.shape.superquadric.looking import (
    LookingConfig,
    Looks,
    cloud_of,
    judge,
)
from tactile_dynamics_ros.core.shape.superquadric.views import ViewConfig, looking_at

LARGE, SMALL = np.array([0.5, 0.0]), np.array([0.5, 0.085])


def block(x, y, z, at):
    return trimesh.creation.box((x, y, z)).apply_translation([*at, 0.5 * z])


@pytest.fixture(scope="module")
def pair():
    """A box of 140 x 80 x 60 mm, and a small one 3 cm beside it; a tenth strays."""
    stage = Stage([block(0.14, 0.08, 0.06, LARGE), block(0.04, 0.03, 0.05, SMALL)], 3)
    yield stage
    stage.close()


def photo(stage, pose, shown=True):
    stage.place((np.eye(4), np.eye(4)) if shown else (), None)
    return stage.measure(pose)


def camera(turn, target=(0.5, 0.05, 0.02), away=0.5):
    target = np.array(target)
    direction = np.array([np.cos(turn), np.sin(turn), 1.0]) / np.sqrt(2.0)
    return looking_at(target + away * direction, target)


def looks_at(stage, turns, **config):
    looks = Looks(LookingConfig(**config), ViewConfig(), 0.0)
    for pose in map(camera, turns):
        looks.add(photo(stage, pose), LENS.intrinsics, pose)
        sight = judge(looks)
        looks.take(sight)
    return looks, sight


def test_points_of_the_table_and_lonely_ones_are_left_out(pair):
    looks = Looks(LookingConfig(most_points=500), ViewConfig(), 0.0)
    pose = camera(0.3)
    depth = photo(pair, pose)
    looks.add(depth, LENS.intrinsics, pose)
    (cloud,) = looks.clouds
    every, _ = cloud_of(depth, LENS.intrinsics, pose)
    assert len(cloud) == 500 and cloud[:, 2].min() > 0.004
    assert beside(every[every[:, 2] > 0.004]) > 0.2
    assert beside(cloud) < 0.03


def beside(points):
    """Share of points that are farther than 6 mm from the box around each object."""
    off = [
        np.max(np.abs(points - [*at, 0.5 * height]) - [0.5 * x, 0.5 * y, 0.5 * height], axis=1)
        for (x, y, height), at in (((0.14, 0.08, 0.06), LARGE), ((0.04, 0.03, 0.05), SMALL))
    ]
    return np.mean(np.min(off, axis=0) > 0.006)


def test_an_empty_table_is_told(pair):
    looks = Looks(LookingConfig(clearance=0.05), ViewConfig(), 0.0)
    pose = camera(0.0)
    with pytest.raises(BadInputError, match="nothing on the table"):
        looks.add(photo(pair, pose, shown=False), LENS.intrinsics, pose)


@pytest.mark.parametrize(("number", "place", "other"), [(1, LARGE, SMALL), (2, SMALL, LARGE)])
def test_later_looks_keep_to_the_object_that_was_asked_for(pair, number, place, other):
    """Also to a small one, whose larger neighbour reaches into what is looked at."""
    looks, sight = looks_at(pair, (0.3, 2.4), object=number)
    told = looks.to_json(sight)
    (part,) = told["parts"]
    assert [part["x"], part["y"]] == pytest.approx(place, abs=4e-3)
    assert told["looks"] == 2
    (said,) = [text for text in told["remarks"] if "objects" in text]
    x, y = (float(word.strip(",")) for word in said.split()[-4:-1:2])
    assert f"2 objects: this is {number}" in said
    assert [1e-3 * x, 1e-3 * y] == pytest.approx(other, abs=0.01)


def test_an_object_that_is_not_there_is_told(pair):
    with pytest.raises(BadInputError, match="object 3: 2 objects were found"):
        looks_at(pair, (0.3,), object=3)


def test_looking_ends_after_the_looks_that_are_allowed(pair):
    looks, sight = looks_at(pair, (0.3,), most_looks=1)
    assert looks.finished and sight.view is None
    assert sight.scene.next_views[0] is not None
