"""Noise models of encoders, wrist sensor, marker tracker and depth camera."""

from __future__ import annotations

import numpy as np
import pybullet
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, matrix_to_quaternion
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, DepthCameraConfig, look_at
from tactile_dynamics_ros.sim.sensors.fingertips import (
    EncoderConfig,
    Fingertips,
    JointEncoders,
    MarkerTracker,
    MarkerTrackerConfig,
    WristSensor,
    WristSensorConfig,
)
from tactile_dynamics_ros.sim.simulated_robot import SimulatedRobot, SimulatedRobotConfig

ROBOT = load_robot()


def test_encoders_have_noise_offset_play_and_steps():
    encoders = JointEncoders(ROBOT, EncoderConfig(), seed=2)
    truth = np.linspace(-1.0, 1.0, ROBOT.dof)
    readings = np.array([encoders.read(truth) for _ in range(4000)])
    steps = readings[:, 7:] / ROBOT.hand_resolution
    assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert_allclose(readings[:, 7:].std(axis=0), 2e-4, rtol=0.1)
    assert_allclose(readings[:, :7].std(axis=0), 1e-5, rtol=0.1)
    assert_allclose(readings.mean(axis=0) - truth, encoders.offset, atol=2e-5)
    assert 0.5 < np.std(encoders.offset[7:]) / np.deg2rad(0.2) < 1.7
    loaded = np.array([encoders.read(truth, np.full(ROBOT.dof, 0.3)) for _ in range(4000)])
    shift = (loaded - readings).mean(axis=0)
    assert_allclose(shift[7:], 0.5 * np.deg2rad(0.1) * 0.3 / 0.31, atol=3e-5)
    assert_allclose(shift[:7], 0.0, atol=1e-6)


def test_wrist_sensor_noise_filter_drift_and_saturation():
    sensor = WristSensor(WristSensorConfig(force_drift=0.0, torque_drift=0.0), seed=1)
    still = np.array([sensor.read(np.zeros(6), 0.01)[0] for _ in range(3000)])
    assert_allclose(still.std(axis=0), sensor.noise, rtol=0.08)
    step = np.array([0.0, 0.0, 0.0, 10.0, 0.0, 0.0])
    rise = [sensor.read(step, 0.002)[0][3] for _ in range(100)]
    assert 4.0 < rise[4] < 9.0
    assert abs(np.mean(rise[50:]) - 10.0) < 0.1
    value, saturated = sensor.read(np.array([0.0, 0.0, 0.0, 900.0, 0.0, 0.0]), 10.0)
    assert saturated
    assert value[3] == pytest.approx(200.0)
    drifting = [WristSensor(seed=s) for s in range(200)]
    for _ in range(20):
        ends = [each.read(np.zeros(6), 5.0)[0][3] for each in drifting]
    assert np.std(ends) == pytest.approx(np.hypot(5e-3 * np.sqrt(100.0), 0.035), rel=0.2)


def test_marker_tracker_states_its_own_error():
    truth = np.eye(4)
    truth[:3, 3] = [0.5, 0.1, 0.3]
    errors = []
    for seed in range(400):
        tracker = MarkerTracker(seed=seed)
        seen = tracker.read(truth)
        errors.append([*log_so3(seen[:3, :3]), *(seen - truth)[:3, 3]])
    assert_allclose(np.std(errors, axis=0), np.sqrt(np.diag(tracker.covariance)), rtol=0.15)
    lossy = MarkerTracker(MarkerTrackerConfig(loss_probability=0.3))
    lost = [lossy.read(truth) is None for _ in range(500)]
    assert 0.2 < np.mean(lost) < 0.4


HALF_SIZE = np.array([0.1, 0.06, 0.05])
BOX_POSE = np.array([[0.8, -0.6, 0, 0.1], [0.6, 0.8, 0, -0.05], [0, 0, 1, 0.2], [0, 0, 0, 1]])


@pytest.fixture
def box_world():
    client = pybullet.connect(pybullet.DIRECT)
    shape = pybullet.createVisualShape(
        pybullet.GEOM_BOX, halfExtents=HALF_SIZE.tolist(), physicsClientId=client
    )
    pybullet.createMultiBody(
        baseVisualShapeIndex=shape,
        basePosition=BOX_POSE[:3, 3].tolist(),
        baseOrientation=matrix_to_quaternion(BOX_POSE[:3, :3]).tolist(),
        physicsClientId=client,
    )
    yield client
    pybullet.disconnect(client)


def back_project(depth: np.ndarray, camera: DepthCamera, pose: np.ndarray) -> np.ndarray:
    row, column = np.nonzero(np.isfinite(depth) & (depth < 5.0))
    z = depth[row, column]
    rays = np.linalg.solve(camera.config.intrinsics, np.stack([column, row, np.ones_like(row)]))
    return (pose[:3, :3] @ (rays * z) + pose[:3, 3:]).T


def test_depth_image_back_projects_onto_the_scene(box_world):
    camera = DepthCamera()
    pose = look_at(np.array([0.6, -0.5, 0.7]), np.array([0.0, 0.0, 0.2]))
    points = back_project(camera.render(box_world, pose), camera, pose)
    local = np.abs((points - BOX_POSE[:3, 3]) @ BOX_POSE[:3, :3]) - HALF_SIZE
    assert len(points) > 2000
    assert np.abs(local.max(axis=1)).max() < 1e-3


def test_a_backdrop_drawn_once_shows_what_drawing_it_each_time_shows():
    def robot(rate: float) -> SimulatedRobot:
        return SimulatedRobot(SimulatedRobotConfig(seed=3, depth_rate_hz=rate))

    drawn_once, drawn_always = robot(10.0), robot(0.0)
    camera, table = drawn_once.camera, drawn_once.world.table
    elsewhere = look_at(np.array([0.2, 0.7, 0.6]), np.array([0.5, 0.0, 0.0]))
    for pose in (drawn_once.camera_pose, elsewhere, drawn_once.camera_pose):
        expected = drawn_always.camera.render(drawn_always.world.client, pose)
        assert np.array_equal(camera.render(drawn_once.world.client, pose), expected)
    camera.place_backdrop(lambda client: None)
    seen = camera.render(drawn_once.world.client, drawn_once.camera_pose)
    assert seen.max() > 9.9, "the table is still drawn with each image"
    assert table == drawn_always.world.table
    for each in (drawn_once, drawn_always):
        each.world.close()


def test_pixels_are_where_the_intrinsics_say(box_world):
    camera = DepthCamera()
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    above[:3, :3] = BOX_POSE[:3, :3] @ above[:3, :3]
    above[:3, 3] = [0.1, -0.05, 1.05]
    row, column = np.nonzero(camera.render(box_world, above) < 1.0)
    reach = camera.config.focal_length / 0.8 * HALF_SIZE
    assert_allclose([column.min(), column.max()], 159.5 + reach[0] * np.array([-1, 1]), atol=0.6)
    assert_allclose([row.min(), row.max()], 119.5 + reach[1] * np.array([-1, 1]), atol=0.6)


def test_depth_noise_grows_with_distance_and_is_quantised():
    camera = DepthCamera(DepthCameraConfig(shadows=False), seed=1)
    spreads = []
    for distance, expected in [(0.6, 1.28e-3), (1.0, 1.9e-3), (2.0, 6.1e-3)]:
        wall = np.full((240, 320), distance, dtype=np.float32)
        measured = camera.degrade(wall)
        f, b = camera.config.focal_length * 2, 0.075
        quantum = distance**2 / (8 * f * b)
        spreads.append(np.nanstd(measured))
        assert spreads[-1] == pytest.approx(np.hypot(expected, quantum / np.sqrt(12)), rel=0.1)
        assert len(np.unique(measured[np.isfinite(measured)])) < 40
    assert spreads == sorted(spreads)


def test_depth_holes_range_edges_and_shadow():
    camera = DepthCamera(seed=1)
    depth = np.full((240, 320), 1.5, dtype=np.float32)
    depth[80:160, 120:200] = 0.8
    depth[:20] = 0.2
    depth[220:] = 5.0
    measured = camera.degrade(depth)
    assert np.isnan(measured[:17]).all()
    assert np.isnan(measured[223:]).all()
    width = 0.075 * camera.config.focal_length * (1 / 0.8 - 1 / 1.5)
    hidden = np.isnan(measured[100:140]).mean(axis=0)
    assert hidden[int(120 - width) + 3 : 117].mean() > 0.9
    assert hidden[204:230].mean() < 0.1
    assert np.isnan(measured[100:140, 195:204]).any()


class Touch:
    def __init__(self, force, point):
        self.force, self.point = np.asarray(force), np.asarray(point)
        self.in_contact = True


def test_fingertips_take_world_forces_and_sense_slip():
    tips = Fingertips(ROBOT.fingers, seed=3)
    poses = np.tile(np.eye(4), (4, 1, 1))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    poses[:, :3, :3] = turn
    poses[:, 0, 3] = [0.0, 0.1, 0.2, 0.3]
    still = (np.zeros(3), np.zeros(3))
    for _ in range(20):
        rest = tips.read({}, poses, np.eye(4), still)
    assert rest.shape == (4, 44)
    place = poses[2, :3, 3] + turn @ [-0.0028, 0.0, -0.007]
    touch = {"ring": Touch(turn @ [0.4, 0.2, -1.5], place)}
    for _ in range(20):
        raw = tips.read(touch, poses, np.eye(4), still)
    same = Fingertips(ROBOT.fingers, seed=3).array
    force, point = np.zeros((4, 3)), np.zeros((4, 3))
    for _ in range(20):
        same.measure(force, point)
    force[2], point[2] = [0.4, 0.2, -1.5], [-0.0028, 0.0, -0.007]
    for _ in range(20):
        expected = same.measure(force, point)
    assert_allclose(raw[:, :20].astype(float), expected[:, :20].astype(float), atol=1.0)
    change = raw.astype(float) - rest
    assert change[2, 16] < -60
    assert np.abs(np.delete(change[:, :19], 2, axis=0)).max() < 25
    quiet = raw[2, 22:].std()
    sliding = (np.zeros(3), np.array([0.03, 0.0, 0.0]))
    for _ in range(10):
        raw = tips.read(touch, poses, np.eye(4), sliding)
    assert raw[2, 22:].std() > 3 * quiet


def test_depth_camera_stands_a_little_off_its_calibrated_pose(box_world):
    config = DepthCameraConfig(noise_scale=0.0, edge_loss=0.0, shadows=False, pose_bias=0.02)
    pose = look_at(np.array([0.0, 0.0, 0.8]), np.zeros(3))
    first, again, other = (DepthCamera(config, seed).measure(box_world, pose) for seed in (1, 1, 2))
    assert np.array_equal(first, again, equal_nan=True)
    assert not np.array_equal(first, other, equal_nan=True)
    exact = DepthCameraConfig(noise_scale=0.0, edge_loss=0.0, pose_bias=0.0, pose_bias_deg=0.0)
    shift = np.nanmedian(first) - np.nanmedian(DepthCamera(exact, 1).measure(box_world, pose))
    assert 1e-4 < abs(shift) < 0.08
