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
    EXPLORE_PROGRESS,
    GOAL_POSE,
    GRIPPER_TARGET,
    GRIPPER_WIDTH,
    OBJECT_POSE,
    PROPERTY_STATUS,
    PUSH_PROGRESS,
    PUSH_STOP,
    PUSHER_POSE,
    PUSHER_TARGET,
    contact_topic,
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


class HardTable(Table):
    """A box that resists as a wall does to pushes that are not slow enough."""

    def __init__(self, bench, slow, *arguments):
        super().__init__(bench, explorer.ExplorerNode, *arguments)
        self.slow, self.jerked = slow, 0
        self.node.scene.properties = {"mass": 1.0}  # an estimator is there
        self.told = bench.follow(DiagnosticStatus, EXPLORE_PROGRESS, profile=LATCHED)

    def tell(self):
        lay, run = self.pose.copy(), self.node._run
        if run is not None and run.performance is not None and len(run.actions) == self.jerked:
            self.time += 0.1  # no pose comes for a while
        super().tell()
        fast = run is not None and bool(run.actions) and run.actions[-1]["speed"] > self.slow
        hit = fast and not np.array_equal(self.pose, lay)
        force = np.array([30.0 if hit else 0.0, 0.0, 0.0])
        message = cv.wrench_to_message(np.append(np.zeros(3), force), self.time, "world")
        self.bench.send(contact_topic("pusher", "force"), message)


def explored(table, steps=8000):
    """Let the explorer work until it has answered; return whether it ended by itself, and what."""
    table.outline()
    for _ in range(5):
        table.tell()
    service = next(s for s in table.node.services if s.srv_name == EXPLORE)
    running = service.callback(Trigger.Request(), Trigger.Response())
    for _ in range(steps):
        try:
            running.send(None)
        except StopIteration as end:
            return end.value.success, json.loads(end.value.message)
        run = table.node._run
        if run is not None and run.performance is None:
            run.since = -np.inf  # estimates are not awaited
        table.tell()
    raise AssertionError("no answer")


SWIFT = ("way.travel_speed:=1.0", "way.clearance:=0.05", "way.acceleration:=10.0")
FEW = [f for p in ("places:=3", "speeds:=[0.2]", "length:=0.03", *SWIFT) for f in ("-p", p)]


def test_after_too_much_force_the_explorer_draws_back_and_pushes_more_gently(bench):
    table = HardTable(bench, 0.11, *FEW, "-p", "budget:=3", "-p", "least:=3")
    table.jerked = 3
    success, told = explored(table)
    assert success, told
    speeds = [action["speed"] for action in told["actions"]]
    assert speeds == [0.2, 0.1, 0.1]
    assert "30.0 N, more than 25 N" in told["actions"][0]["stopped"]
    assert "stopped" not in told["actions"][1]
    assert told["actions"][1]["late"] == "no estimate of it after 60 s"
    assert ["jerked" in action for action in told["actions"]] == [False, False, True]
    assert any("half the speed" in status.message for status in table.said("stopped"))


def test_an_object_that_is_blocked_is_given_up_with_what_was_done(bench):
    table = HardTable(bench, 0.0, *FEW, "-p", "budget:=8", "-p", "least:=8")
    success, told = explored(table)
    assert not success
    assert [action["speed"] for action in told["actions"]] == [0.2, 0.1, 0.05, 0.025]
    assert "more than 25 N" in told["stopped_because"]


class ShortTable(Table):
    """An arm that cannot come down where the first push begins."""

    def __init__(self, bench, *arguments):
        super().__init__(bench, explorer.ExplorerNode, *arguments)
        self.node.scene.properties = {"mass": 1.0}  # an estimator is there
        self.told = bench.follow(DiagnosticStatus, EXPLORE_PROGRESS, profile=LATCHED)

    def tell(self):
        run = self.node._run
        if run is not None and len(run.actions) == 1 and len(self.targets) > self.count:
            wanted = cv.pose_to_core(self.targets[-1], PUSHER_TARGET, "world")
            if wanted[2, 3] < min(0.15, self.tip[2]):
                self.count = len(self.targets)
        super().tell()


def test_where_the_arm_cannot_go_the_explorer_draws_back_and_pushes_elsewhere(bench):
    slowly = ("-p", "speeds:=[0.05]", "-p", "length:=0.06")
    table = ShortTable(bench, *FEW, *slowly, "-p", "budget:=2", "-p", "least:=2")
    success, told = explored(table)
    assert success, told
    first, second = told["actions"]
    assert first["stopped"] == "the arm does not follow its targets"
    assert "stopped" not in second and first["speed"] == second["speed"]
    assert "missed" in first and "missed" not in second and "late" not in first
    assert np.hypot(*np.subtract(first["point"], second["point"])) > 0.02
    assert table.pose[0] != 0.46  # it was pushed


class GrippingTable(Table):
    """A tip with jaws that hold the box while they are closed around it."""

    def __init__(self, bench, *arguments):
        super().__init__(bench, explorer.ExplorerNode, *arguments)
        self.jaws = bench.follow(Float64, GRIPPER_TARGET)
        self.opened = False

    def tell(self):
        self.time += STEP
        width = self.jaws[-1].data if self.jaws else 0.0
        self.opened = width > 0.0 or (self.opened and self.tip[2] < 0.05)
        if self.targets:
            pose = cv.pose_to_core(self.targets[-1], PUSHER_TARGET, "world")
            wanted = np.array([*pose[:3, 3], np.arctan2(pose[1, 0], pose[0, 0])])
            if self.opened and width == 0.0:
                self.pose[:2] += wanted[:2] - self.tip[:2]
            self.tip = wanted
        place = tip_pose(np.array([*self.pose[:2], 0.0, self.pose[2]]))
        told = cv.uncertain_pose_to_message(place, 1e-6 * np.eye(6), self.time, "world")
        self.bench.send(OBJECT_POSE, told)
        self.bench.send(PUSHER_POSE, cv.pose_to_message(tip_pose(self.tip), self.time, "world"))
        self.bench.work(0.006)


def test_near_the_border_the_explorer_grips_pulls_inwards_and_lets_go(bench):
    chosen = ("manners:=[push,pull]", "places:=3", "speeds:=[0.2]", "way.opening:=0.095")
    table = GrippingTable(bench, *(word for p in chosen for word in ("-p", p)))
    table.pose = np.array([0.46, 0.36, 0.1])
    told = bench.follow(DiagnosticStatus, EXPLORE_PROGRESS, profile=LATCHED)
    table.outline()
    for _ in range(5):
        table.tell()
    service = next(s for s in table.node.services if s.srv_name == EXPLORE)
    service.callback(Trigger.Request(), Trigger.Response()).send(None)
    table.until(lambda: told and status_values(told[-1])["state"] == "waiting")
    values = status_values(told[-1])
    assert values["kind"] == "pull"
    assert float(values["expected_gain"]) > 0.0
    assert [message.data for message in table.jaws] == [0.095, 0.0, 0.095, 0.0]
    assert table.pose[1] == pytest.approx(0.36 - 0.06, abs=0.012)
    assert table.tip[2] > 0.19  # above it, closed
