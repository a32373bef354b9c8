"""A drag that nobody was told of: seen live, named on request, added, and the error falls."""

import json
import time

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Vector3Stamped, WrenchStamped
from std_msgs.msg import Float64

from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.shell import STREAM
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms

ERROR = "/model_check/error"


class Player:
    """Publishes recorded streams in real time, in a namespace."""

    def __init__(self, listener, streams, namespace=""):
        self.listener, self.namespace = listener, namespace
        self.publishers = {}
        self.messages = sorted(self._collect(streams), key=lambda entry: entry[0])
        self.played = 0.0

    def _collect(self, streams):
        """Yield time, topic and message of everything."""
        pose = streams.pose
        for k, stamp in enumerate(pose.time):
            matrix = _matrix(pose.position[k], pose.rotation[k])
            message = cv.uncertain_pose_to_message(matrix, pose.covariance[k], stamp, "world")
            yield stamp, "/object/pose", message
        for name, contact in streams.contacts.items():
            for k, stamp in enumerate(contact.pose_time):
                matrix = _matrix(contact.position[k], contact.rotation[k])
                yield stamp, f"/contact/{name}/pose", cv.pose_to_message(matrix, stamp, "world")
            for k, stamp in enumerate(contact.time):
                wrench = np.concatenate([contact.torque[k], contact.force[k]])
                std = cv.std_to_message(contact.force_std[k], stamp, "world")
                yield stamp, f"/contact/{name}/force_std", std
                force = cv.wrench_to_message(wrench, stamp, "world")
                yield stamp, f"/contact/{name}/force", force

    def connect(self, listeners):
        """Wait until so many nodes listen to every topic."""
        kinds = {"force": WrenchStamped, "force_std": Vector3Stamped}
        for topic in {topic for _, topic, _ in self.messages}:
            kind = kinds.get(topic.rsplit("/", 1)[1])
            if kind is None:
                kind = PoseStamped if topic.startswith("/contact") else PoseWithCovarianceStamped
            name = self.namespace + topic
            self.publishers[topic] = self.listener.node.create_publisher(kind, name, STREAM)
        for topic, publisher in self.publishers.items():
            self.listener.wait(
                lambda p=publisher: p.get_subscription_count() >= listeners, 90.0, topic
            )

    def play(self, until):
        """Publish in real time what was measured up to a time."""
        started, first = time.monotonic(), self.played
        for stamp, topic, message in self.messages:
            if not self.played <= stamp < until:
                continue
            while time.monotonic() - started < stamp - first:
                rclpy.spin_once(self.listener.node, timeout_sec=0.002)
            self.publishers[topic].publish(message)
        self.played = until


def _matrix(position, rotation):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


@pytest.mark.timeout(280)
def test_missing_drag_is_named_and_the_error_falls_when_it_is_added(system, listener):
    from test_commands import run_verb

    recording = generate_at_whitened_rms(
        11, {"viscous_drag": 2.5}, scenario=ScenarioOptions(duration=30.0)
    )
    system.start_node("inertial_estimator")
    system.start_node("model_check", period=1.0)
    listener.follow(Float64, ERROR, latched=True)
    player = Player(listener, recording.streams)
    player.connect(listeners=2)
    player.play(until=18.0)
    listener.wait(lambda: listener.seen[ERROR], 60.0, "an error")
    assert listener.seen[ERROR][-1].data > 1.4

    success, answer = call_trigger(listener.node, "/model_check/diagnose", 120.0)
    assert success, answer
    document = json.loads(answer)
    assert document["effect"] == "viscous_drag" or "viscous_drag" in document["group"], document
    assert document["error"]["after"] < 0.8 * document["error"]["before"]

    change = run_verb("set", "inertial_estimator", "effects", "[viscous_drag]")
    assert change.returncode == 0, change.stderr
    player.play(until=26.0)
    listener.wait(lambda: listener.seen[ERROR][-1].data < 1.25, 60.0, "the error to fall")
