"""A client of actions in the test's process."""

import time

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from tactile_dynamics_ros.ros.actions import interface

SUCCEEDED, CANCELED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED
ABORTED = GoalStatus.STATUS_ABORTED


class Client:
    """Sends goals to a node of a bench.

    Args:
        bench: whose first node has the action.
        kind: type in tactile_dynamics_msgs, such as Probe.
        name: of the action.
        step: lets the node work for a moment; the bench does by default.
    """

    def __init__(self, bench, kind, name, step=None):
        if interface(f"action.{kind}") is None:
            pytest.skip("tactile_dynamics_msgs is not built; ./dev env builds it")
        self.kind, self.feedback = interface(f"action.{kind}"), []
        self.bench, self.step = bench, step or bench.work
        self.node = rclpy.create_node("client", start_parameter_services=False)
        self.client = ActionClient(self.node, self.kind, name)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.executor.add_node(bench.nodes[0])
        self.until(self.client.server_is_ready)

    def until(self, condition, seconds=60.0):
        """Let node and client work until the condition holds."""
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, "condition not met"
            self.step()
            self.executor.spin_once(timeout_sec=0.0)

    def ask(self, **fields):
        """Send a goal; return its future handle."""
        return self.client.send_goal_async(
            self.kind.Goal(**fields),
            feedback_callback=lambda message: self.feedback.append(message.feedback),
        )

    def send(self, **fields):
        """Send a goal that is accepted; return its handle."""
        asked = self.ask(**fields)
        self.until(asked.done)
        assert asked.result().accepted
        return asked.result()

    def result(self, handle):
        """Return status and result of a goal."""
        future = handle.get_result_async()
        self.until(future.done)
        return future.result().status, future.result().result

    def cancel(self, handle):
        """Cancel a goal; return how many the node cancels."""
        future = handle.cancel_goal_async()
        self.until(future.done)
        return len(future.result().goals_canceling)

    def trigger(self, service):
        """Call a std_srvs/Trigger; return the answer."""
        client = self.node.create_client(Trigger, service)
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()

    def close(self):
        """Leave."""
        self.executor.remove_node(self.bench.nodes[0])
        self.client.destroy()
        self.node.destroy_node()


@pytest.fixture
def client_of(bench):
    """Makes clients that are closed before the nodes."""
    made = []

    def make(*arguments):
        made.append(Client(bench, *arguments))
        return made[-1]

    yield make
    for client in made:
        client.close()
