"""Nodes in the test's process, driven by messages over real DDS."""

import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Image, JointState
from std_srvs.srv import Trigger


def kind_of(topic, message):
    """Return the type of a message; that of serialised ones follows from the topic."""
    if not isinstance(message, bytes):
        return type(message)
    topic = topic.lstrip("/")
    if topic == "friction_probe/estimate":
        return DiagnosticStatus
    if topic.startswith(("object/pose", "object/link_2/pose")):
        return PoseWithCovarianceStamped
    if topic.startswith(("camera", "biotac/raw")):
        return Image
    kinds = {
        "force": WrenchStamped,
        "wrench": WrenchStamped,
        "force_std": Vector3Stamped,
        "slip": Vector3Stamped,
    }
    kinds |= {"pose": PoseStamped, "joint_states": JointState, "joint_command": JointState}
    return kinds[topic.rsplit("/", 1)[-1]]


class Bench:
    """Makes nodes, publishes to them and collects what they publish."""

    def __init__(self):
        self.nodes = []
        self.publishers = {}
        self.seen = {}

    def start(self, factory, *arguments):
        """Create a node with ROS arguments."""
        if not rclpy.ok():
            rclpy.init(args=["--ros-args", *arguments] if arguments else [])
        self.nodes.append(factory())
        return self.nodes[-1]

    def trigger(self, node, service, timeout):
        """Call a service of a node and return the answer; messages go on meanwhile."""
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        future = node.create_client(Trigger, service).call_async(Trigger.Request())

        def answered():
            executor.spin_once(timeout_sec=0.0)
            return future.done()

        self.until(answered, timeout=timeout)
        return future.result()

    def follow(self, kind, topic, **options):
        """Collect the messages of a topic."""
        self.seen[topic] = []
        self.nodes[0].listen(kind, topic, self.seen[topic].append, **options)
        return self.seen[topic]

    def send(self, topic, message, **options):
        """Publish a message or its bytes; the first time, wait until somebody listens."""
        if topic not in self.publishers:
            from tactile_dynamics_ros.ros.shell import STREAM

            profile = options.get("profile", STREAM)
            publisher = self.nodes[0].create_publisher(kind_of(topic, message), topic, profile)
            self.publishers[topic] = publisher
            self.until(lambda: publisher.get_subscription_count() > 0)
        self.publishers[topic].publish(message)

    def work(self, seconds=0.005):
        """Let the nodes work for a moment."""
        deadline = time.monotonic() + seconds
        while True:
            for node in self.nodes:
                node.work()
            if time.monotonic() > deadline:
                return
            time.sleep(5e-4)

    def until(self, condition, timeout=20.0):
        """Let the nodes work until the condition holds."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, "condition not met"
            self.work()


@pytest.fixture
def bench():
    """A bench that takes everything down after the test."""
    made = Bench()
    yield made
    for node in made.nodes:
        node.destroy_node()
    rclpy.try_shutdown()
