"""The model check of an object of two parts as a node: their topics, a refusal, a diagnosis."""

import json

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped

from benchmarks.pushed import linked
from tactile_dynamics_ros.nodes.model_check import ModelCheckNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.names import PROPERTY_STATUS, link_topic
from tactile_dynamics_ros.ros.pusher_streams import outline_message
from tactile_dynamics_ros.ros.shell import LATCHED

LINKS = ("link_1", "link_2")


@pytest.fixture
def node(bench):
    """A model_check of pushed objects that compares seldom."""
    return bench.start(ModelCheckNode, "-p", "model:=pushed", "-p", "period:=600.0")


def tell_pair(bench, node, streams):
    """Send outlines and then poses, forces and contact places by their stamps."""
    for name, link in zip(LINKS, streams.links, strict=True):
        topic = link_topic(name, "footprint")
        publisher = node.create_publisher(PolygonStamped, topic, LATCHED)
        publisher.publish(outline_message(link.footprint, name))
    bench.until(lambda: len(node._window._outlines) == 2)
    rows = []
    for name, link in zip(LINKS, streams.links, strict=True):
        spread = np.diag([1e-3, 1e-3, link.pose_std[2], *link.pose_std[:2], 1e-3]) ** 2
        for time, pose in zip(link.time, link.pose, strict=True):
            placed = np.eye(4)
            cos, sin = np.cos(pose[2]), np.sin(pose[2])
            placed[:2, :2], placed[:2, 3] = [[cos, -sin], [sin, cos]], pose[:2]
            message = cv.uncertain_pose_to_message(placed, spread, float(time), "world")
            rows.append((time, link_topic(name, "pose"), message))
    [contact] = streams.contacts.values()
    for time, point, normal in zip(contact.pose_time, contact.point, contact.normal, strict=True):
        placed = np.eye(4)
        across = np.cross([0.0, 0.0, 1.0], normal)
        placed[:3, :3] = np.column_stack([across, np.cross(normal, across), normal])
        placed[:3, 3] = point
        message = cv.pose_to_message(placed, float(time), "world")
        rows.append((time, "contact/pusher/pose", message))
    for time, force in zip(contact.time, contact.force, strict=True):
        wrench = np.append(np.zeros(3), force)
        message = cv.wrench_to_message(wrench, float(time), "world")
        rows.append((time, "contact/pusher/force", message))
    for k, (_, topic, message) in enumerate(sorted(rows, key=lambda row: row[0])):
        bench.send(topic, message)
        if k % 4 == 0:
            bench.work(0.001)
    last = max(float(link.time[-1]) for link in streams.links)
    bench.until(lambda: node._window.newest > last - 0.1)


def ask(bench, node):
    """The answer of /model_check/diagnose."""
    return bench.trigger(node, "/model_check/diagnose", timeout=400.0)


def test_what_cannot_be_told_is_refused_with_the_push_that_would_tell(bench, node):
    [(made, _)] = linked.recorded([703], "rigid_pair", 1, True)
    tell_pair(bench, node, made.streams)
    kept = node._window.streams()
    for link, sent in zip(kept.links, made.streams.links, strict=True):
        at = np.searchsorted(sent.time, link.time - 1e-4)
        assert len(at) > 50
        np.testing.assert_allclose(link.pose[:, :2], sent.pose[at, :2], atol=1e-6)
        turned = link.pose[:, 2] - sent.pose[at, 2]
        np.testing.assert_allclose(np.sin(0.5 * turned), 0.0, atol=1e-6)
        np.testing.assert_allclose(link.footprint, sent.footprint, atol=1e-6)
    answer = ask(bench, node)
    assert not answer.success
    assert "undecided (rigid " in answer.message
    assert "such as: push link_" in answer.message


def test_a_lean_under_two_parts_on_a_joint_is_named_and_gone_once_added(bench, node):
    [(made, _)] = linked.recorded([701], "jointed", 4, True, hidden={"support_tilt": 2.0})
    tell_pair(bench, node, made.streams)
    document = json.loads(ask(bench, node).message)
    assert document["verdict"] != "adequate"
    assert "support_tilt" in (document["effect"], *document["group"])
    message = DiagnosticArray(header=cv.header(1.0, "object"))
    message.status = [status_message("solver", {"effects": "support_tilt"})]
    bench.send(PROPERTY_STATUS, message, profile=LATCHED)
    bench.until(lambda: node.check.effects == ("support_tilt",))
    after = json.loads(ask(bench, node).message)
    assert after["verdict"] == "adequate"
    assert after["error"]["before"] < document["error"]["before"] - 0.03
