"""Robots as data: what their files may say, joints that slide, a mirrored hand, a gripper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

import tactile_dynamics_ros
from tactile_dynamics_ros.core.contact.contact_state import ContactState
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.manipulation.squeeze import held_by
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics, JointUncertaintyConfig
from tactile_dynamics_ros.core.robot.robot import column
from tactile_dynamics_ros.core.robot.robot_file import description_topic, load_robot
from tactile_dynamics_ros.core.tracking.robot_volume import RobotVolume

ROBOTS = Path(tactile_dynamics_ros.__file__).parents[1] / "config" / "robots"
NAMES = sorted(path.stem for path in ROBOTS.glob("*.yaml"))
MIRROR = np.diag([1.0, -1.0, 1.0])

TWO_FINGERS = """<robot name="small">
<link name="base"/><link name="palm"/><link name="a"/><link name="b"/><link name="tip_a"/>
<link name="c"/><link name="d"/><link name="tip_b"/>
<joint name="lift" type="prismatic"><parent link="base"/><child link="palm"/><axis xyz="0 0 2"/>
<limit lower="0" upper="1" effort="50" velocity="0.5"/></joint>
<joint name="a1" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/>
<origin xyz="0.05 0 0.02" rpy="0.1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="3"/></joint>
<joint name="a2" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.04"/><limit effort="1" velocity="3"/></joint>
<joint name="a_tip" type="fixed"><parent link="b"/><child link="tip_a"/>
<origin xyz="0 0 0.03"/></joint>
<joint name="b1" type="revolute"><parent link="palm"/><child link="c"/><axis xyz="0 1 0"/>
<origin xyz="-0.05 0 0.02"/><limit lower="-1" upper="1" effort="1" velocity="3"/></joint>
<joint name="b_bend" type="fixed"><parent link="c"/><child link="d"/><origin rpy="0 0.2 0"/></joint>
<joint name="b2" type="prismatic"><parent link="d"/><child link="tip_b"/><axis xyz="0 0 1"/>
<origin xyz="0 0 0.04"/><limit lower="0" upper="0.05" effort="1" velocity="3"/></joint>
</robot>"""
FILE = {
    "urdf": "small.urdf",
    "base": "base",
    "palm": "palm",
    "fingertips": {"kind": "pad", "radius": 0},
    "fingers": [
        {"name": "one", "sensor": "tip_a", "side": 1, "seed": 0.1},
        {"name": "two", "sensor": "tip_b", "side": -1, "seed": [0.1, 0.01]},
    ],
    "reference": "one",
    "arm": {"home": 0.2, "carry": 0.4, "radius": 0.05, "resolution": 1e-4},
    "hand": {"stiffness": 3.0, "damping": 0.1, "resolution": 1e-4},
    "grasp": {"palm_rpy_deg": [0, 0, 0], "depth": 0.1, "pivot": [0, 0, 0.1]},
}


@pytest.fixture
def write(tmp_path):
    """Write a robot with changes to its keys and to the text of its URDF; return its path."""

    def write_file(text=TWO_FINGERS, **changes):
        (tmp_path / "small.urdf").write_text(text)
        path = tmp_path / f"robot_{len(list(tmp_path.iterdir()))}.yaml"
        values = {key: value for key, value in (FILE | changes).items() if value is not None}
        path.write_text(yaml.safe_dump(values))
        return str(path)

    return write_file


def check_jacobians(robot):
    """Compare the Jacobian of every finger with differences of its pose."""
    kinematics = HandKinematics(robot)
    rng = np.random.default_rng(5)
    lower, upper = column(robot.joints, "lower"), column(robot.joints, "upper")
    positions = lower + (upper - lower) * rng.uniform(0.2, 0.8, robot.dof)
    step, local = 1e-6, np.array([0.004, -0.003, 0.006, 1.0])
    for finger in robot.fingers:
        pose = kinematics.sensor_pose(finger, positions).copy()
        jacobian = kinematics.jacobian(finger, positions, (pose @ local)[:3])
        for k in range(robot.dof):
            moved = positions.copy()
            moved[k] += step
            after = kinematics.sensor_pose(finger, moved)
            turn = log_so3(after[:3, :3] @ pose[:3, :3].T) / step
            shift = ((after - pose) @ local)[:3] / step
            assert_allclose(jacobian[:, k], np.concatenate([turn, shift]), atol=3e-6)


@pytest.mark.parametrize("name", NAMES)
def test_jacobians_of_every_robot_equal_differences(name):
    check_jacobians(load_robot(name))


def test_fingers_of_different_make_turn_and_slide(write):
    robot = load_robot(write())
    assert robot.joint_names == ("lift", "a1", "a2", "b1", "b2")
    assert robot.owned == {"one": slice(1, 3), "two": slice(3, 5)}
    check_jacobians(robot)
    tips = HandKinematics(robot).locate(np.array([0.3, 0.0, 0.0, -0.2, 0.03])).sensors
    assert_allclose(tips[1, :3, 3], [-0.05, 0.0, 0.3 + 0.02 + 0.04 + 0.03], atol=1e-12)
    bent = exp_so3(np.array([0.1, 0.0, 0.0])) @ [0.0, 0.0, 0.07]
    assert_allclose(tips[0, :3, 3], np.array([0.05, 0.0, 0.32]) + bent, atol=1e-12)


def test_fingers_of_different_length_are_as_alone(write):
    """One finger with one joint beside one with two: rows of the table are not mixed up."""
    short = TWO_FINGERS.replace('name="b2" type="prismatic"', 'name="b2" type="fixed"')
    fingers = [FILE["fingers"][0], FILE["fingers"][1] | {"seed": 0.1}]
    robot = load_robot(write(short, fingers=fingers))
    assert robot.dof == 4
    check_jacobians(robot)
    many = np.random.default_rng(1).uniform(0.0, 0.5, (3, 4))
    kinematics = HandKinematics(robot)
    together = kinematics.locate(many).sensors.copy()
    for row, found in zip(many, together, strict=True):
        assert_allclose(found, kinematics.locate(row).sensors, atol=1e-15)


def test_the_left_hand_mirrors_the_right():
    right, left = load_robot("allegro_iiwa"), load_robot("allegro_iiwa_left")
    hand = np.random.default_rng(2).uniform(-0.2, 0.9, 16)
    mirrored = hand * np.where(np.isin(np.arange(16), [0, 4, 8]), -1.0, 1.0)  # abduction is about z
    poses = []
    for robot, joints in ((right, hand), (left, mirrored)):
        where = HandKinematics(robot).locate(np.concatenate([robot.home, joints]))
        poses.append(np.linalg.inv(where.palm) @ where.sensors)
    assert_allclose(poses[1][:, :3, 3], poses[0][:, :3, 3] @ MIRROR, atol=1e-12)
    assert_allclose(poses[1][:, :3, :3], MIRROR @ poses[0][:, :3, :3] @ MIRROR, atol=1e-12)


def test_two_jaws_hold_and_three_of_four_fingers():
    press = np.array([1.0, 0.0, 0.0])
    gripper, hand = load_robot("panda_gripper"), load_robot()
    assert held_by(gripper, {"pad_left": press, "pad_right": press}, 0.5)
    assert not held_by(gripper, {"pad_left": press}, 0.5)
    assert not held_by(hand, {"index": press, "thumb": press}, 0.5)


def test_a_pad_transmits_torque_at_its_frame():
    robot = load_robot("panda_gripper")
    state = ContactState(HandKinematics(robot))
    force, torque = np.array([0.3, -0.2, 8.0]), np.array([0.02, 0.01, -0.03])
    contact = state.update("pad_right", robot.start, force, np.full(3, 0.03), torque)
    pose = state.kinematics.sensor_pose("pad_right", robot.start)
    assert_allclose(contact.point, pose[:3, 3])
    assert_allclose(contact.rotation, pose[:3, :3])
    assert_allclose(contact.torque, pose[:3, :3] @ torque)
    assert_allclose(contact.force, pose[:3, :3] @ force)
    round_skin = ContactState(HandKinematics())
    start = round_skin.kinematics.robot.start
    assert not round_skin.update(
        "thumb", start, -force, np.full(3, 0.03), 1e-3 * torque
    ).torque.any()


def test_joints_that_slide_have_errors_in_metres():
    robot = load_robot("panda_gripper")
    config = JointUncertaintyConfig(slide_offset=3e-4, arm_offset=2e-4)
    assert_allclose(config.constant_variance(robot), [2e-4**2] * 7 + [3e-4**2] * 2)


def test_a_gripper_hides_what_its_meshes_hide():
    """A ray through the hand meets it, one beside it does not."""
    robot = load_robot("panda_gripper")
    kinematics = HandKinematics(robot)
    palm = kinematics.locate(robot.start).palm
    camera = np.eye(4)
    camera[:3, :3] = np.stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]], axis=1)
    camera[:3, 3] = palm[:3, 3] + [1.0, 0.0, -0.03]
    rays = np.array([[[0.0, 0.0, 1.0], [0.4, 0.0, 1.0]]])
    depth = RobotVolume(kinematics).depth(robot.start, camera, rays)
    assert depth[0, 0] == pytest.approx(1.0 - 0.0316, abs=0.01)
    assert np.isinf(depth[0, 1])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"palm": None}, r"missing keys \['palm'\]"),
        ({"fingres": 1}, r"unknown keys \['fingres'\]"),
        ({"palm": "hand"}, "no joints lead from link 'base' to link 'hand'"),
        ({"reference": "thumb"}, "reference 'thumb': expected one of"),
        ({"fingertips": {"kind": "gelsight", "radius": 0}}, "kind 'gelsight', expected biotac or"),
        ({"arm": FILE["arm"] | {"home": [0.0, 1.0]}}, "arm: home: 2 numbers, expected 1"),
        ({"fingers": [FILE["fingers"][0], FILE["fingers"][0]]}, "moves two fingers"),
        ({"urdf": "other.urdf"}, "there is no file 'other.urdf'"),
        ({"urdf": "/robot_description"}, "published on /robot_description, which only nodes hear"),
        ({"hand": {"stiffness": 3.0, "resolution": 1e-4}}, "no damping"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(write, changes, said):
    with pytest.raises(BadInputError, match=said) as caught:
        load_robot(write(**changes))
    assert "\n" not in str(caught.value)
    assert ".yaml" in str(caught.value)


def test_a_wrong_urdf_is_refused_in_one_line(write):
    with pytest.raises(BadInputError, match="no URDF"):
        load_robot(write("<robot><link/>"))
    floating = TWO_FINGERS.replace('"prismatic"', '"floating"', 1)
    with pytest.raises(BadInputError, match="joint lift: type floating, expected one of fixed"):
        load_robot(write(floating))
    with pytest.raises(
        BadInputError, match="robot 'mine' is unknown: expected one of allegro_iiwa"
    ):
        load_robot("mine")


def test_a_published_urdf_stands_in_for_the_file(write):
    path = write()
    told = load_robot(path)
    values = yaml.safe_load(Path(path).read_text()) | {"urdf": "robot_description"}
    Path(path).write_text(yaml.safe_dump(values))
    assert description_topic(path) == "robot_description"
    heard = load_robot(path, TWO_FINGERS)
    assert heard.joint_names == told.joint_names


def test_robots_are_told_apart_by_identity():
    robot = load_robot()
    assert load_robot() is robot
    assert replace(robot, reference="index") != robot


def test_a_hand_without_an_arm(write):
    """Its palm stands in the world."""
    robot = load_robot(write(base="palm", arm=FILE["arm"] | {"home": [], "carry": []}))
    assert robot.arm_dof == 0
    check_jacobians(robot)
    where = HandKinematics(robot).locate(robot.start)
    assert_allclose(where.palm, np.eye(4))
    contact = ContactState(HandKinematics(robot)).update(
        "two", robot.start, np.array([0.0, 0.0, 1.0]), np.full(3, 0.1)
    )
    assert_allclose(contact.point, where.sensors[1, :3, 3])
