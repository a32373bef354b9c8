"""Managed nodes: states by the services that `ros2 lifecycle` calls, and what they allow."""

import json
import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetState
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import Trigger
from test_grasp_controller import Robot
from test_push_nodes import Table

from tactile_dynamics_ros.nodes import explorer, inertial_estimator
from tactile_dynamics_ros.ros import wire
from tactile_dynamics_ros.ros.diagnostics import Statuses
from tactile_dynamics_ros.ros.names import DIAGNOSTICS, EMERGENCY_STOP, ESTIMATOR_RESET, EXPLORE
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM, Shell, spin

SOON = 1.0
"""Time within which a lifecycle service answers, s."""


class People:
    """Somebody with `ros2 lifecycle` and `ros2 service`, in a process of their own."""

    def __init__(self, name):
        self.node, self.name = rclpy.create_node("people"), name
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.clients = {}

    def ask(self, kind, service, request=None):
        """Call a service; return the future of its answer."""
        full = f"/{self.name}/{service}" if "/" not in service else service
        if full not in self.clients:
            self.clients[full] = self.node.create_client(kind, full)
            assert self.clients[full].wait_for_service(10.0)
        return self.clients[full].call_async(request or kind.Request())

    def look(self):
        self.executor.spin_once(timeout_sec=0.0)


class Managed:
    """A node that works as its process would, and people who ask it."""

    def __init__(self, bench, factory, *arguments):
        self.node = bench.start(factory, *arguments)
        self.people = People(self.node.get_name())

    def let(self, condition=lambda: False, seconds=10.0):
        """Let the node work until a condition holds; return whether it did."""
        deadline = time.monotonic() + seconds

        def over():
            self.people.look()
            return condition() or time.monotonic() > deadline

        self.node.every(0.01, lambda: None, always=True)  # so that the test is asked that often
        spin(self.node, over)
        return condition()

    def answer(self, *words):
        future = self.people.ask(*words)
        assert self.let(future.done)
        return future.result()

    def set(self, label):
        """Ask for a transition; return whether it succeeded, and how long the answer took."""
        request = ChangeState.Request()
        request.transition.label = label
        future = self.people.ask(ChangeState, "change_state", request)
        began = time.monotonic()
        assert self.let(future.done)
        return future.result().success, time.monotonic() - began

    @property
    def state(self):
        return self.answer(GetState, "get_state").current_state.label


@pytest.fixture
def managed(bench):
    made = []

    def make(factory, *arguments):
        made.append(Managed(bench, factory, *arguments))
        return made[-1]

    yield make
    for one in made:
        one.people.node.destroy_node()


class Counting(Shell):
    """A node with one of each: a stream, latched topics, a service, something that is due."""

    def __init__(self):
        super().__init__("counting")
        self.heard, self.settings, self.due, self.processed = [], [], 0, 0
        self.listen(Vector3Stamped, "sense", lambda m: self.heard.append(m.values[0]))
        self.listen(String, "setting", lambda m: self.settings.append(m.data), LATCHED)
        self.told, self.said = self.stream(Float64, "told"), self.latched(String, "said")
        self.said.publish(String(data="constructed"))
        self.serve("counting/count", lambda: str(len(self.heard)))
        self.every(0.05, self._due)

    def _due(self):
        self.due += 1
        self.told.publish(Float64(data=1.0))

    def process(self):
        self.processed += 1


def sense(value):
    return wire.encode_stamped(wire.Stamp(1, 0), "world", np.full(3, value))


def test_a_node_is_active_at_once_and_goes_through_the_states_of_ros_on_request(managed):
    one = managed(Counting)
    events = []
    one.people.node.create_subscription(
        TransitionEvent, "/counting/transition_event", events.append, 10
    )
    assert one.state == "active"
    states = one.answer(GetAvailableStates, "get_available_states").available_states
    assert {"unconfigured", "inactive", "active", "finalized"} <= {s.label for s in states}
    way = ("deactivate", "cleanup", "configure", "activate", "shutdown")
    reached = ("inactive", "unconfigured", "inactive", "active", "finalized")
    for label, state in zip(way, reached, strict=True):
        success, took = one.set(label)
        assert success and took < SOON
        assert one.state == state
    assert one.let(lambda: len(events) == 2 * len(way))
    assert not one.set("activate")[0]
    assert "start it again" in one.answer(Trigger, "/counting/count").message


def test_an_inactive_node_drops_keeps_silent_and_refuses(managed):
    one = managed(Counting)
    heard, said, people = [], [], one.people.node
    people.create_subscription(Float64, "/told", heard.append, STREAM)
    people.create_subscription(DiagnosticArray, DIAGNOSTICS, said.append, 10)
    sent = people.create_publisher(Vector3Stamped, "/sense", 10)
    setting = people.create_publisher(String, "/setting", LATCHED)
    assert one.let(lambda: heard and sent.get_subscription_count())
    sent.publish(sense(1.0))
    assert one.let(lambda: one.node.heard == [1.0])
    assert one.set("deactivate")[0]
    one.let(seconds=0.3)  # what was under way
    del heard[:], said[:]
    due, processed = one.node.due, one.node.processed
    sent.publish(sense(2.0))
    setting.publish(String(data="kept"))
    refused = one.answer(Trigger, "/counting/count")
    assert not refused.success
    assert refused.message == "counting is inactive: ros2 lifecycle set /counting activate"
    assert one.let(lambda: "inactive" in [Statuses(m.status).text("counting") for m in said])
    assert (heard, one.node.heard, one.node.settings) == ([], [1.0], [])
    assert (one.node.due, one.node.processed) == (due, processed)
    assert one.set("activate")[0]
    assert one.let(lambda: one.node.settings == ["kept"] and heard)
    sent.publish(sense(3.0))
    assert one.let(lambda: one.node.heard == [1.0, 3.0])  # what was dropped does not come later
    assert one.answer(Trigger, "/counting/count").message == "2"


def test_without_autostart_it_waits_to_be_configured_and_activated(managed):
    one = managed(Counting, "-p", "autostart:=false")
    said = []
    one.people.node.create_subscription(String, "/said", said.append, LATCHED)
    assert one.state == "unconfigured"
    assert one.answer(Trigger, "/counting/count").message == (
        "counting is unconfigured: ros2 lifecycle set /counting configure; "
        "ros2 lifecycle set /counting activate"
    )
    assert not one.set("activate")[0]
    assert one.set("configure")[0]
    assert one.state == "inactive"
    assert not said and one.node.due == 0
    assert one.set("activate")[0]
    assert one.let(lambda: [m.data for m in said] == ["constructed"])


def test_an_estimator_refuses_while_inactive_and_answers_again_when_active(managed):
    one = managed(inertial_estimator.InertialEstimatorNode)
    assert one.set("deactivate")[0]
    assert "is inactive" in one.answer(Trigger, f"/{ESTIMATOR_RESET}").message
    assert one.set("activate")[0]
    assert one.answer(Trigger, f"/{ESTIMATOR_RESET}").success


def test_an_exploration_ends_at_once_when_the_explorer_is_deactivated(bench):
    """The call still runs then, so that the executor may not wait for its end."""
    bench.start(lambda: Shell("hardware"))
    table = Table(bench, explorer.ExplorerNode)
    table.outline()
    for _ in range(5):
        table.tell()
    people, executor = People("explorer"), SingleThreadedExecutor()
    executor.add_node(table.node)
    call = people.ask(Trigger, f"/{EXPLORE}")

    def work():
        executor.spin_once(timeout_sec=0.0)
        people.look()

    def reaches(condition):
        def checked():
            work()
            return condition()

        table.until(checked)

    reaches(lambda: len(table.targets) > 5)
    request = ChangeState.Request()
    request.transition.label = "deactivate"
    changed, began = people.ask(ChangeState, "change_state", request), time.monotonic()
    reaches(changed.done)
    assert changed.result().success and time.monotonic() - began < SOON
    reaches(call.done)
    told = call.result()
    assert not told.success
    assert json.loads(told.message)["stopped_because"] == "the node was deactivated"
    for _ in range(10):
        work()
        table.tell()
    sent = len(table.targets)
    again = people.ask(Trigger, f"/{EXPLORE}")
    reaches(again.done)
    assert "explorer is inactive" in again.result().message
    assert len(table.targets) == sent
    people.node.destroy_node()


def test_a_grasp_stops_when_deactivated_and_goes_on_only_at_a_new_call(bench):
    bench.start(lambda: Shell("hardware"))
    robot = Robot(bench)
    robot.run(0.3)
    assert robot.ask().success
    robot.run(1.0)
    assert len(robot.commands) > 80
    robot.node.trigger_deactivate()
    bench.work(0.1)
    count = len(robot.commands)
    assert robot.phases[-1].data == "stopped: the node was deactivated"
    robot.run(1.0)
    assert "is inactive" in robot.ask().message
    robot.node.trigger_activate()
    robot.run(1.0)
    assert len(robot.commands) == count
    assert robot.ask().message == "the interrupted motion goes on"
    robot.run(0.5)
    assert len(robot.commands) > count


def test_an_emergency_stop_that_came_while_inactive_counts_after_activation(bench):
    bench.start(lambda: Shell("hardware"))
    robot = Robot(bench)
    robot.node.trigger_deactivate()
    robot.say_stop(True)
    robot.node.trigger_activate()
    robot.run(0.3)
    assert "emergency stop is on" in robot.ask().message


def test_a_camera_pose_that_is_published_by_an_inactive_shell_is_not_sent(bench):
    listener, node = bench.start(lambda: Shell("listener")), bench.start(lambda: Shell("speaker"))
    targets = node.create_publisher(PoseStamped, "/camera/target", 10)
    flags = node.latched(Bool, EMERGENCY_STOP)
    heard = bench.follow(PoseStamped, "/camera/target")
    seen = bench.follow(Bool, EMERGENCY_STOP, profile=LATCHED)
    bench.until(lambda: targets.get_subscription_count() and listener.active)
    node.trigger_deactivate()
    targets.publish(PoseStamped())
    for flag in (False, True):
        flags.publish(Bool(data=flag))
    bench.work(0.2)
    assert not heard and not seen
    node.trigger_activate()
    bench.until(lambda: seen)
    bench.work(0.2)
    assert [m.data for m in seen] == [True] and not heard  # of a latched topic the newest
