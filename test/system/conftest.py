"""Running systems for tests: processes of their own over real DDS."""

import time
from collections import defaultdict

import pytest
import rclpy
from rclpy.node import Node

from tactile_dynamics_ros.cli.live import DEFAULT_CONFIG
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command, verb_command
from tactile_dynamics_ros.nodes.shell import LATCHED, STREAM
from tactile_dynamics_ros.share import share_file


class Listener:
    """A node of the test that collects messages."""

    def __init__(self):
        rclpy.init(args=[])
        self.node = Node("listener", enable_rosout=False, start_parameter_services=False)
        self.seen = defaultdict(list)

    def follow(self, kind, topic, latched=False):
        """Collect messages of a topic."""
        profile = LATCHED if latched else STREAM
        self.node.create_subscription(kind, topic, self.seen[topic].append, profile)

    def wait(self, condition, timeout, what):
        """Spin until the condition holds; fail with `what` otherwise."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"{what}: not within {timeout} s"
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def wait_for_new(self, topic, timeout=30.0, count=1):
        """Forget what came on a topic and wait for new messages."""
        self.seen[topic].clear()
        self.wait(lambda: len(self.seen[topic]) >= count, timeout, f"{count} new on {topic}")
        return self.seen[topic][-1]


@pytest.fixture
def listener():
    """A listening node."""
    yield Listener()
    rclpy.try_shutdown()


@pytest.fixture
def system(tmp_path):
    """A supervisor whose processes are stopped after the test, and ways to start nodes."""
    with Supervisor(tmp_path / "logs") as supervisor:

        def start_node(name, **parameters):
            given = {key.replace("__", "."): value for key, value in parameters.items()}
            command = node_command(name, share_file(DEFAULT_CONFIG), given)
            return supervisor.start(name, command)

        supervisor.start_node = start_node
        supervisor.start_verb = lambda name, *words: supervisor.start(name, verb_command(*words))
        yield supervisor
