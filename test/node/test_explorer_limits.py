"""The explorer where pushes are stopped: by force, by an arm that cannot follow, by the border."""

import json

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from test_push_nodes import STEP, Table

from tactile_dynamics_ros.nodes import explorer
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.names import (
    EXPLORE,
    EXPLORE_PROGRESS,
    GRIPPER_TARGET,
    OBJECT_POSE,
    PUSHER_POSE,
    PUSHER_TARGET,
    contact_topic,
)
from tactile_dynamics_ros.ros.shell import LATCHED
from tactile_dynamics_ros.ros.table_scene import tip_pose


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


def test_nothing_is_pushed_where_the_goal_needs_nothing_more(bench):
    goal = [f for p in ("goal:=[0.47,0.09,0.0]", "goal_error:=0.05") for f in ("-p", p)]
    table = Table(bench, explorer.ExplorerNode, *FEW, *goal)
    success, told = explored(table)
    assert success, told
    assert told["actions"] == []
    assert told["stopped_because"].startswith("the goal needs no more")


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
