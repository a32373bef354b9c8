"""The simulated world against mechanics: inertia, contact forces, drives, kinematics, signs."""

from __future__ import annotations

import numpy as np
import pybullet
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.kinematic_tree import parse_urdf
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.sim.objects import list_objects, load_object
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

ROBOT = load_robot()

HOME = ROBOT.start
# rubber tip frame and BioTac origin in the palm frame, mm, at zero and at home
HOME_DEG = [0, -10, 45, 45, 0, -10, 45, 45, 5, -5, 50, 45, 60, 25, 15, 45]
STOCK_TIP = {
    "index": (38.9, 52.7, 103.7),
    "ring": (49.0, -47.7, 95.8),
    "thumb": (106.0, 62.4, -31.4),
}
BIOTAC = {"index": (68.8, 54.0, 100.2), "ring": (77.5, -42.9, 87.7), "thumb": (118.6, 56.3, -5.5)}


@pytest.fixture
def world():
    with HandWorld(WorldConfig(object_name="box_0", object_yaw=0.4)) as made:
        made.reset(HOME)
        yield made


def float_freely(world: HandWorld, rotation: np.ndarray) -> np.ndarray:
    """Put the object high above everything, turned, without gravity."""
    world.set_gravity(np.zeros(3))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, [0.5, 0.6, 1.5]
    world.reset(HOME, pose)
    return pose


def test_the_urdf_has_the_published_forward_kinematics(world):
    world.reset(np.concatenate([np.zeros(7), np.deg2rad(HOME_DEG)]))
    palm = np.linalg.inv(world.link_pose("palm_link"))
    for finger, expected in BIOTAC.items():
        pose = palm @ world.link_pose(f"biotac_{finger}")
        assert_allclose(1e3 * pose[:3, 3], expected, atol=0.06)
        last = 4 * ROBOT.fingers.index(finger) + 3
        height = 0.0423 if finger == "thumb" else 0.0267
        tip = palm @ world.link_pose(f"link_{last}.0") @ np.array([0.0, 0.0, height, 1.0])
        assert_allclose(1e3 * tip[:3], STOCK_TIP[finger], atol=0.06)


def test_the_urdf_agrees_with_the_kinematics_of_the_estimators(world):
    kinematics = HandKinematics()
    rng = np.random.default_rng(1)
    lower = np.array([joint.lower for joint in ROBOT.joints])
    upper = np.array([joint.upper for joint in ROBOT.joints])
    for _ in range(5):
        positions = rng.uniform(lower, upper)
        world.reset(positions)
        for finger in ROBOT.fingers:
            expected = kinematics.sensor_pose(finger, positions)
            assert_allclose(world.link_pose(f"biotac_{finger}"), expected, atol=2e-6)


@pytest.mark.parametrize("name", list_objects())
def test_objects_carry_their_stated_inertia(name):
    model = load_object(name)
    turned = exp_so3(np.array([0.3, -0.8, 1.1]))
    with HandWorld(WorldConfig(object_name=name)) as world:
        pose = float_freely(world, turned)
        assert_allclose(world.object_pose(), pose, atol=1e-9)
        mass, _, moments = pybullet.getDynamicsInfo(world.object_id, -1, world.client)[:3]
        position, quaternion = pybullet.getBasePositionAndOrientation(world.object_id, world.client)
        axes = np.array(pybullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        in_object = turned.T @ axes
    assert mass == pytest.approx(model.inertia.mass)
    assert_allclose(
        in_object @ np.diag(moments) @ in_object.T, model.inertia.inertia_com, atol=1e-9
    )
    com = turned.T @ (np.array(position) - pose[:3, 3])
    assert_allclose(com, model.inertia.com, atol=1e-9)


def test_the_published_boxes_are_physical_only_with_flipped_products():
    for k in range(5):
        inertia = load_object(f"box_{k}").inertia
        assert np.linalg.eigvalsh(inertia.pseudo_inertia).min() > 0.0
    tensor = load_object("box_0").inertia.inertia_origin
    assert_allclose(
        [tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 2]],
        [37.2e-5, 40.0e-5, -34.8e-5, 13.6e-5],
        atol=1e-12,
    )


def test_pushes_and_twists_accelerate_the_object_as_newton_and_euler_say(world):
    turned = exp_so3(np.array([0.5, 0.2, -0.7]))
    pose = float_freely(world, turned)
    force, torque = np.array([0.4, -0.2, 0.3]), np.array([2e-3, 1e-3, -3e-3])
    point = pose[:3, 3] + turned @ np.array([0.02, 0.05, -0.03])
    world.apply_force(force, point)
    world.apply_torque(torque)
    world.step()
    angular, linear = world.object_velocity()
    inertia = world.model.inertia
    arm = turned @ inertia.com
    moment = np.cross(point - (pose[:3, 3] + arm), force) + torque
    expected = np.linalg.solve(turned @ inertia.inertia_com @ turned.T, moment)
    dt = world.config.time_step
    assert_allclose(angular / dt, expected, rtol=1e-4)
    assert_allclose(linear / dt, force / inertia.mass - np.cross(expected, arm), atol=0.05)


def test_a_resting_object_is_carried_by_the_table(world):
    world.step(500)
    world.contacts()
    world.step(200)
    other = world.contacts()["other"]
    assert_allclose(other.force, [0.0, 0.0, 0.115 * 9.81], atol=1e-4)
    assert_allclose(other.normal, [0.0, 0.0, 1.0], atol=1e-6)
    assert world.object_pose()[2, 3] == pytest.approx(world.start_pose()[2, 3], abs=3e-4)


def test_a_fingertip_pushes_the_object_away_from_itself(world):
    """The index skin placed on the box from above: it presses down and the table presses up."""
    world.step(300)
    box = world.object_pose()
    top = box[:3, 3] + box[:3, :3] @ np.array([0.09, 0.0, 0.032])
    tip = world.link_pose("biotac_index")[:3, 3]
    moved = box.copy()
    moved[:3, 3] += tip - top - np.array([0.0, 0.0, 0.007 - 0.0005])
    world.set_gravity(np.zeros(3))
    world.reset(HOME, moved)
    world.contacts()
    world.step(3)
    index = world.contacts()["index"]
    _, velocity = world.object_velocity()
    assert index.in_contact
    assert index.normal[2] < -0.9
    assert index.force[2] < 0.0
    assert velocity[2] < 0.0


def test_drives_follow_with_lag(world):
    target = HOME.copy()
    target[0] += 0.3
    target[7 + 1] += 1.0
    world.command(target)
    world.step(5)
    assert abs(world.joint_state().position[0] - HOME[0]) < 0.01
    world.step(1000)
    state = world.joint_state()
    assert state.position[0] == pytest.approx(target[0], abs=1e-3)
    assert state.position[8] == pytest.approx(target[8], abs=0.06)
    assert np.abs(state.velocity).max() < 0.05


def test_a_blocked_finger_pushes_with_its_torque_cap_and_no_more(world):
    for joint in range(pybullet.getNumJoints(world.robot, world.client)):
        if pybullet.getJointInfo(world.robot, joint, world.client)[12] == b"link_1.0":
            lock = {"jointType": pybullet.JOINT_FIXED, "jointAxis": (0, 0, 0)}
            state = pybullet.getLinkState(world.robot, joint, 0, 1, world.client)
            pybullet.createConstraint(
                world.robot,
                joint,
                -1,
                -1,
                **lock,
                parentFramePosition=(0, 0, 0),
                childFramePosition=state[0],
                childFrameOrientation=state[1],
                physicsClientId=world.client,
            )
    target = HOME.copy()
    target[8] += 1.0
    world.command(target)
    world.step(400)
    cap = ROBOT.hand_joints[1].effort
    assert world.joint_state().effort[8] == pytest.approx(cap)
    assert world.joint_state().position[8] < HOME[8] + 0.1


def test_named_joints_are_commanded_alone(world):
    world.command(np.array([0.2]), names=["lbr_iiwa_joint_1"])
    world.step(600)
    moved = world.joint_state().position - HOME
    assert moved[0] == pytest.approx(0.2, abs=2e-3)
    assert np.abs(moved[1:7]).max() < 2e-3


def test_the_wrist_feels_the_weight_of_the_hand(world):
    world.step(1500)
    world.wrist_wrench()
    world.step(10)
    wrench = world.wrist_wrench()
    flange = world.link_pose("wrist_ft")
    weight = np.zeros(6)
    for link in parse_urdf(ROBOT.urdf).links:
        if not link.name.startswith("lbr_"):
            pose = world.link_pose(link.name)
            force = flange[:3, :3].T @ (link.inertial.mass * world.gravity)
            com = pose[:3, :3] @ link.inertial.origin.xyz + pose[:3, 3]
            arm = flange[:3, :3].T @ (com - flange[:3, 3])
            weight += np.concatenate([np.cross(arm, force), force])
    assert_allclose(wrench[3:], weight[3:], atol=0.03)
    assert_allclose(wrench[:3], weight[:3], atol=5e-3)


def test_the_wrist_feels_what_the_motion_has_and_not_how_drives_take_up_their_targets(world):
    world.step(1000)
    world.wrist_wrench()
    links = [link for link in parse_urdf(ROBOT.urdf).links if not link.name.startswith("lbr_")]
    mass = sum(link.inertial.mass for link in links)
    target, places, forces = HOME.copy(), [], []
    for tick in range(150):
        target[1] = HOME[1] + 0.1 * (1.0 - np.cos(2.0 * np.pi * tick / 100))
        world.command(target)
        world.step(10)
        flange = world.link_pose("wrist_ft")
        places.append(flange[:3, 3])
        forces.append(flange[:3, :3] @ world.wrist_wrench()[3:] - mass * world.gravity)
    velocity = np.gradient(np.array(places), 0.01, axis=0)[50:]
    drag = np.sum(velocity * np.array(forces)[50:]) / np.sum(velocity**2)
    assert abs(drag) < 0.1 * mass * 9.81


def test_callbacks_act_before_every_step(world):
    float_freely(world, np.eye(3))
    lift = np.array([0.0, 0.0, 0.5])
    calls = []

    def push(at: HandWorld) -> None:
        calls.append(at.time)
        pose = at.object_pose()
        com = pose[:3, 3] + pose[:3, :3] @ at.model.inertia.com
        at.apply_force(lift, com)

    world.add_pre_step(push)
    world.step(100)
    _, velocity = world.object_velocity()
    assert len(calls) == 100
    assert velocity[2] == pytest.approx(0.5 / 0.115 * 0.1, rel=1e-3)


def test_two_worlds_with_the_same_commands_agree():
    poses = []
    for _ in range(2):
        with HandWorld(WorldConfig(object_name="mug")) as world:
            world.reset(HOME)
            target = HOME + 0.1 * np.sin(np.arange(ROBOT.dof))
            world.command(target)
            world.step(300)
            poses.append(
                np.concatenate([world.object_pose().ravel(), world.joint_state().position])
            )
    assert_allclose(poses[0], poses[1], atol=1e-12)


def test_unknown_objects_are_refused_with_the_known_ones():
    with pytest.raises(BadInputError, match=r"no file .*known: box_0"):
        load_object("teapot")


def test_an_object_file_with_a_wrong_key_is_refused(tmp_path):
    path = tmp_path / "brick.yaml"
    path.write_text("name: brick\nweight: 3\n")
    with pytest.raises(BadInputError, match=r"brick.yaml: found keys \['name', 'weight'\]"):
        load_object(str(path))


def test_cameras_see_a_can_at_its_true_size():
    from tactile_dynamics_ros.sim.sensors.depth_camera import DepthCamera, look_at

    with HandWorld(WorldConfig(object_name="soup_can")) as can:
        pose = float_freely(can, np.eye(3))
        for side in ([0.5, 0.0, 0.0], [0.3, 0.4, 0.0]):
            depth = DepthCamera().render(can.client, look_at(pose[:3, 3] + side, pose[:3, 3]))
            assert depth.min() == pytest.approx(0.5 - 0.033, abs=2e-4)
        depth = DepthCamera().render(can.client, look_at(pose[:3, 3] + [0, 0, 0.5], pose[:3, 3]))
        assert depth.min() == pytest.approx(0.5 - 0.101 / 2, abs=2e-4)
