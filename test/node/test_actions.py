"""Actions: feedback while the work goes on, cancel that stops it, one goal at a time."""

import json
import math
import sys

import numpy as np
import pytest
from action_client import ABORTED, CANCELED, SUCCEEDED, client_of
from geometry_msgs.msg import PoseStamped
from rclpy._rclpy_pybind11 import GoalEvent
from rclpy.serialization import deserialize_message
from synthetic_recording import held_box
from test_friction_probe_node import HOLDING, Hand
from test_inertial_estimator import play
from test_push_nodes import Table

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.nodes.explorer import ExplorerNode
from tactile_dynamics_ros.nodes.model_check import ModelCheckNode
from tactile_dynamics_ros.nodes.push_controller import PushControllerNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.ros.actions import INTERFACES, Action, interface
from tactile_dynamics_ros.ros.interface_build import missing_tools
from tactile_dynamics_ros.ros.listening import Waiter
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.startup import introduce
from tactile_dynamics_ros.ros.table_scene import tip_pose

__all__ = ["client_of"]
STEPS = 20
"""Of the slow work; each takes a turn of the node."""


class Slow(Shell):
    """Counts to STEPS for whoever asks; waits before the last step until it may end."""

    def __init__(self):
        super().__init__("slow")
        self.count, self.works, self.stops, self.refuses = 0, False, 0, ""
        self.may_end = False
        self.action = Action(self, "Push", "~/work", self.start, self.stop_work)
        self.serve("~/start", lambda: self.start(None) or "started")

    def start(self, _):
        if self.refuses:
            raise NotIdentifiableError(self.refuses)
        if self.works:
            raise NotIdentifiableError("it already works")
        self.count, self.works = 0, True

    def stop_work(self):
        self.works, self.stops = False, self.stops + 1
        self.action.end(False, "stopped midway", {"count": self.count}, pushes=self.count)

    def process(self):
        if not self.works or (self.count == STEPS - 1 and not self.may_end):
            return
        self.count += 1
        self.action.tell("counting", self.count / STEPS, f"{self.count} of {STEPS}")
        if self.count == STEPS:
            self.works = False
            self.action.end(True, "counted", {"count": self.count}, pushes=self.count)


@pytest.fixture
def slow(bench):
    return bench.start(Slow)


def test_the_environment_has_the_actions():
    if missing := missing_tools():
        pytest.skip(f"cannot be built here; missing: {missing}")
    assert interface("action.Weigh") is not None, "./dev env builds tactile_dynamics_msgs"


def test_a_goal_gets_feedback_and_then_its_result(slow, client_of):
    client = client_of("Push", "/slow/work")
    slow.may_end = True
    status, result = client.result(client.send())
    assert (status, result.success, result.message) == (SUCCEEDED, True, "counted")
    assert json.loads(result.json) == {"count": STEPS}
    assert result.pushes == STEPS
    shares = [feedback.share_done for feedback in client.feedback]
    assert shares == sorted(shares) and 0.0 < shares[0] < shares[-1]
    assert client.feedback[0].phase == "counting"
    assert not slow.action.busy


def test_cancel_stops_the_work_at_once_and_the_result_says_so(slow, client_of):
    client = client_of("Push", "/slow/work")
    goal = client.send()
    client.until(lambda: slow.count == STEPS - 1)
    assert client.cancel(goal) == 1
    assert not slow.works and slow.stops == 1
    status, result = client.result(goal)
    assert (status, result.success, result.message) == (CANCELED, False, "canceled")
    assert json.loads(result.json) == {"count": STEPS - 1}
    slow.may_end = True
    assert client.result(client.send())[0] == SUCCEEDED  # the next one begins anew


def test_a_second_goal_is_rejected_and_so_is_the_service(slow, client_of, capfd):
    client = client_of("Push", "/slow/work")
    first = client.send()
    second = client.ask()
    client.until(second.done)
    assert not second.result().accepted
    assert "/work: works on a goal, rejects another" in capfd.readouterr().err
    with pytest.raises(NotIdentifiableError, match="a goal is being worked on"):
        slow.action.require_free()
    answer = client.trigger("/slow/start")
    assert (answer.success, answer.message) == (False, "it already works")
    slow.may_end = True
    assert client.result(first)[0] == SUCCEEDED


def test_a_goal_that_the_node_refuses_ends_with_the_reason(slow, client_of):
    client = client_of("Push", "/slow/work")
    slow.refuses = "the emergency stop is on"
    status, result = client.result(client.send())
    assert (status, result.success, result.message) == (ABORTED, False, slow.refuses)


def test_a_node_that_is_not_active_says_so_and_deactivating_it_ends_its_goal(bench, client_of):
    hand = Hand(bench)
    hand.rest(HOLDING)
    client = client_of("Probe", f"/{names.PROBE}", lambda: hand.send(HOLDING))
    goal = client.send()
    client.until(lambda: hand.node.probe.running)
    hand.node.trigger_deactivate()
    status, result = client.result(goal)
    assert (status, result.message) == (ABORTED, "the node was deactivated")
    status, result = client.result(client.send())
    assert status == ABORTED
    assert result.message.startswith("friction_probe is inactive: ros2 lifecycle set")


def test_a_goal_that_is_canceled_before_it_begins_moves_nothing(slow, client_of):
    client = client_of("Push", "/slow/work")
    begun, execute = [], slow.action._execute
    slow.action._begin = begun.append

    async def late(goal):
        goal._update_state(GoalEvent.CANCEL_GOAL)  # as a request does that comes first
        return await execute(goal)

    slow.action._server.register_execute_callback(late)
    status, result = client.result(client.send())
    assert (status, result.message) == (CANCELED, "canceled")
    assert begun == []


def test_a_request_wakes_the_node(slow, client_of):
    client = client_of("Push", "/slow/work")
    waiter = Waiter(slow, list)
    client.executor.remove_node(slow)
    client.ask()
    client.executor.spin_once(timeout_sec=0.0)
    assert waiter.wait(10.0)
    client.executor.add_node(slow)


def test_a_node_says_as_it_starts_which_goals_it_takes(slow):
    if slow.action._server is None:
        pytest.skip("tactile_dynamics_msgs is not built")
    assert "takes goals of slow/work" in introduce(slow)


def test_without_the_interfaces_a_node_has_its_service_and_says_so(bench, monkeypatch, capfd):
    for name in ("", ".action", ".msg"):
        monkeypatch.setitem(sys.modules, f"{INTERFACES}{name}", None)
    slow = bench.start(Slow)
    said = capfd.readouterr().err
    assert said.count(f"is offered as a service only: no {INTERFACES} here") == 1
    slow.may_end = True
    assert bench.trigger(slow, "/slow/start", timeout=10.0).success
    bench.until(lambda: slow.count == STEPS)
    assert not slow.action.busy


def test_a_probe_is_canceled_and_the_hand_is_commanded_no_longer(bench, client_of):
    hand = Hand(bench)
    hand.rest(HOLDING)
    client = client_of("Probe", f"/{names.PROBE}", lambda: hand.send(HOLDING))
    goal = client.send()
    client.until(lambda: hand.node.probe.running)
    client.until(lambda: client.feedback)
    assert client.feedback[-1].phase == hand.node.probe.phase.value
    assert client.cancel(goal) == 1
    assert not hand.node.probe.running
    status, result = client.result(goal)
    assert (status, result.message, list(result.regions)) == (CANCELED, "canceled", [])
    assert json.loads(result.json)["regions"] == {}


def test_a_push_to_a_pose_gives_feedback_and_is_canceled_where_it_is(bench, client_of):
    table = Table(bench, PushControllerNode)
    table.outline()
    table.tell()
    client = client_of("Push", f"/{names.PUSH}", table.tell)
    pose = cv.pose_to_message(tip_pose(np.array([0.5, 0.1, 0.0, 0.0])), 1.0, "world")
    goal = client.send(pose=message_of(pose))
    client.until(lambda: len(table.targets) > 10 and client.feedback)
    assert 0.0 <= client.feedback[-1].share_done < 1.0
    assert "mm to go" in client.feedback[-1].text
    table.ask(0.55)
    client.until(lambda: table.said("refused"))
    assert "cancel it first" in table.said("refused")[-1].message
    client.cancel(goal)
    sent = len(table.targets)
    status, result = client.result(goal)
    assert (status, result.message) == (CANCELED, "canceled")
    assert json.loads(result.json)["stopped_because"] == "canceled"
    assert result.position_error > 0.0
    client.until(lambda: len(table.told) > 0)
    for _ in range(20):
        table.tell()
    assert len(table.targets) <= sent + 1
    status, result = client.result(client.send(pose=message_of(pose)))
    assert (status, result.success) == (SUCCEEDED, True)
    assert result.position_error < 2.5e-3 and result.pushes >= 1


def message_of(pose):
    """Return a pose, which nodes publish as bytes, as a message."""
    return deserialize_message(pose, PoseStamped) if isinstance(pose, bytes) else pose


def test_exploring_is_canceled_and_tells_what_was_done(bench, client_of):
    few = ("places:=3", "speeds:=[0.2]", "length:=0.03")
    table = Table(bench, ExplorerNode, *(word for p in few for word in ("-p", p)))
    table.outline()
    for _ in range(5):
        table.tell()
    client = client_of("Explore", f"/{names.EXPLORE}", table.tell)
    goal = client.send()
    client.until(lambda: len(table.targets) > 5)
    assert {"choosing", "pushing"} <= {feedback.phase for feedback in client.feedback}
    client.cancel(goal)
    assert table.node._run is None
    status, result = client.result(goal)
    assert (status, result.message, result.actions) == (CANCELED, "canceled", 1)
    assert len(json.loads(result.json)["actions"]) == 1


@pytest.fixture
def checker(bench):
    """A model_check that has seen a box in the hand."""
    node = bench.start(ModelCheckNode, "-p", "period:=600.0")
    play(bench, held_box(seconds=6.0).streams)
    return node


def test_a_diagnosis_ends_with_a_verdict(checker, client_of):
    client = client_of("Diagnose", f"/{names.DIAGNOSE}")
    status, result = client.result(client.send())
    assert (status, result.success) == (SUCCEEDED, True), result.message
    document = json.loads(result.json)
    assert result.message == document["sentence"]
    assert (result.verdict.verdict, result.verdict.adequate) == ("adequate", True)
    assert result.verdict.error == document["error"]["before"]
    assert [effect.name for effect in result.effects] == [c["name"] for c in document["candidates"]]


def test_a_diagnosis_that_is_canceled_leaves_the_node_free_for_the_next(checker, client_of):
    client = client_of("Diagnose", f"/{names.DIAGNOSE}")
    goal = client.send()
    client.until(lambda: checker._background.busy)
    answer = client.trigger(f"/{names.DIAGNOSE}")
    assert not answer.success and "cancel it first" in answer.message
    client.until(lambda: client.feedback)
    assert math.isnan(client.feedback[-1].share_done)
    client.cancel(goal)
    status, result = client.result(goal)
    assert (status, result.message, result.json) == (CANCELED, "canceled", "")
    assert client.result(client.send())[0] == SUCCEEDED
