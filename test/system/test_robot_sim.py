"""The simulated robot as a process: topics, physics of commands, truth on request."""

import json

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from system_listener import Listener, as_read

from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command
from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.ros import conversions as cv

ROBOT = load_robot()

TOPICS = {
    "/clock": Clock,
    "/joint_states": JointState,
    "/biotac/raw": Image,
    "/wrist/wrench": WrenchStamped,
    "/object/pose/vision": PoseWithCovarianceStamped,
    "/camera/depth/image_rect": Image,
    "/camera/depth/camera_info": CameraInfo,
}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """A running robot_sim with a camera, and a listener that hears all its topics."""
    parameters = {"depth_rate_hz": 2.0, "world.object_name": "box_3", "seed": 4}
    with Supervisor(tmp_path_factory.mktemp("logs")) as supervisor:
        supervisor.start("robot_sim", node_command("robot_sim", None, parameters))
        listener = Listener()
        for topic, kind in TOPICS.items():
            listener.follow(kind, topic)
        for topic in TOPICS:
            listener.wait(lambda topic=topic: listener.seen[topic], 60.0, topic)
        yield listener
        rclpy.try_shutdown()


def test_topics_are_as_the_contract_says(robot):
    joints = robot.wait_for_new("/joint_states")
    assert tuple(joints.name) == ROBOT.joint_names
    assert len(joints.position) == len(joints.velocity) == len(joints.effort) == 23
    counts = cv.biotac_to_core(as_read(robot.wait_for_new("/biotac/raw")), "/biotac/raw")
    assert counts.shape == (4, 44)
    assert ((counts[:, :19] > 1500) & (counts[:, :19] < 3900)).all()
    pose, covariance = cv.uncertain_pose_to_core(
        as_read(robot.wait_for_new("/object/pose/vision")), "/object/pose/vision", "world"
    )
    assert 0.0 < pose[2, 3] < 0.2
    assert (np.diag(covariance) > 0).all()
    depth = cv.depth_to_core(as_read(robot.wait_for_new("/camera/depth/image_rect")), "/camera")
    info = robot.wait_for_new("/camera/depth/camera_info")
    assert depth.shape == (info.height, info.width)
    assert 0.3 < np.nanmedian(depth) < 3.5
    stamps = [cv.to_seconds(m.header.stamp) for m in robot.seen["/joint_states"]]
    robot.wait_for_new("/joint_states", count=30)
    stamps = [cv.to_seconds(m.header.stamp) for m in robot.seen["/joint_states"]]
    assert np.median(np.diff(stamps)) == pytest.approx(0.01, abs=1e-6)


def test_wrist_feels_the_weight_of_the_hand_downwards(robot):
    wrench = cv.wrench_to_core(as_read(robot.wait_for_new("/wrist/wrench")), "/wrist/wrench")
    assert 5.0 < np.linalg.norm(wrench[3:]) < 25.0


def test_commanded_positions_are_approached_not_jumped_to(robot):
    publisher = robot.node.create_publisher(JointState, "/joint_command", 10)
    start = np.array(robot.wait_for_new("/joint_states").position)
    wanted = start[1] - 0.4
    message = JointState(name=[ROBOT.joint_names[1]], position=[float(wanted)])
    robot.wait(lambda: publisher.get_subscription_count() > 0, 10.0, "/joint_command heard")
    robot.seen["/joint_states"].clear()

    def arrived():
        publisher.publish(message)
        states = robot.seen["/joint_states"]
        return bool(states) and abs(states[-1].position[1] - wanted) < 0.01

    robot.wait(arrived, 30.0, "arm at its target")
    path = np.array([m.position[1] for m in robot.seen["/joint_states"]])
    time = np.array([cv.to_seconds(m.header.stamp) for m in robot.seen["/joint_states"]])
    speed = np.abs(np.diff(path) / np.diff(time)).max()
    assert 0.05 < speed < 2.0 * ROBOT.joints[1].velocity
    assert abs(robot.seen["/joint_states"][-1].position[0] - start[0]) < 0.02


def test_command_is_executed_a_fixed_time_after_its_stamp(robot):
    publisher = robot.node.create_publisher(JointState, "/joint_command", 10)
    robot.wait(lambda: publisher.get_subscription_count() > 0, 10.0, "/joint_command heard")
    state = robot.wait_for_new("/joint_states")
    due = cv.to_seconds(state.header.stamp) + 1.0
    target = np.array([state.position[6] + 0.2])
    command = cv.joints_to_message(ROBOT.joint_names[6:7], due, target)
    robot.seen["/joint_states"].clear()

    def path():
        states = robot.seen["/joint_states"]
        return np.array([(cv.to_seconds(m.header.stamp), m.position[6]) for m in states])

    def turned():
        found = path()
        if not len(found) or found[-1, 0] < due - 0.3:
            publisher.publish(command)  # the robot may know of this publisher later than it of it
        return len(found) > 0 and found[-1, 1] > target[0] - 0.01

    robot.wait(turned, 30.0, "the turn")
    time, angle = path().T
    started = time[np.argmax(angle > state.position[6] + 0.01)] - due
    assert 0.03 < started < 0.15


def test_commands_that_cannot_be_meant_are_counted_and_harmless(robot):
    from diagnostic_msgs.msg import DiagnosticArray

    from tactile_dynamics_ros.ros.diagnostics import status_values

    robot.follow(DiagnosticArray, "/diagnostics")
    publisher = robot.node.create_publisher(JointState, "/joint_command", 10)
    robot.wait(lambda: publisher.get_subscription_count() > 0, 10.0, "/joint_command heard")

    def counted():
        publisher.publish(JointState(name=["elbow"], position=[1.0]))
        publisher.publish(JointState(name=[ROBOT.joint_names[0]], position=[float("nan")]))
        publisher.publish(cv.joints_to_message(ROBOT.joint_names[:1], 1e4, np.zeros(1)))
        found = [status_values(s) for m in robot.seen["/diagnostics"] for s in m.status]
        faults = {"unknown_joint", "not_finite", "command_ahead"}
        return any(faults <= set(f) for f in found)

    robot.wait(counted, 20.0, "fault counts")
    robot.wait_for_new("/joint_states", count=5)


def test_reveal_tells_the_truth_as_json(robot):
    success, message = call_trigger(robot.node, "/robot_sim/reveal", 20.0)
    truth = json.loads(message)
    assert success
    assert truth["object"] == "box_3"
    assert truth["mass"] > 0.05
    assert truth["hidden_effect"]["name"] == "none"
