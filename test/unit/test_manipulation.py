"""Planning and behaviour without a simulator: reach, balance, limits, failure."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.manipulation.arm_path import excite, join_joints, join_poses
from tactile_dynamics_ros.core.manipulation.excitation import (
    ExcitationConfig,
    OffsetTable,
    SumOfSines,
)
from tactile_dynamics_ros.core.manipulation.grasp_controller import (
    GraspController,
    Phase,
)
from tactile_dynamics_ros.core.manipulation.grasp_planner import (
    GraspSite,
    plan_grasp,
    squeeze_forces,
)
from tactile_dynamics_ros.core.manipulation.squeeze import Squeeze, held_by
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot

ROBOT = load_robot()

HOME = ROBOT.start
SITE = GraspSite(
    centre=np.array([0.01, 0.0, 0.02]), pinch=[0, 1, 0], approach=[0, 0, -1], width=0.06
)


@pytest.fixture(scope="module")
def kinematics() -> HandKinematics:
    return HandKinematics()


def pose_at(x: float, y: float, yaw: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = [x, y, 0.04]
    return pose


@pytest.mark.parametrize("yaw", [-2.5, -1.0, 0.0, 0.7, 2.0])
def test_the_plan_puts_the_skins_on_the_two_faces(kinematics, yaw):
    pose = pose_at(0.55, 0.05, yaw)
    plan = plan_grasp(kinematics, SITE, pose)
    where = kinematics.locate(np.concatenate([plan.arm, plan.touch]))
    normals = plan.normals @ where.palm[:3, :3].T
    skins = where.sensors[:, :3, 3] + ROBOT.tips.radius * normals
    across = ((skins - pose[:3, 3]) @ pose[:3, :3] - SITE.centre)[:, 1]
    assert_allclose(np.abs(across), 0.03, atol=1e-3)
    assert np.sign(across[3]) == -np.sign(across[0])
    assert_allclose(np.sign(across[:3]), np.sign(across[0]))
    assert_allclose(normals[:, 2], 0.0, atol=1e-3)


@pytest.mark.parametrize("width", [0.02, 0.05, 0.09])
def test_the_hand_opens_wider_and_closes_tighter_than_the_object(kinematics, width):
    site = GraspSite(np.zeros(3), np.array([0, 1, 0]), np.array([0, 0, -1]), width)
    plan = plan_grasp(kinematics, site, pose_at(0.5, 0.0, 0.0))
    gaps = {}
    for name in ("open", "touch", "closed"):
        where = kinematics.locate(np.concatenate([plan.arm, getattr(plan, name)]))
        thumb, middle = where.sensors[3, :3, 3], where.sensors[1, :3, 3]
        gaps[name] = np.linalg.norm(thumb - middle)
    assert gaps["open"] > gaps["touch"] + 0.02
    assert gaps["closed"] < gaps["touch"] - 0.006


def test_squeeze_forces_hold_nothing_but_themselves(kinematics):
    plan = plan_grasp(kinematics, SITE, pose_at(0.55, 0.0, 0.0))
    forces = squeeze_forces(plan.points, plan.normals, ROBOT.sides, 1.7)
    assert_allclose(forces.sum(axis=0), 0.0, atol=1e-12)
    assert_allclose(np.cross(plan.points, forces).sum(axis=0), 0.0, atol=1e-12)
    pressure = np.sum(forces * plan.normals, axis=1)
    sideways = np.linalg.norm(forces - pressure[:, None] * plan.normals, axis=1)
    assert pressure[3] == pytest.approx(1.7)
    assert (pressure > 0.2).all()
    assert (sideways < 0.3 * pressure).all()


def test_the_squeeze_grows_with_the_load_and_stays_within_torque_caps(kinematics):
    plan = plan_grasp(kinematics, SITE, pose_at(0.55, 0.0, 0.0))
    positions = np.concatenate([plan.arm, plan.touch])
    normals = plan.normals @ kinematics.locate(positions).palm[:3, :3].T

    def settle(weight: float) -> tuple[float, np.ndarray]:
        squeeze = Squeeze(kinematics, positions, normals)
        offsets = np.zeros(16)
        for _ in range(300):
            force = squeeze.wanted * normals[3] + [0.0, 0.0, weight]
            forces = {"thumb": force, "index": -squeeze.wanted * normals[3]}
            offsets = squeeze.update(0.01, positions, forces)
        return squeeze.wanted, offsets

    light, _ = settle(0.5)
    heavy, _ = settle(1.6)
    most, offsets = settle(20.0)
    kp = np.array([joint.kp for joint in ROBOT.joints[7:]])
    caps = np.array([joint.effort for joint in ROBOT.joints[7:]])
    assert light < heavy < most < 4.0
    assert (np.abs(kp * offsets) <= caps + 1e-9).all()


def test_a_hold_needs_the_thumb_and_two_fingers():
    press = np.array([0.0, 1.0, 0.0])
    assert held_by(ROBOT, {"thumb": press, "index": press, "ring": press}, 0.2)
    assert not held_by(ROBOT, {"middle": press, "index": press, "ring": press}, 0.2)
    assert not held_by(ROBOT, {"thumb": press, "index": press, "ring": 0.1 * press}, 0.2)


def test_the_excitation_fades_in_and_out_and_keeps_its_size():
    config = ExcitationConfig(duration=20.0, rotation=0.3, translation=0.04)
    motion = SumOfSines(config)
    samples = np.array([motion(time) for time in np.linspace(0.0, 20.0, 2001)])
    assert_allclose(samples[[0, -1]], 0.0, atol=1e-12)
    assert 0.2 < np.abs(samples[:, :3]).max() < 0.301
    assert 0.025 < np.abs(samples[:, 3:]).max() < 0.0402
    assert np.linalg.matrix_rank(samples, tol=1e-2) == 6


def test_the_excited_arm_respects_speeds_and_moves_as_told(kinematics):
    start = np.concatenate([ROBOT.carry, ROBOT.hand_seed])
    where = kinematics.locate(start)
    pivot = where.sensors[:, :3, 3].mean(axis=0)
    motion = SumOfSines(ExcitationConfig(duration=8.0))
    path = excite(kinematics, start, pivot, motion, 8.0)
    time = np.linspace(0.0, 8.0, 801)
    joints = np.array([path(instant) for instant in time])
    speeds = np.abs(np.gradient(joints, time, axis=0)).max(axis=0)
    assert (speeds <= [joint.velocity for joint in ROBOT.arm]).all()
    assert_allclose(joints[[0, -1]], [ROBOT.carry, ROBOT.carry], atol=2e-3)
    assert path.scale >= 0.5
    told = path.scale * motion(3.7)
    moved = kinematics.locate(np.concatenate([path(3.7), ROBOT.hand_seed]))
    centre = pivot - where.palm[:3, 3]
    reached = moved.palm[:3, 3] + moved.palm[:3, :3] @ where.palm[:3, :3].T @ centre
    assert_allclose(reached - pivot, told[3:], atol=2e-3)


def test_an_excitation_of_ones_own_replaces_the_default(kinematics):
    time = np.linspace(0.0, 2.0, 21)
    offsets = np.zeros((21, 6))
    offsets[:, 5] = 0.05 * np.sin(np.pi * time / 2.0) ** 2
    start = np.concatenate([ROBOT.carry, ROBOT.hand_seed])
    palm = kinematics.locate(start).palm
    path = excite(kinematics, start, palm[:3, 3], OffsetTable(time, offsets), 2.0)
    top = kinematics.locate(np.concatenate([path(1.0), ROBOT.hand_seed])).palm
    assert_allclose(top[:3, 3] - palm[:3, 3], [0.0, 0.0, 0.05], atol=1e-3)
    with pytest.raises(BadInputError, match="expected \\(N, 6\\)"):
        OffsetTable(time, offsets[:, :3])


def test_paths_start_and_end_at_rest_where_told(kinematics):
    goal = ROBOT.home + 0.4
    path = join_joints(ROBOT, ROBOT.home, goal)
    assert_allclose(path(0.0), ROBOT.home)
    assert_allclose(path(path.duration + 1.0), goal)
    assert_allclose(path.spline(0.0, 1), 0.0, atol=1e-9)
    palm = kinematics.locate(HOME).palm.copy()
    palm[2, 3] -= 0.1
    straight = join_poses(kinematics, HOME, palm)
    half = kinematics.locate(
        np.concatenate([straight(straight.duration / 2), ROBOT.hand_seed])
    ).palm
    end = kinematics.locate(np.concatenate([straight(straight.duration), ROBOT.hand_seed])).palm
    assert_allclose(end, palm, atol=1e-4)
    assert_allclose(half[:2, 3], palm[:2, 3], atol=1e-4)


def test_a_goal_out_of_reach_is_refused_in_words(kinematics):
    with pytest.raises(NotIdentifiableError, match="cannot reach the object at"):
        plan_grasp(kinematics, SITE, pose_at(1.6, 0.0, 0.0))
    palm = kinematics.locate(HOME).palm.copy()
    palm[0, 3] += 1.0
    with pytest.raises(NotIdentifiableError, match="joint limits or reach"):
        join_poses(kinematics, HOME, palm)


def test_the_behaviour_waits_for_a_pose_and_fails_in_words(kinematics):
    controller = GraspController(kinematics, SITE)
    assert_allclose(controller.update(0.0, HOME, {}, None), HOME)
    assert controller.phase is Phase.OPEN
    controller.update(0.01, HOME, {}, pose_at(1.6, 0.0, 0.0))
    assert controller.phase is Phase.FAILED
    assert "cannot reach" in controller.outcome


def test_fingers_that_meet_nothing_open_again_and_give_up(kinematics):
    controller = GraspController(kinematics, SITE)
    positions, time, phases = HOME.copy(), 0.0, []
    while not controller.done and time < 80.0:
        positions = controller.update(time, positions, {}, pose_at(0.55, 0.0, 0.3))
        time += 0.02
        if not phases or phases[-1] is not controller.phase:
            phases.append(controller.phase)
    assert controller.phase is Phase.FAILED
    assert controller.outcome == "no grip after closing"
    assert phases.count(Phase.CLOSE) == 2
    assert Phase.LIFT not in phases


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pinch": [0, 0, 1]}, "perpendicular"),
        ({"width": 0.3}, "width = 0.3"),
        ({"colour": "red"}, r"unknown keys \['colour'\]"),
        ({"centre": [1, 2]}, "centre has shape"),
    ],
)
def test_a_wrong_grasp_site_is_refused(change, message):
    values = {"centre": [0, 0, 0], "pinch": [0, 1, 0], "approach": [0, 0, -1], "width": 0.05}
    with pytest.raises(BadInputError, match=message):
        GraspSite.from_mapping({**values, **change})
