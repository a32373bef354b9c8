"""The friction probe's node: when it refuses, what it commands, and how it stops."""

import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.contact.contact_state import ContactState
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.nodes.friction_probe import REST, FrictionProbeNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.shell import LATCHED

ROBOT = load_robot()

POSITIONS = ROBOT.start


class Hand:
    """Sends what a robot with a still hand publishes."""

    def __init__(self, bench):
        self.bench = bench
        self.node = bench.start(FrictionProbeNode)
        self.contacts = ContactState(self.node.kinematics)
        self.time = 1.0

    def send(self, presses, turned=0.0, shift=0.0):
        """Publish one instant.

        Args:
            presses: newton by finger.
            turned: rad, of the first joint.
            shift: m, of the object.
        """
        self.time += 0.01
        send, stamp = self.bench.send, self.time
        place = np.eye(4)
        place[0, 3] = shift
        pose = cv.uncertain_pose_to_message(place, 1e-8 * np.eye(6), stamp, "world")
        send("/object/pose/vision", pose)
        for finger in ROBOT.fingers:
            force = presses.get(finger, 0.0) * np.array([0.3, 0.0, -0.95])
            seen = self.contacts.update(finger, POSITIONS, force, np.full(3, 0.03))
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = seen.rotation, seen.point
            wrench = np.concatenate([np.zeros(3), seen.force])
            send(f"/contact/{finger}/pose", cv.pose_to_message(matrix, stamp, "world"))
            send(f"/contact/{finger}/force", cv.wrench_to_message(wrench, stamp, "world"))
        names = self.node.kinematics.joint_names
        joints = POSITIONS + turned * np.eye(len(POSITIONS))[0]
        send("/joint_states", cv.joints_to_message(names, stamp, joints))
        self.bench.work()

    def rest(self, presses, turned=0.0):
        """Publish until the hand has stood still for long enough."""
        for _ in range(round(REST / 0.01) + 2):
            self.send(presses, turned)

    def ask(self):
        """Call the service as a client in this process would be answered."""
        started = time.perf_counter()
        response = Trigger.Response()
        try:
            response.message, response.success = self.node.start(), True
        except Exception as error:
            response.message, response.success = str(error), False
        return response, time.perf_counter() - started


HOLDING = {"index": 0.6, "middle": 0.6, "ring": 0.6, "thumb": 1.8}


@pytest.fixture
def hand(bench):
    return Hand(bench)


def test_it_refuses_until_the_object_is_held(hand):
    answer, _ = hand.ask()
    assert not answer.success
    assert "no joint_states" in answer.message
    hand.rest({**HOLDING, "ring": 0.0})
    answer, spent = hand.ask()
    assert not answer.success
    assert "not held, ring" in answer.message
    assert spent < 0.1


def test_it_refuses_while_the_hand_moves_and_begins_where_the_object_has_come_to_rest(hand):
    hand.bench.send("/grasp_controller/phase", String(data="excite"), profile=LATCHED)
    active = hand.bench.follow(Bool, "/friction_probe/active", profile=LATCHED)
    hand.bench.until(lambda: hand.node._phase)
    begun, start = [], hand.node.probe.start
    hand.node.probe.start = lambda seen, targets: (begun.append(seen), start(seen, targets))
    for k in range(60):
        hand.send(HOLDING, turned=0.002 * k, shift=0.002 * k)
    answer, _ = hand.ask()
    assert not answer.success
    assert "the hand moves (grasp_controller: excite)" in answer.message
    assert not active
    hand.rest(HOLDING, turned=0.002 * 60)
    answer, _ = hand.ask()
    assert answer.success, answer.message
    np.testing.assert_allclose(begun[0].object_pose, np.eye(4), atol=1e-9)


def test_it_commands_the_hand_and_an_emergency_stop_ends_that(hand):
    commands = hand.bench.follow(JointState, "/joint_command")
    active = hand.bench.follow(Bool, "/friction_probe/active", profile=LATCHED)
    hand.rest(HOLDING)
    answer, spent = hand.ask()
    assert answer.success, answer.message
    assert spent < 0.1
    assert not hand.ask()[0].success
    for _ in range(10):
        hand.send(HOLDING)
    hand.bench.until(lambda: commands)
    assert len(commands[-1].names) == 16
    assert active[-1].data
    hand.bench.send("/emergency_stop", Bool(data=True), profile=10)
    hand.bench.until(lambda: not active[-1].data)
    count = len(commands)
    for _ in range(5):
        hand.send(HOLDING)
    assert len(commands) == count
    assert "emergency stop" in hand.ask()[0].message
    hand.bench.send("/emergency_stop", Bool(data=False), profile=10)
    hand.bench.until(lambda: not hand.node._emergency.active)
    for _ in range(20):
        hand.send(HOLDING)
    assert len(commands) == count
    answer, _ = hand.ask()
    assert answer.success, answer.message
    for _ in range(10):
        hand.send(HOLDING)
    assert len(commands) > count


def test_it_refuses_while_a_stop_from_before_its_life_is_on(bench):
    rclpy.init(args=[])
    panel = Node("panel")
    panel.create_publisher(Bool, "/emergency_stop", LATCHED).publish(Bool(data=True))
    hand = Hand(bench)
    bench.until(lambda: hand.node._emergency.active)
    hand.rest(HOLDING)
    assert "emergency stop" in hand.ask()[0].message
    panel.destroy_node()


def test_the_probe_feels_the_electrodes_move(hand):
    rng, told, update = np.random.default_rng(0), [], hand.node.probe.update
    hand.node.probe.update = lambda seen: (told.append(seen.electrodes), update(seen))[1]

    def frame(presses, shift=0.0):
        counts = 2000.0 + rng.normal(0.0, 3.0, (4, 44)) + shift * np.arange(44)
        raw = cv.biotac_to_message(counts.astype(np.uint16), hand.time, "hand")
        hand.bench.send("/biotac/raw", raw)
        hand.send(presses)

    for _ in range(70):
        frame({**HOLDING, "index": 0.0})
    for _ in range(round(REST / 0.01)):
        frame(HOLDING)
    assert hand.ask()[0].success
    for _ in range(10):
        frame(HOLDING)
    assert max(map(abs, told)) < 1.0
    for k in range(10):
        frame(HOLDING, shift=0.5 * k)
    assert told[-1] > 2.0


def test_a_probe_without_slips_ends_with_a_reason(hand):
    estimates = hand.bench.follow(DiagnosticStatus, "/friction_probe/estimate", profile=LATCHED)
    hand.rest(HOLDING)
    assert hand.ask()[0].success
    for _ in range(200):
        hand.send({"thumb": 1.0})
        if hand.node.probe.done:
            break
    hand.bench.until(lambda: estimates and status_values(estimates[-1])["final"] == "True")
    assert status_values(estimates[-1])["regions"] == ""
    assert "lost contact" in estimates[-1].message
