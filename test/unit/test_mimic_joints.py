"""Joints that mimic others, and what a URDF may hold beside links and joints."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.manipulation import grasp_planner
from tactile_dynamics_ros.core.manipulation.grasp_planner import (
    GraspGeometry,
    GraspSite,
    plan_grasp,
)
from tactile_dynamics_ros.core.manipulation.inverse_kinematics import solve_fingers
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.kinematic_tree import (
    coupling,
    independent,
    position_of,
    read_tree,
)
from tactile_dynamics_ros.core.robot.robot import Following
from tactile_dynamics_ros.core.robot.robot_file import load_robot, robot_file
from tactile_dynamics_ros.core.tracking.robot_volume import TreeVolume
from tactile_dynamics_ros.recording.importers.joint_angles import link_pose
from tactile_dynamics_ros.ros.conversions import JointReader, MessageError
from tactile_dynamics_ros.ros.wire import Joints
from tactile_dynamics_ros.share import object_file

TRANSMISSION = "<transmission><type>simple</type></transmission>"
SAFETY = "<safety_controller/>"
"""Both without what they must have, so that a strict reader refuses them."""


def arm(*mimics: str, limit: str = '<limit lower="-1" upper="2" effort="5" velocity="3"/>') -> str:
    """A URDF with one turning joint after the other: j0 by itself, the others with these tags."""
    links = "".join(
        f'<link name="l{k}"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
        "</link>"
        for k in range(len(mimics) + 2)
    )
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0.3 0"/><axis xyz="0 0 1"/>{tag if k else limit}{SAFETY}</joint>'
        for k, tag in enumerate(("", *mimics))
    )
    return f'<robot name="r">{links}{joints}{TRANSMISSION}<gazebo><a/></gazebo></robot>'


HALF_BACK = '<mimic joint="j0" multiplier="-0.5" offset="0.25"/>'


def test_a_joint_that_mimics_has_the_limits_that_its_leader_gives_it():
    first, second = read_tree(arm(HALF_BACK), "arm.urdf")
    assert first.follows is None
    assert second.follows == Following("j0", -0.5, 0.25)
    assert (second.lower, second.upper) == (-0.75, 0.75)
    assert (second.effort, second.velocity) == (5.0, 1.5)


@pytest.mark.parametrize(
    ("tag", "said"),
    [
        ('<mimic joint="gone"/>', "joint j1: mimic of 'gone'"),
        ('<mimic joint="j0" multiplier="0"/>', "multiplier 0, expected"),
        ('<mimic joint="j1"/>', "joint j1: mimic of 'j1'"),
        (" ", "joint j1: no limit, expected one as it is revolute"),
    ],
)
def test_a_joint_that_cannot_follow_is_refused_with_the_reason(tag, said):
    with pytest.raises(BadInputError, match=re.escape(said)):
        read_tree(arm(tag), "arm.urdf")


def test_a_follower_of_a_follower_follows_the_first():
    tree = read_tree(arm(HALF_BACK, '<mimic joint="j1" multiplier="2" offset="1"/>'), "arm.urdf")
    assert tree[2].follows == Following("j0", -1.0, 1.5)
    assert (tree[2].lower, tree[2].upper) == (-0.5, 2.5)


def test_positions_that_are_not_published_follow():
    tree = read_tree(arm(HALF_BACK), "arm.urdf")
    assert [joint.name for joint in independent(tree)] == ["j0"]
    assert position_of(tree[1], {"j0": 1.0}) == -0.25
    assert position_of(tree[1], {"j0": 1.0, "j1": 0.1}) == 0.1  # what is measured counts
    followers = {joint.name: joint.follows for joint in tree if joint.follows}
    reader = JointReader(["j0", "j1"], followers=followers)
    for names, positions, expected in (
        (("x", "j0"), [9.0, 1.0], [1.0, -0.25]),
        (("j1", "j0"), [0.1, 1.0], [1.0, 0.1]),
    ):
        found = reader.positions(Joints(0, names, np.array(positions)))
        assert_allclose(found, expected)
    with pytest.raises(MessageError, match="first: j0"):
        reader.positions(Joints(0, ("x",), np.array([9.0])))


def test_links_behind_a_follower_are_where_it_carries_them():
    tree, angle = read_tree(arm(HALF_BACK), "arm.urdf"), 0.6
    position, _ = link_pose(tree, {"j0": np.array([angle])})
    assert_allclose(position[0], [-0.3 * np.sin(angle), 0.3 + 0.3 * np.cos(angle), 0.0])
    volume = TreeVolume(arm(HALF_BACK))
    assert volume.joint_names == ("j0",)


def gripper(folder: Path, change) -> str:
    """A robot's file like the Panda's with another URDF."""
    panda = load_robot("panda_gripper")
    values = yaml.safe_load(robot_file("panda_gripper").read_text())
    urdf = panda.urdf.replace("</robot>", TRANSMISSION + "</robot>")
    second = re.search(r'<joint name="panda_finger_joint2".*?</joint>', urdf, re.DOTALL).group(0)
    (folder / "own.urdf").write_text(urdf.replace(second, change(second)))
    values["urdf"] = "own.urdf"
    (folder / "own.yaml").write_text(yaml.safe_dump(values))
    return str(folder / "own.yaml")


def cube() -> GraspSite:
    return GraspSite.from_mapping(yaml.safe_load(object_file("rubiks_cube").read_text())["grasp"])


def on_table() -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.0, 0.03]
    return pose


def test_a_gripper_whose_second_jaw_only_mimics_takes_an_object(tmp_path):
    without_limit = gripper(tmp_path, lambda joint: re.sub(r"<limit[^>]*>", "", joint))
    robot = load_robot(without_limit)
    assert robot.followers == {"panda_finger_joint2": Following("panda_finger_joint1")}
    plan = plan_grasp(HandKinematics(robot), cube(), on_table(), GraspGeometry(opening=0.006))
    for jaws in (plan.touch, plan.open, plan.closed):
        assert_allclose(jaws[0], jaws[1], atol=1e-4)
    assert plan.open[0] > plan.touch[0] > plan.closed[0]


def test_jaws_that_would_have_to_stand_apart_are_named(tmp_path):
    robot = load_robot(gripper(tmp_path, lambda joint: joint))
    positions = robot.start.copy()
    grasp_planner._refuse_apart(robot, "touch", positions)
    positions[-1] += 0.003
    with pytest.raises(
        NotIdentifiableError, match="panda_finger_joint2 mimics panda_finger_joint1"
    ):
        grasp_planner._refuse_apart(robot, "touch", positions)


def test_a_coupled_fingertip_reaches_its_place_as_its_coupling_allows(tmp_path):
    """The last joint of the Allegro's index finger follows the one before."""
    values = yaml.safe_load(robot_file("allegro_iiwa").read_text())
    urdf = load_robot().urdf
    *_, third, last = load_robot().hand[0].joints
    head, name, tail = urdf.partition(f'<joint name="{last.name}"')
    tag = f'<mimic joint="{third.name}" multiplier="0.8" offset="0.1"/></joint>'
    (tmp_path / "own.urdf").write_text(head + name + tail.replace("</joint>", tag, 1))
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(values | {"urdf": "own.urdf"}))
    robot = load_robot(str(tmp_path / "own.yaml"))
    kinematics, index = HandKinematics(robot), robot.owned["index"]
    matrix, offset = coupling(robot.hand[0].joints)
    assert_allclose(robot.hand[0].seed, matrix @ robot.hand[0].seed + offset)
    there = robot.start.copy()
    there[index] = matrix @ (there[index] + [0.1, 0.15, 0.2, 9.0]) + offset
    where = kinematics.locate(there)
    preferred = np.array([finger.pad for finger in robot.hand])
    directions = np.einsum("fij,fj->fi", where.sensors[:, :3, :3], preferred)
    tips = where.sensors[:, :3, 3]
    found, errors = solve_fingers(kinematics, robot.start, tips, directions, preferred, 60)
    assert errors.max() < 1e-4
    assert found[index][3] == pytest.approx(0.8 * found[index][2] + 0.1, abs=1e-12)


def test_an_arm_with_coupled_joints_is_refused_with_the_reason(tmp_path):
    values = yaml.safe_load(robot_file("panda_gripper").read_text())
    urdf = load_robot("panda_gripper").urdf
    head, name, tail = urdf.partition('<joint name="panda_joint4"')
    tag = '<mimic joint="panda_joint2"/></joint>'
    (tmp_path / "own.urdf").write_text(head + name + tail.replace("</joint>", tag, 1))
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(values | {"urdf": "own.urdf"}))
    with pytest.raises(BadInputError, match="panda_joint4 of the arm mimics another one"):
        load_robot(str(tmp_path / "own.yaml"))
