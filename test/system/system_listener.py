"""A node of the test that hears what processes publish."""

import time
from collections import defaultdict

import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message

from tactile_dynamics_ros.cli.demo_monitor import GraspStart
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM
from tactile_dynamics_ros.ros.wire import decoder_of


def as_read(message):
    """Return a message as the nodes read its bytes."""
    return decoder_of(type(message))(serialize_message(message))


class Listener:
    """A node of the test that collects messages."""

    def __init__(self):
        rclpy.init(args=[])
        self.node = Node("listener", enable_rosout=False, start_parameter_services=False)
        self.seen = defaultdict(list)
        self.followed, self.subscriptions = {}, {}

    def follow(self, kind, topic, latched=False):
        """Collect messages of a topic."""
        self.followed[topic] = kind, LATCHED if latched else STREAM
        self._subscribe(topic)

    def _subscribe(self, topic):
        kind, profile = self.followed[topic]
        keep = self.seen[topic].append
        self.subscriptions[topic] = self.node.create_subscription(kind, topic, keep, profile)

    def wait(self, condition, timeout, what):
        """Spin until the condition holds; fail with `what` otherwise."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"{what}: not within {timeout} s"
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def start_grasp(self, timeout=120.0):
        """Call grasp_controller/start until it is accepted."""
        start = GraspStart(self.node, (), print)

        def accepted():
            start.advance()
            return start.accepted

        try:
            self.wait(accepted, timeout, "grasp_controller/start accepted")
        except AssertionError as error:
            raise AssertionError(f"{error}: {start.reason}") from None

    def wait_for_new(self, topic, timeout=30.0, count=1):
        """Forget what came on a topic and wait for new messages.

        Fast DDS now and then matches a publisher and brings nothing: where nothing has come for a
        third of the time, it is subscribed to anew, once.
        """
        self.seen[topic].clear()
        started, again = time.monotonic(), False

        def came():
            nonlocal again
            late = time.monotonic() - started > timeout / 3.0
            if late and not again and not self.seen[topic]:
                again = True
                self.node.destroy_subscription(self.subscriptions[topic])
                self._subscribe(topic)
            return len(self.seen[topic]) >= count

        self.wait(came, timeout, f"{count} new on {topic}")
        return self.seen[topic][-1]
