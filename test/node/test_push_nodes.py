"""Nodes that push: nothing moves unasked, what stops them, what they tell."""

import json

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Bool, Float64
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.planar.control.prediction import PushedBody, pushed
from tactile_dynamics_ros.nodes import explorer, push_controller
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.diagnostics import status_message, status_values
from tactile_dynamics_ros.ros.names import (
    EMERGENCY_STOP,
    EXPLORE,
    GOAL_POSE,
    GRIPPER_WIDTH,
    OBJECT_POSE,
    PROPERTY_STATUS,
    PUSH_PROGRESS,
    PUSH_STOP,
    PUSHER_POSE,
    PUSHER_TARGET,
    link_topic,
)
from tactile_dynamics_ros.ros.pusher_streams import outline_message
from tactile_dynamics_ros.ros.shell import LATCHED
from tactile_dynamics_ros.ros.table_scene import tip_pose

BOX = np.array([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]])
STEP = 0.02
"""Time between poses of the tip, s."""


class Table:
    """A tip that is where it was sent, and a box that moves as predicted."""

    def __init__(self, bench, factory, *arguments):
        self.bench, self.node = bench, bench.start(factory, *arguments)
        self.goals = self.node.create_publisher(PoseStamped, GOAL_POSE, 10)
        self.targets = bench.follow(PoseStamped, PUSHER_TARGET)
        self.told = bench.follow(DiagnosticStatus, PUSH_PROGRESS, profile=LATCHED)
        self.thing = PushedBody.from_footprint(BOX, None, 0.006, 0.35)
        self.tip, self.pose = np.array([0.35, -0.2, 0.3, 0.0]), np.array([0.46, 0.09, 0.1])
        self.time, self.count, self.fallen = 1.0, 0, False

    def outline(self):
        message = outline_message(BOX, "object")
        self.bench.send(link_topic("link_1", "footprint"), message, profile=LATCHED)

    def tell(self):
        """Move the tip to its newest target, and tell where all is."""
        self.time += STEP
        if len(self.targets) > self.count:
            self.count = len(self.targets)
            wanted = cv.pose_to_core(self.targets[-1], PUSHER_TARGET, "world")
            if max(self.tip[2], wanted[2, 3]) < 0.05:
                way = wanted[None, :2, 3] - self.tip[None, :2]
                self.pose = pushed(self.thing, self.pose[None], self.tip[None, :2], way)[0][0]
            self.tip = np.array([*wanted[:3, 3], 0.0])
        place = tip_pose(np.array([*self.pose[:2], 0.0, self.pose[2]]))
        if self.fallen:
            place[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        told = cv.uncertain_pose_to_message(place, 1e-6 * np.eye(6), self.time, "world")
        self.bench.send(OBJECT_POSE, told)
        self.bench.send(PUSHER_POSE, cv.pose_to_message(tip_pose(self.tip), self.time, "world"))
        self.bench.work(0.006)

    def ask(self, x=0.5, y=0.1, yaw=0.0):
        goal = tip_pose(np.array([x, y, 0.0, yaw]))
        self.goals.publish(cv.pose_to_message(goal, self.time, "world"))

    def until(self, condition, steps=4000):
        for _ in range(steps):
            if condition():
                return
            self.tell()
        raise AssertionError("condition not met")

    def said(self, state):
        return [s for s in self.told if status_values(s)["state"] == state]


@pytest.fixture
def table(bench):
    return Table(bench, push_controller.PushControllerNode)


def test_it_pushes_to_a_goal_and_tells_how_it_ended(table):
    table.outline()
    for _ in range(20):
        table.tell()
    assert not table.targets  # nothing moves unasked
    table.ask()
    table.until(lambda: table.said("finished"))
    result = json.loads(status_values(table.said("finished")[-1])["result"])
    assert result["reached"]
    assert result["error_m"] < 2.5e-3
    assert result["pushes"] >= 1
    sent = len(table.targets)
    for _ in range(20):
        table.tell()
    assert len(table.targets) == sent


def test_each_of_the_poses_that_come_together_is_answered_so_that_no_motion_has_holes(table):
    table.outline()
    table.tell()
    table.ask()
    table.until(lambda: len(table.targets) > 10)
    sent, wanted = len(table.targets), [round(table.time + 0.01 * k, 3) for k in range(1, 5)]
    for stamp in wanted:
        place = cv.pose_to_message(tip_pose(table.tip), stamp, "world")
        table.bench.publishers[PUSHER_POSE].publish(place)
    table.bench.until(lambda: len(table.targets) >= sent + len(wanted), 5.0)
    stamps = [message.stamp for message in table.targets[sent:]]
    assert [round(stamp.sec + 1e-9 * stamp.nanosec, 3) for stamp in stamps] == wanted


def test_an_emergency_stop_ends_a_push_and_forbids_another(table):
    table.outline()
    table.tell()
    table.ask()
    table.until(lambda: len(table.targets) > 10)
    table.bench.send(EMERGENCY_STOP, Bool(data=True))
    table.until(lambda: table.node.stop.active, 50)
    sent = len(table.targets)
    table.until(lambda: table.said("finished"), 50)
    assert "emergency stop" in table.said("finished")[-1].message
    table.ask(0.55)
    table.until(lambda: table.said("refused"), 50)
    assert len(table.targets) <= sent + 1


@pytest.mark.parametrize("cause", ["fallen", "stop"])
def test_what_falls_over_or_is_called_off_is_left(table, cause):
    table.outline()
    table.tell()
    table.ask()
    table.until(lambda: len(table.targets) > 10)
    if cause == "stop":
        service = next(s for s in table.node.services if s.srv_name == PUSH_STOP)
        assert service.callback(Trigger.Request(), Trigger.Response()).success
    table.fallen = cause == "fallen"
    table.until(lambda: table.said("finished"), 50)
    words = {"fallen": "fallen over", "stop": "told to stop"}
    assert words[cause] in table.said("finished")[-1].message


def test_a_goal_without_an_outline_is_refused(table):
    table.tell()
    table.ask()
    table.until(lambda: table.said("refused"), 50)
    assert "footprint" in table.said("refused")[-1].message
    assert not table.targets


def test_the_explorer_pushes_on_request_until_all_is_known(bench):
    few = ("places:=3", "speeds:=[0.2]", "length:=0.03")
    table = Table(bench, explorer.ExplorerNode, *(word for p in few for word in ("-p", p)))
    table.outline()
    for _ in range(5):
        table.tell()
    service = next(s for s in table.node.services if s.srv_name == EXPLORE)
    running = service.callback(Trigger.Request(), Trigger.Response())
    fits = 0

    def answered():
        try:
            running.send(None)
        except StopIteration as end:
            return end.value
        return None

    def estimate(std):
        values = {"friction_force_n": 2.0, "mass": 0.8, "com_x": 0.0, "com_y": 0.0}
        spread = {f"{name}_std": std * value for name, value in values.items()}
        spread |= {"com_x_std": 0.01 * std, "com_y_std": 0.01 * std}
        message = DiagnosticArray()
        message.status = [
            status_message("link_1", {**values, **spread, "undetermined": ""}),
            status_message("solver", {"fits": fits, "refused": ""}),
        ]
        return message

    publisher = table.node.create_publisher(DiagnosticArray, PROPERTY_STATUS, LATCHED)
    answer = None
    for _ in range(6000):
        answer = answered()
        if answer is not None:
            break
        run = table.node._run
        if run is not None and run.actions and run.performance is None and run.choosing is None:
            fits = len(run.actions)
            publisher.publish(estimate(0.2 if fits < 2 else 0.01))
        table.tell()
    assert answer is not None
    told = json.loads(answer.message)
    assert answer.success, told
    assert len(told["actions"]) == 2
    assert "known to the wanted width" in told["stopped_because"]
    assert told["properties"]["links"][0]["mass"]["value"] == 0.8
    assert np.hypot(*(table.pose[:2] - [0.46, 0.09])) > 0.01  # it was pushed


def test_jaws_that_are_open_are_not_taken_for_a_tip(table):
    table.outline()
    table.tell()
    table.bench.send(GRIPPER_WIDTH, Float64(data=0.05))
    table.until(lambda: table.node.scene.width > 0.04, 50)
    table.ask()
    table.until(lambda: table.said("refused"), 50)
    assert "50 mm open" in table.said("refused")[-1].message
    assert not table.targets


def tell_second(table, turn, about):
    """Tell a second part that turned about a place (2,) of its frame that lies at x = 55 mm."""
    table.tell()
    yaw = table.pose[2]
    joint = table.pose[:2] + 0.055 * np.array([np.cos(yaw), np.sin(yaw)])
    (x, y), (c, s) = about, (np.cos(yaw + turn), np.sin(yaw + turn))
    second = tip_pose(np.array([*(joint - [c * x - s * y, s * x + c * y]), 0.0, yaw + turn]))
    told = cv.uncertain_pose_to_message(second, 1e-6 * np.eye(6), table.time, "world")
    table.bench.send(link_topic("link_2", "pose"), told)
    table.bench.work(0.006)


@pytest.fixture
def pair(table):
    table.outline()
    beside = np.array([[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]])
    message = outline_message(beside, "object/link_2")
    table.bench.send(link_topic("link_2", "footprint"), message, profile=LATCHED)
    return table


def test_two_parts_are_one_body_until_they_turn_without_a_joint_and_the_second_is_in_the_way(pair):
    for _ in range(30):
        tell_second(pair, 0.0, (-0.03, 0.0))
    body = pair.node.scene.body()
    assert body.hinge.locked
    second = body.poses(body.states(np.zeros(3), 1))[1][0]
    np.testing.assert_allclose(second, [0.085, 0.0, 0.0], atol=1e-6)
    for _ in range(30):  # about the far end of the second: where nothing holds it
        tell_second(pair, 0.1, (-0.06, 0.0))
    np.testing.assert_allclose(pair.node.scene.body().second[0], [0.0878, -0.0268], atol=1e-3)


def test_two_parts_that_turn_about_where_they_meet_are_pushed_as_on_a_joint(pair):
    for turn in np.linspace(0.0, 0.3, 100):
        tell_second(pair, turn, (-0.03, 0.0))
    body = pair.node.scene.body()
    np.testing.assert_allclose(body.hinge.first, [0.055, 0.0], atol=1e-3)
    np.testing.assert_allclose(body.hinge.second, [-0.03, 0.0], atol=1e-3)
    assert body.bend == pytest.approx(0.3, abs=1e-3)
    pair.ask()
    pair.until(lambda: pair.said("pushing"), 400)
    assert "two parts on a joint" in status_values(pair.said("pushing")[-1])["object"]


def test_of_two_parts_the_explorer_first_pushes_where_a_joint_would_turn(bench):
    few = ("places:=3", "speeds:=[0.2]", "length:=0.03")
    table = Table(bench, explorer.ExplorerNode, *(word for p in few for word in ("-p", p)))
    table.outline()
    beside = np.array([[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]])
    message = outline_message(beside, "object/link_2")
    bench.send(link_topic("link_2", "footprint"), message, profile=LATCHED)
    for _ in range(30):
        tell_second(table, 0.0, (-0.03, 0.0))
    table.until(lambda: table.node._pair is not None, 50)
    service = next(s for s in table.node.services if s.srv_name == EXPLORE)
    service.callback(Trigger.Request(), Trigger.Response()).send(None)
    for _ in range(2000):
        tell_second(table, 0.0, (-0.03, 0.0))
        if table.node._run.actions:
            break
    (action,) = table.node._run.actions
    assert "tells whether the parts are one body" in action["chosen_because"]
    assert action["part"] == table.node._run.part + 1
