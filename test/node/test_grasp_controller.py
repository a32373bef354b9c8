"""The grasp controller as a node: what it does when it starts or has paused."""

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from tactile_dynamics_ros.core.contact.robot_description import FINGERS, JOINT_NAMES
from tactile_dynamics_ros.core.manipulation.grasp_planner import ARM_HOME, HAND_SEED
from tactile_dynamics_ros.nodes import conversions as cv
from tactile_dynamics_ros.nodes.grasp_controller import GraspControllerNode
from tactile_dynamics_ros.nodes.shell import LATCHED

POSITIONS = np.concatenate([ARM_HOME, HAND_SEED])
WRENCH = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.5])


def send_forces(bench, time):
    for finger in FINGERS:
        bench.send(f"/contact/{finger}/force", cv.wrench_to_message(WRENCH, time, "world"))


def send_joints(bench, time):
    bench.send("/joint_states", cv.joints_to_message(JOINT_NAMES, time, POSITIONS))


def test_object_in_the_hand_stays_there_when_messages_have_piled_up(bench):
    bench.start(GraspControllerNode)
    phases = bench.follow(String, "/grasp_controller/phase", profile=LATCHED)
    commands = bench.follow(JointState, "/joint_command")
    bench.send("/joint_states", cv.joints_to_message(JOINT_NAMES[:5], 1.0, POSITIONS[:5]))
    send_forces(bench, 1.0)
    bench.work(0.05)
    for time in np.arange(1.01, 1.455, 0.01):
        send_forces(bench, time)
    send_joints(bench, 1.45)
    bench.until(lambda: phases)
    assert [phase.data for phase in phases] == ["resumed"]
    send_joints(bench, 1.46)
    bench.until(lambda: commands)
    assert list(commands[0].names) == list(JOINT_NAMES[:7])
