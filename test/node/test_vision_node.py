"""The vision tracker as a node: images in, poses with the image's stamp out, reset, faults."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.nodes.vision_tracker import VisionTrackerNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.names import CAMERA_INFO, DEPTH_IMAGE, VISION_RESET
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig, look_at
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

ROBOT = load_robot()

HOME = ROBOT.start
PLACE = look_at(np.array([0.75, -0.6, 0.45]), np.array([0.42, 0.0, 0.18]))
SETTINGS = DepthCameraConfig()
CURTAIN = np.full((240, 320), 0.5, dtype=np.float32)


@pytest.fixture(scope="module")
def scene():
    """A box on the table: its pose and a picture of it."""
    with HandWorld(WorldConfig(object_name="gelatin_box")) as world:
        world.reset(HOME)
        yield world.start_pose(), DepthCamera(SETTINGS).measure(world.client, PLACE)


@pytest.fixture
def tracker(bench):
    """A running vision_tracker, and a way to show it an image at a time."""
    node = bench.start(VisionTrackerNode, "-p", "object:=gelatin_box")
    bench.follow(PoseWithCovarianceStamped, "/object/pose/vision")
    bench.follow(Float64, "/vision_tracker/score")

    def show(depth, time):
        info = cv.camera_info(SETTINGS.intrinsics, 320, 240, time, "camera")
        for stamp in (time - 0.01, time + 0.01):
            bench.send("/joint_states", cv.joints_to_message(ROBOT.joint_names, stamp, HOME))
        bench.send(CAMERA_INFO, info)
        bench.work(0.05)
        bench.send(DEPTH_IMAGE, cv.depth_to_message(depth, time, "camera"))

    bench.show, bench.node = show, node
    return bench


def show_until(tracker, picture, condition, start):
    """Show images, a tenth of a second apart, until the condition holds; return the last stamp."""
    for k in range(20):
        heard = len(tracker.seen["/vision_tracker/score"])
        tracker.show(picture, start + 0.1 * k)
        tracker.until(lambda heard=heard: len(tracker.seen["/vision_tracker/score"]) > heard)
        if condition():
            return start + 0.1 * k
    pytest.fail("condition not met after 20 images")


def test_pose_has_the_stamp_of_the_image_and_is_that_of_the_object(tracker, scene):
    truth, picture = scene
    poses = tracker.seen["/object/pose/vision"]
    last = show_until(tracker, picture, lambda: bool(poses), 1.0)
    assert cv.to_seconds(poses[-1].stamp) == pytest.approx(last)
    pose, covariance = cv.uncertain_pose_to_core(poses[-1], "/object/pose/vision", "world")
    assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) < 3e-3
    assert 1e-5 < np.sqrt(covariance[3, 3]) < 5e-3
    assert tracker.seen["/vision_tracker/score"][-1].data > 0.9


def test_a_hidden_object_yields_no_pose_and_no_score(tracker, scene):
    poses = tracker.seen["/object/pose/vision"]
    last = show_until(tracker, scene[1], lambda: bool(poses), 1.0)
    known = len(poses)
    scores = tracker.seen["/vision_tracker/score"]
    show_until(tracker, CURTAIN, lambda: math.isnan(scores[-1].data), last + 0.1)
    assert len(poses) == known


def test_reset_searches_anew(tracker, scene):
    poses = tracker.seen["/object/pose/vision"]
    last = show_until(tracker, scene[1], lambda: bool(poses), 1.0)
    client = tracker.node.create_client(Trigger, "/vision_tracker/reset")
    answer = Trigger.Response()
    for service in tracker.node.services:
        if service.srv_name == VISION_RESET:
            answer = service.callback(Trigger.Request(), Trigger.Response())
    tracker.node.destroy_client(client)
    assert answer.success
    assert tracker.node.tracker.state.value == "searching"
    poses.clear()
    show_until(tracker, scene[1], lambda: bool(poses), last + 0.1)


def test_an_image_without_joint_states_is_counted(tracker):
    tracker.send(DEPTH_IMAGE, cv.depth_to_message(CURTAIN, 1.0, "camera"))
    tracker.until(lambda: tracker.node.faults.counts["no_camera_info"])
    info = cv.camera_info(SETTINGS.intrinsics, 320, 240, 1.0, "camera")
    tracker.send(CAMERA_INFO, info)
    tracker.work(0.05)
    tracker.send(DEPTH_IMAGE, cv.depth_to_message(CURTAIN, 1.1, "camera"))
    tracker.until(lambda: tracker.node.faults.counts["no_joint_states"])


def test_camera_info_without_focal_length_is_refused():
    info = cv.camera_info(np.zeros((3, 3)), 320, 240, 1.0, "camera")
    with pytest.raises(BadInputError, match="focal length"):
        cv.camera_to_core(info, CAMERA_INFO, np.eye(4))
