"""Nodes of other robots: pads that carry torque, and a URDF that a robot publishes."""

import numpy as np
import pytest
import rclpy
import yaml
from geometry_msgs.msg import PoseStamped, WrenchStamped
from std_msgs.msg import String

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot, robot_file
from tactile_dynamics_ros.nodes.biotac_force import BiotacForce
from tactile_dynamics_ros.nodes.contact_state import ContactStateNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros import robot as ros_robot
from tactile_dynamics_ros.ros.shell import LATCHED

GRIPPER = load_robot("panda_gripper")
WRENCH = np.array([0.02, -0.01, 0.03, 0.4, -0.3, 8.0])


def published_file(folder):
    """Return the gripper's file that leaves the URDF to the robot."""
    values = yaml.safe_load(robot_file("panda_gripper").read_text())
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(values | {"urdf": "/robot_description"}))
    return path


def test_a_pad_publishes_force_torque_and_pose(bench):
    bench.start(ContactStateNode, "-p", "robot:=panda_gripper")
    forces = bench.follow(WrenchStamped, "/contact/pad_left/force")
    poses = bench.follow(PoseStamped, "/contact/pad_left/pose")
    for time in (1.0, 1.02):
        joints = cv.joints_to_message(GRIPPER.joint_names, time, GRIPPER.start)
        bench.send("/joint_states", joints)
    bench.work(0.05)
    std = cv.std_to_message(np.full(3, 0.03), 1.01, "pad_left")
    bench.send("/pad/pad_left/force_std", std)
    bench.send("/pad/pad_left/force", cv.wrench_to_message(WRENCH, 1.01, "pad_left"))
    bench.until(lambda: forces and poses)
    sensor = HandKinematics(GRIPPER).sensor_pose("pad_left", GRIPPER.start)
    told = cv.wrench_to_core(forces[0], "/f", "world").reshape(2, 3)
    assert told == pytest.approx(WRENCH.reshape(2, 3) @ sensor[:3, :3].T, abs=1e-9)
    assert cv.pose_to_core(poses[0], "/p", "world") == pytest.approx(sensor, abs=1e-9)


def test_a_node_hears_the_urdf_of_its_robot(bench, tmp_path):
    rclpy.init(args=["--ros-args", "-p", f"robot:={published_file(tmp_path)}"])
    teller = rclpy.create_node("teller")
    publisher = teller.create_publisher(String, "/robot_description", LATCHED)
    urdf = load_robot("panda_gripper").urdf.replace('xyz="0 0 0.333"', 'xyz="0 0 0.4"')
    publisher.publish(String(data=urdf.split('<link name="pad_left">')[0] + "</robot>"))
    node = bench.start(ContactStateNode)
    teller.destroy_node()
    raised = HandKinematics(node.robot).sensor_pose("pad_left", GRIPPER.start)
    usual = HandKinematics(GRIPPER).sensor_pose("pad_left", GRIPPER.start)
    assert raised[:3, 3] - usual[:3, 3] == pytest.approx([0.0, 0.0, 0.067])


def test_without_a_urdf_the_node_says_who_is_missing(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(ros_robot, "PATIENCE", 0.3)
    with pytest.raises(NotIdentifiableError, match="no URDF on /robot_description within 0.3 s"):
        bench.start(ContactStateNode, "-p", f"robot:={published_file(tmp_path)}")


def test_pads_have_no_counts(bench):
    with pytest.raises(BadInputError, match="fingertips of kind 'pad', expected 'biotac'"):
        bench.start(BiotacForce, "-p", "robot:=panda_gripper")
