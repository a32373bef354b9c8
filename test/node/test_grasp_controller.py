"""The grasp controller as a node: nothing moves unasked, and what stops it."""

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.nodes.grasp_controller import GraspControllerNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.names import EMERGENCY_STOP
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

ROBOT = load_robot()

POSITIONS = ROBOT.start
PRESS = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.5])
OBJECT = np.eye(4)
OBJECT[:3, 3] = 0.55, 0.0, 0.06


class Robot:
    """Sends what a robot publishes whose arm follows every command at once."""

    def __init__(self, bench):
        self.bench = bench
        self.node = bench.start(GraspControllerNode)
        self.phases = bench.follow(String, "/grasp_controller/phase", profile=LATCHED)
        self.commands = bench.follow(JointState, "/joint_command")
        self.time, self.positions = 1.0, POSITIONS.copy()

    def joints(self, count=23):
        """Publish joint states."""
        names, positions = ROBOT.joint_names[:count], self.positions[:count]
        self.bench.send("/joint_states", cv.joints_to_message(names, self.time, positions))

    def forces(self, wrench):
        """Publish the same force of all fingers."""
        for finger in ROBOT.fingers:
            message = cv.wrench_to_message(wrench, self.time, "world")
            self.bench.send(f"/contact/{finger}/force", message)

    def pose(self):
        """Publish the object's pose as vision sees it."""
        message = cv.uncertain_pose_to_message(OBJECT, 1e-8 * np.eye(6), self.time, "world")
        self.bench.send("/object/pose/vision", message)

    def run(self, seconds, pose=True, press=0.0):
        """Let time pass; the arm goes where it is told to."""
        for _ in range(round(100 * seconds)):
            self.time += 0.01
            if self.commands:
                targets = dict(
                    zip(self.commands[-1].names, self.commands[-1].positions, strict=True)
                )
                told = [
                    targets.get(name, old)
                    for name, old in zip(ROBOT.joint_names, self.positions, strict=True)
                ]
                self.positions = np.array(told)
            if pose:
                self.pose()
            self.forces(press * PRESS)
            self.joints()
            self.bench.work()

    def say_stop(self, stop, profile=LATCHED):
        """Press or release the emergency stop and wait until that has been heard."""
        self.bench.send(EMERGENCY_STOP, Bool(data=stop), profile=profile)
        self.bench.until(lambda: self.node._emergency.active is stop)

    def ask(self):
        """Call the service as a client is answered."""
        service = next(s for s in self.node.services if s.srv_name == "grasp_controller/start")
        return service.callback(Trigger.Request(), Trigger.Response())


@pytest.fixture
def robot(bench):
    return Robot(bench)


def test_no_command_before_start_and_commands_after_it(robot):
    robot.run(4.0)
    assert robot.commands == []
    assert robot.phases[-1].data == "idle: call grasp_controller/start"
    answer = robot.ask()
    assert answer.success, answer.message
    assert "box_0" in answer.message
    robot.run(1.0)
    assert len(robot.commands) > 80
    assert robot.phases[-1].data == "approach"
    again = robot.ask()
    assert not again.success
    assert "already runs (approach)" in again.message


def test_start_says_what_is_missing(robot):
    assert "no joint_states yet" in robot.ask().message
    robot.joints()
    robot.bench.work(0.05)
    assert "no contact/index/force yet" in robot.ask().message
    robot.run(0.1, pose=False)
    assert "0 of 10 have come on object/pose/vision" in robot.ask().message
    robot.run(0.2)
    robot.run(6.0, pose=False)
    answer = robot.ask()
    assert not answer.success
    assert "is 6.0 s old, more than pose_timeout 5 s" in answer.message
    assert robot.commands == []


@pytest.mark.parametrize("profile", [LATCHED, STREAM, 10])
def test_emergency_stop_ends_the_motion_until_a_new_call(robot, profile):
    robot.run(0.3)
    assert robot.ask().success
    robot.run(1.0)
    robot.say_stop(True, profile)
    count, arm = len(robot.commands), robot.positions[:7]
    robot.run(2.0)
    assert len(robot.commands) == count
    assert robot.phases[-1].data == "stopped: the emergency stop is on"
    assert "emergency stop is on" in robot.ask().message
    robot.say_stop(False, profile)
    robot.run(2.0)
    assert len(robot.commands) == count
    answer = robot.ask()
    assert answer.success
    assert answer.message == "the interrupted motion goes on"
    robot.run(0.1)
    assert robot.phases[-1].data == "approach"
    first = np.array(robot.commands[count].positions)[:7]
    np.testing.assert_allclose(first, arm, atol=0.05)


def test_arm_that_was_moved_during_the_stop_is_planned_for_anew(robot):
    robot.run(0.3)
    assert robot.ask().success
    robot.run(1.0)
    robot.say_stop(True)
    robot.commands.clear()
    robot.positions[3] += 0.3
    robot.run(0.2)
    robot.say_stop(False)
    assert "grasping" in robot.ask().message
    robot.run(0.1)
    first = np.array(robot.commands[0].positions)[:7]
    np.testing.assert_allclose(first, robot.positions[:7], atol=0.02)


def test_stop_that_was_pressed_before_the_node_lived_holds(bench):
    import rclpy
    from rclpy.node import Node

    rclpy.init(args=[])
    panel = Node("panel")
    panel.create_publisher(Bool, EMERGENCY_STOP, LATCHED).publish(Bool(data=True))
    robot = Robot(bench)
    bench.until(lambda: robot.node._emergency.active)
    robot.run(0.3)
    assert "emergency stop is on" in robot.ask().message
    assert robot.commands == []
    panel.destroy_node()


def test_a_clock_that_restarts_ends_the_motion(robot):
    robot.run(0.3)
    assert robot.ask().success
    robot.run(0.5)
    robot.time = 0.0
    robot.run(0.1)
    robot.commands.clear()
    robot.run(1.0)
    assert robot.commands == []
    assert robot.phases[-1].data.startswith("idle")


def test_object_in_the_hand_stays_there_when_messages_have_piled_up(robot):
    robot.joints(count=5)
    robot.forces(PRESS)
    robot.bench.work(0.05)
    robot.run(0.1, pose=False, press=1.0)
    assert "what is held" in robot.ask().message
    for _ in range(45):
        robot.time += 0.01
        robot.forces(PRESS)
    robot.joints()
    robot.bench.until(lambda: robot.phases[-1].data == "resumed" or robot.run(0.01, False, 1.0))
    assert [phase.data for phase in robot.phases] == [
        "idle: call grasp_controller/start",
        "resumed",
    ]
    robot.bench.until(lambda: robot.commands)
    assert list(robot.commands[0].names) == list(ROBOT.joint_names[:7])
