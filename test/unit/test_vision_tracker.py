"""The vision tracker on rendered depth images: accurate, honest, and aware of being lost."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.shape.object_shape import load_shape
from tactile_dynamics_ros.core.tracking.depth_image import (
    DepthNoiseConfig,
    PinholeCamera,
    cut_window,
)
from tactile_dynamics_ros.core.tracking.fit import judge
from tactile_dynamics_ros.core.tracking.kinematic_tracker import pose_error
from tactile_dynamics_ros.core.tracking.robot_volume import RobotVolume
from tactile_dynamics_ros.core.tracking.scene import label_scene
from tactile_dynamics_ros.core.tracking.vision_tracker import TrackingState, VisionTracker
from tactile_dynamics_ros.share import object_file
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig, look_at
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

ROBOT = load_robot()

HOME = ROBOT.start
PLACE = look_at(np.array([0.75, -0.6, 0.45]), np.array([0.42, 0.0, 0.18]))
CENTRE = np.array([0.55, 0.0, 0.15])


class Studio:
    """An object in front of the camera, and a tracker for it."""

    def __init__(self, name: str, seed: int = 0) -> None:
        self.world = HandWorld(WorldConfig(object_name=name))
        self.shape = load_shape(object_file(name))
        self.tracker = VisionTracker(self.shape, HandKinematics())
        settings = DepthCameraConfig()
        self._sensor = DepthCamera(settings, seed)
        self.camera = PinholeCamera(settings.intrinsics, settings.width, settings.height, PLACE)
        self.time = 0.0

    def pose(self, turn, centre=CENTRE):
        """X_WO with the middle of the object at a place."""
        pose = np.eye(4)
        pose[:3, :3] = exp_so3(np.asarray(turn, dtype=float))
        pose[:3, 3] = centre - pose[:3, :3] @ self.shape.centre
        return pose

    def picture(self, truth):
        """Depth image of the object at X_WO."""
        self.world.reset(HOME, truth)
        return self._sensor.measure(self.world.client, PLACE)

    def see(self, depth, hints=()):
        """Give the tracker an image."""
        self.time += 1.0 / 15.0
        return self.tracker.update(depth, self.camera, HOME, self.time, hints)


@pytest.fixture
def studio(request):
    made = Studio(request.param)
    yield made
    made.world.close()


def middle_error(studio, sighting, truth):
    difference = sighting.pose - truth
    return np.linalg.norm(difference[:3, :3] @ studio.shape.centre + difference[:3, 3])


def displaced(pose, shift, turn):
    moved = pose.copy()
    moved[:3, :3] = exp_so3(np.asarray(turn, dtype=float)) @ pose[:3, :3]
    moved[:3, 3] += shift
    return moved


@pytest.mark.parametrize("studio", ["potted_meat_can"], indirect=True)
def test_poses_are_accurate_and_their_covariance_is_that_of_the_errors(studio):
    rng = np.random.default_rng(4)
    nees, shifts, turns = [], [], []
    for _ in range(20):
        truth = studio.pose(rng.normal(0.0, 0.8, 3), CENTRE + rng.normal(0.0, 0.03, 3))
        studio.tracker.reset(displaced(truth, rng.normal(0, 4e-3, 3), rng.normal(0, 0.04, 3)))
        depth = studio.picture(truth)
        seen = [studio.see(depth) for _ in range(3)][-1]
        error = pose_error(seen.pose, truth)
        nees.append(error @ np.linalg.solve(seen.covariance, error))
        shifts.append(middle_error(studio, seen, truth))
        turns.append(np.linalg.norm(error[:3]))
    assert np.median(shifts) < 1e-3
    assert np.rad2deg(np.median(turns)) < 0.7
    assert 1.5 < np.mean(nees) < 12.0


@pytest.mark.parametrize("studio", ["soup_can"], indirect=True)
def test_the_turn_of_a_can_about_its_axis_is_admitted_to_be_unknown(studio):
    truth = studio.pose([0.2, 0.3, 0.0])
    studio.tracker.reset(truth)
    seen = [studio.see(studio.picture(truth)) for _ in range(3)][-1]
    axis = seen.pose[:3, 2]
    across = np.cross(axis, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    rotation = seen.covariance[:3, :3]
    assert np.sqrt(axis @ rotation @ axis) > 1.0
    assert np.rad2deg(np.sqrt(across @ rotation @ across)) < 1.0
    assert np.sqrt(np.diag(seen.covariance)[3:]).max() < 2e-3


@pytest.mark.parametrize("studio", ["potted_meat_can"], indirect=True)
def test_a_hidden_object_is_not_told_and_found_again(studio):
    truth = studio.pose([0.1, 0.2, 0.4])
    studio.tracker.reset(truth)
    for _ in range(4):
        studio.see(studio.picture(truth))
    assert studio.tracker.state is TrackingState.TRACKING
    curtain = np.full((240, 320), 0.5, dtype=np.float32)
    assert [studio.see(curtain) for _ in range(3)] == [None] * 3
    assert studio.tracker.state is TrackingState.HIDDEN
    seen = studio.see(studio.picture(truth))
    assert seen is not None
    assert middle_error(studio, seen, truth) < 2e-3


@pytest.mark.parametrize("studio", ["potted_meat_can"], indirect=True)
def test_a_wrong_start_is_never_told_as_a_pose_and_mended(studio):
    truth = studio.pose([0.1, -0.2, 0.3])
    wrong = displaced(truth, [0.04, -0.03, 0.0], [0.0, 0.0, 0.52])
    studio.tracker.reset(wrong)
    told = [studio.see(studio.picture(truth)) for _ in range(12)]
    assert told[-1] is not None
    for seen in told:
        assert seen is None or middle_error(studio, seen, truth) < 3e-3
    assert np.rad2deg(np.linalg.norm(pose_error(told[-1].pose, truth)[:3])) < 3.0


@pytest.mark.parametrize("studio", ["gelatin_box"], indirect=True)
def test_an_object_on_the_table_is_found_from_nothing(studio):
    truth = studio.world.start_pose()
    for _ in range(4):
        seen = studio.see(studio.picture(truth))
    assert seen is not None
    assert seen.score > 0.9
    assert middle_error(studio, seen, truth) < 2e-3
    assert np.linalg.norm(pose_error(seen.pose, truth)[:3]) < 0.05


@pytest.mark.parametrize("studio", ["pudding_box"], indirect=True)
def test_a_box_seen_from_its_end_is_not_taken_for_one_that_sinks_into_the_table(studio):
    end_on = exp_so3(np.array([0.0, 0.0, 0.26]))
    truth = studio.world.start_pose()
    truth[:3, :3] = end_on
    sunk = truth.copy()
    sunk[:3, :3] = end_on @ exp_so3(np.array([np.pi / 2.0, 0.0, 0.0]))
    sunk[:3, 3] += end_on @ [0.0, -0.0105, 0.0] + [0.0, 0.0, -0.0105]
    for _ in range(4):
        studio.tracker.reset(sunk)
        told = [studio.see(studio.picture(truth)) for _ in range(30)]
        assert told[-1] is not None
        for seen in told:
            assert seen is None or middle_error(studio, seen, truth) < 3e-3


@pytest.mark.parametrize("studio", ["pudding_box"], indirect=True)
def test_a_pose_through_which_the_table_is_seen_is_refuted(studio):
    truth = studio.world.start_pose()
    depth = studio.picture(truth)
    view = cut_window(studio.camera, depth, slice(0, 240), slice(0, 320))
    scene = label_scene(studio.camera, view, None, None, DepthNoiseConfig(), 0.0)

    def judged(shift):
        pose = np.linalg.inv(PLACE) @ displaced(truth, shift, [0, 0, 0])
        return judge(studio.shape, scene, pose)

    assert judged([0.0, 0.0, 0.0]).score > 0.95
    assert judged([0.03, 0.0, 0.0]).refuted > 0.3 * judged([0.03, 0.0, 0.0]).facing
    assert judged([0.0, 0.0, -0.03]).score == 0.0


@pytest.mark.parametrize("studio", ["gelatin_box"], indirect=True)
def test_nothing_is_found_where_there_is_nothing(studio):
    away = studio.pose([0.0, 0.0, 0.0], np.array([0.5, 3.0, 0.1]))
    assert [studio.see(studio.picture(away)) for _ in range(8)] == [None] * 8
    assert studio.tracker.state is TrackingState.SEARCHING


@pytest.mark.parametrize("studio", ["gelatin_box"], indirect=True)
def test_the_robot_is_where_its_joints_say(studio):
    away = studio.pose([0.0, 0.0, 0.0], np.array([0.5, 3.0, 0.1]))
    studio.world.reset(HOME, away)
    depth = DepthCamera().render(studio.world.client, PLACE).ravel()
    row, column = np.mgrid[:240, :320]
    rays = studio.camera.rays(row.ravel().astype(float), column.ravel().astype(float))
    volume = RobotVolume(HandKinematics(), margin=0.0)
    robot = volume.depth(HOME, PLACE, rays.reshape(240, 320, 3)).ravel()
    hand = np.isfinite(robot)
    same = np.abs(robot[hand] - depth[hand]) < 2e-3
    world = (rays * depth[:, None]) @ PLACE[:3, :3].T + PLACE[:3, 3]
    raised = (depth < 3.0) & (world[:, 2] > 0.01)
    assert raised.sum() > 1000
    assert np.mean(hand[raised]) > 0.97
    assert np.mean(same[depth[hand] < 3.0]) > 0.85  # the arm is rounder than it is drawn


@pytest.mark.parametrize("studio", ["gelatin_box"], indirect=True)
def test_an_image_of_another_size_is_refused(studio):
    with pytest.raises(BadInputError, match="camera_info says"):
        studio.see(np.zeros((10, 10), dtype=np.float32))
