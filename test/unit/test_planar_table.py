"""The simulated table: even pressure, stick and slip at every foot, objects by number, a camera."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.sim.objects import PlanarObject, PlanarPart
from tactile_dynamics_ros.sim.planar.bed import GRAVITY, SINK, Surface, feet_of, uneven_friction
from tactile_dynamics_ros.sim.planar.looking import Carriage
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTable, SimulatedTableConfig
from tactile_dynamics_ros.sim.planar.table import TableWorld, outlines
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig

SIDE, MASS, FRICTION = 0.1, 0.8, 0.3
SQUARE = 0.5 * SIDE * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
BLOCK = PlanarPart("box", SQUARE, 0.04, MASS, FRICTION, np.zeros(2))
MEAN_DISTANCE = 0.3826
"""Of the points of a square from its middle, over its side."""


@pytest.fixture
def world():
    """A square block alone on an even table."""
    thing = PlanarObject(0, "homogeneous", (BLOCK,), None, 0.0)
    with TableWorld(
        [thing], np.array([[0.5, 0.0, 0.4]]), 0.1, Surface(uneven_friction(0.0, 0)), 1e-3
    ) as made:
        made.step(200)
        yield made


def pushed(world, force, torque, count):
    """Push the middle of its base with a force (2,) and a torque about the vertical."""
    lever = np.array([0.02, 0.0, 0.0])

    def push(_):
        body = world.bodies[0]
        middle = body.pose()[:3, 3]
        couple = np.array([0.0, 0.5 * torque / lever[0], 0.0])
        body.push(0, np.array([*force, 0.0]), middle)
        body.push(0, couple, middle + lever)
        body.push(0, -couple, middle - lever)

    world.add_pre_step(push)
    world.step(count)


def test_feet_fill_a_square_evenly():
    places, shares = feet_of(SQUARE)
    assert shares.sum() == pytest.approx(1.0)
    assert_allclose(shares @ places, 0.0, atol=1e-9)
    assert shares @ np.linalg.norm(places, axis=1) == pytest.approx(MEAN_DISTANCE * SIDE, rel=0.01)


@pytest.mark.parametrize(("share", "slides"), [(0.95, False), (1.1, True)])
def test_a_push_slides_the_block_only_beyond_coulombs_limit(world, share, slides):
    before = world.bodies[0].pose()[:2, 3]
    pushed(world, share * FRICTION * MASS * GRAVITY * np.array([0.6, 0.8]), 0.0, 300)
    moved = np.linalg.norm(world.bodies[0].pose()[:2, 3] - before)
    assert (moved > 1e-3) == slides
    if not slides:
        assert moved < SINK  # what the bristles stretch


@pytest.mark.parametrize(("share", "turns"), [(0.93, False), (1.1, True)])
def test_it_resists_a_twist_like_an_even_face_not_like_four_corners(world, share, turns):
    pushed(world, np.zeros(2), share * FRICTION * MASS * GRAVITY * MEAN_DISTANCE * SIDE, 300)
    rate = abs(world.bodies[0].velocity()[0][2])
    assert (rate > 0.05) == turns


def test_friction_varies_as_much_as_told():
    places = np.random.default_rng(1).uniform(-0.5, 0.5, (4000, 2))
    factor = uneven_friction(0.1, 3)(places)
    assert factor.std() == pytest.approx(0.1, abs=0.02)
    assert factor.mean() == pytest.approx(1.0, abs=0.02)


def test_objects_by_number_stand_apart_and_stay():
    table = SimulatedTable(
        SimulatedTableConfig(object_number=85, object_count=3, seed=2, depth_rate_hz=0.0)
    )
    for _ in range(30):
        table.advance()
    told = table.reveal()["objects"]
    assert [len(one["parts"]) for one in told][0] == 2
    assert told[0]["number"] == 85
    assert told[0]["joint"] is not None
    middles = [np.array(one["pose"])[:2, 3] for one in told]
    assert min(np.linalg.norm(a - b) for a in middles for b in middles if a is not b) > 0.05
    for body in table.world.bodies:
        for k in range(len(body.links)):
            assert np.abs(body.velocity(k)[1]).max() < 1e-5
            assert_allclose(body.pose(k), body.pose(0), atol=1e-5)
    table.world.close()


def test_the_camera_moves_at_its_speed_and_stops_where_it_was_told():
    carriage = Carriage(np.eye(4), 0.25)
    target = np.eye(4)
    target[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    target[0, 3] = 0.5
    carriage.go_to(target)
    carriage.advance(1.0)
    assert_allclose(carriage.pose[:3, 3], [0.25, 0.0, 0.0], atol=1e-12)
    carriage.advance(1.01)
    assert_allclose(carriage.pose, target)


def test_stereo_noise_grows_with_the_square_of_the_distance_and_a_tenth_are_strays():
    config = DepthCameraConfig(
        model="zed2i", nearest=0.3, edge_loss=0.0, shadows=False, disparity_noise=0.2
    )
    for distance in (0.5, 1.0):
        seen = DepthCamera(config, 1).degrade(np.full((240, 320), distance, np.float32))
        error = np.abs(seen - distance)
        std = distance**2 * 0.2 / (530.0 * 0.12)
        assert np.median(error[error < 5.0 * std]) == pytest.approx(0.674 * std, rel=0.05)
        assert (error > 5.0 * std).mean() == pytest.approx(0.1, abs=0.035)


def test_the_true_friction_radius_is_that_of_a_pressure_below_the_centre_of_mass():
    shifted = replace(BLOCK, com=np.array([0.012, -0.006]))
    thing = PlanarObject(0, "homogeneous", (shifted,), None, 0.0)
    even = Surface(uneven_friction(0.0, 0))
    with TableWorld([thing], np.array([[0.5, 0.0, 0.4]]), 0.1, even, 1e-3) as made:
        told = outlines(made.bodies[0])[0].truth()["friction_radius_m"]
    patch = SupportPatch(SQUARE, 400)
    expected = patch.friction_radius(shifted.com[None], np.ones(1))[0]
    assert told == pytest.approx(expected, rel=0.015)
    assert told < MEAN_DISTANCE * SIDE
