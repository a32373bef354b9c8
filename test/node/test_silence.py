"""A node says which input misses, is of another type, has rivals, is refused."""

import time
from dataclasses import replace

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import String

from benchmarks.replay.motion import record_motion
from benchmarks.replay.tape import message_kind, messages_of
from tactile_dynamics_ros.nodes.inertial_estimator import InertialEstimatorNode
from tactile_dynamics_ros.nodes.model_check import ModelCheckNode
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

STATUS, DIAGNOSTICS = "/inertial_estimator/status", "/diagnostics"
OK = DiagnosticStatus.OK


def without_place(message):
    """Return a pose of the object without numbers; other messages as they are."""
    return message if message.finger else replace(message, values=np.nan * message.values)


class Stage:
    """Two nodes, a robot that publishes a recording in real time, and a rival."""

    def __init__(self, bench):
        self.bench = bench
        self.estimator = bench.start(InertialEstimatorNode)
        self.check = bench.start(ModelCheckNode)
        bench.follow(DiagnosticArray, STATUS, profile=LATCHED)
        bench.follow(DiagnosticArray, DIAGNOSTICS)
        self.robot, self.rival = (rclpy.create_node(name) for name in ("robot", "rival"))
        self.publishers, self.at = {}, 0.0

    def play(self, until, left_out="-", doubled="-", change=lambda m: m):
        """Publish the recording until something is so; a doubled topic comes from the rival too."""
        deadline = time.monotonic() + 20.0
        while not until():
            assert time.monotonic() < deadline, self.words()
            begun, start, self.at = time.monotonic(), self.at, self.at + 0.2
            for message in messages_of(record_motion(start, self.at, pace=2.0)):
                while time.monotonic() < begun + message.due - start:
                    self.bench.work(0.002)
                if message.topic.startswith(left_out):
                    continue
                raw = change(message).encoded(1_700_000_000 * 10**9)
                for node in [self.robot] + [self.rival] * (message.topic == doubled):
                    self.publisher(node, message.topic).publish(raw)

    def publisher(self, node, topic):
        key = node, topic
        if key not in self.publishers:
            self.publishers[key] = node.create_publisher(message_kind(topic), topic, STREAM)
        return self.publishers[key]

    def words(self):
        """Return level and text of the estimator's status and of both nodes on /diagnostics."""
        newest = {s.name: s for m in self.bench.seen[STATUS][-1:] for s in m.status}
        newest |= {s.name: s for m in self.bench.seen[DIAGNOSTICS] for s in m.status}
        names = ("parameters", "state", "inertial_estimator", "model_check")
        found = [newest[name] for name in names if name in newest]
        return [(one.level, one.message) for one in found]

    def warns(self, text):
        """Whether both nodes warn on /diagnostics, and the estimator in its status, of a text."""
        words = self.words()
        return len(words) == 4 and all(level != OK and text in said for level, said in words)

    def is_well(self):
        """Whether the estimator says that the object is held and nothing misses."""
        return (OK, "held") in self.words()


@pytest.fixture
def stage(bench):
    made = Stage(bench)
    yield made
    for node in (made.robot, made.rival):
        node.destroy_node()


def test_a_finger_missing_from_the_start_and_one_of_another_type_are_named(stage):
    missing = "contact/ring/force: never heard, published by nobody"
    stage.play(lambda: stage.warns(missing), left_out="/contact/ring")
    context = rclpy.Context()
    rclpy.init(context=context)
    other = rclpy.create_node("other", context=context)
    other.create_publisher(String, "/contact/ring/force", 10)
    found = "expected geometry_msgs/msg/WrenchStamped, found std_msgs/msg/String from /other"
    stage.play(lambda: stage.warns(f"contact/ring/force: {found}"), left_out="/contact/ring")
    other.destroy_node()
    rclpy.shutdown(context=context)


@pytest.mark.parametrize("topic", ["/contact/ring/force", "/contact/ring/pose"])
def test_rivals_are_named_and_all_is_well_when_one_goes(stage, topic):
    stage.play(stage.is_well)
    rivals = f"{topic.lstrip('/')}: two publishers at once (/rival and /robot)"
    stage.play(lambda: stage.warns(rivals), doubled=topic)
    stage.play(stage.is_well)


def test_refused_poses_are_named_and_silence_is_repeated_never_an_old_ok(stage):
    stage.play(stage.is_well)
    refused = "object/pose: all that comes is refused: "
    stage.play(lambda: stage.warns(refused), change=without_place)
    stage.bench.until(lambda: stage.warns("object/pose: silent since"))
    count = len(stage.bench.seen[STATUS])
    stage.bench.until(lambda: len(stage.bench.seen[STATUS]) >= count + 3)
    assert stage.warns("object/pose: silent since")
