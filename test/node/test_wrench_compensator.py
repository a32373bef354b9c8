"""Node: contact wrenches as they come, and whether they are to be believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Bool
from synthetic_recording import COM, INERTIA_COM, MASS, held_box
from test_inertial_estimator import play

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
)
from tactile_dynamics_ros.nodes.inertial_estimator import InertialEstimatorNode
from tactile_dynamics_ros.nodes.wrench_compensator import WrenchCompensatorNode
from tactile_dynamics_ros.recording.yaml_files import write_body
from tactile_dynamics_ros.ros.conversions import to_seconds
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

WRENCH = "/wrench_compensator/wrench"
VALID = "/wrench_compensator/valid"
PUSH = np.array([2.5, -1.5, 1.0])


@pytest.fixture
def known(tmp_path):
    """A file of the box as it is."""
    body = InertialParameters(MASS, COM, INERTIA_COM).dynamic_parameters
    return write_body(KnownBody(body, 1e-10 * np.eye(10), "box"), tmp_path / "box.yaml")


def start(bench, *arguments):
    node = bench.start(WrenchCompensatorNode, *arguments)
    bench.follow(WrenchStamped, WRENCH)
    bench.follow(Bool, VALID, profile=LATCHED)
    return node


def pushed(streams, force, since):
    """The streams while something pushes as well, which the thumb bears."""
    thumb = streams.contacts["thumb"]
    borne = thumb.force - np.where(thumb.time > since, 1.0, 0.0)[:, None] * force
    return replace(streams, contacts=streams.contacts | {"thumb": replace(thumb, force=borne)})


def wrenches(bench, streams):
    """Stamps, forces in the world, and the motion's index of each."""
    seen = bench.seen[WRENCH]
    time = np.array([to_seconds(message.stamp) for message in seen])
    force = np.array([message.values[:3] for message in seen])
    at = np.searchsorted(streams.pose.time, time - 1e-6)
    return time, np.einsum("nij,nj->ni", streams.pose.rotation[at], force)


def test_a_push_is_what_remains_of_the_load(bench, known):
    node = start(bench, "-p", f"load:={known}")
    streams = pushed(held_box(seconds=4.0).streams, PUSH, 2.0)
    play(bench, streams)
    bench.until(lambda: len(bench.seen[WRENCH]) > 330)
    time, force = wrenches(bench, streams)
    before, after = force[(time > 1.0) & (time < 2.0)], force[time > 2.05]
    assert np.sqrt(np.mean(before**2)) < 0.05 * MASS * 9.81
    np.testing.assert_allclose(after.mean(axis=0), PUSH, atol=0.15)
    assert np.diff(time).max() == pytest.approx(0.01, abs=1e-6), "no sample is left out"
    assert any(m.data for m in bench.seen[VALID])
    assert node.compensator.load_change == 0.0


def test_a_finger_is_waited_for_while_the_others_have_read(bench, known):
    node = start(bench, "-p", f"load:={known}")
    streams = held_box(seconds=2.0).streams
    play(bench, streams, stop=100)
    bench.until(lambda: len(bench.seen[WRENCH]) > 50)
    before = len(bench.seen[WRENCH])
    thumb = {"thumb": streams.contacts["thumb"]}
    play(bench, replace(streams, contacts=thumb), start=100, stop=102)
    bench.work(0.1)
    assert len(bench.seen[WRENCH]) - before <= 1
    play(bench, replace(streams, contacts=thumb), start=102, stop=110)
    bench.until(lambda: len(bench.seen[WRENCH]) > before + 4)
    assert node.compensator.load is not None


def test_more_load_is_no_push(bench, known):
    node = start(bench, "-p", f"load:={known}")
    heavier = 0.3 * MASS * np.array([0.0, 0.0, -9.81])
    play(bench, pushed(held_box(seconds=4.0, motion=0.3).streams, heavier, 2.0))
    assert node.compensator.load_change == pytest.approx(0.3 * MASS, rel=0.15)
    node._say_validity()
    assert "changed by +0.1" in node.faults._shown["valid"]


def test_quality_of_service_can_be_overridden_and_a_mismatch_is_said(bench, known):
    topic = "/contact/wrist/force"
    override = f"qos_overrides.{topic}.subscription.reliability:=reliable"
    node = start(bench, "-p", f"load:={known}", "-p", "contacts:=[wrist]", "-p", override)
    (heard,) = (one for one in node.listening if one.subscription.topic_name == topic)
    assert heard.subscription.qos_profile.reliability is ReliabilityPolicy.RELIABLE
    node.create_publisher(WrenchStamped, topic, STREAM)
    bench.until(lambda: any("offers less" in text for text in node.inputs.troubles))


def test_without_a_load_there_is_no_contact_wrench(bench):
    node = start(bench)
    play(bench, held_box(seconds=1.0).streams)
    node._say_validity()
    bench.until(lambda: bench.seen[VALID])
    assert not bench.seen[WRENCH] and not bench.seen[VALID][-1].data
    assert node.faults._shown["valid"] == "no estimate of the load yet"


def test_the_running_estimate_is_the_load_until_it_is_kept(bench):
    node = bench.start(InertialEstimatorNode, "-p", "update_rate_hz:=100.0")
    compensator = WrenchCompensatorNode()
    bench.nodes.append(compensator)
    bench.follow(WrenchStamped, WRENCH)
    streams = held_box(seconds=8.0).streams
    play(bench, streams)
    bench.until(lambda: compensator.compensator.load is not None)
    assert compensator.compensator.load.body.phi[0] == pytest.approx(MASS, rel=0.02)
    assert node.estimator is not None
    compensator._load.learning = False
    kept = compensator.compensator.load
    compensator._load._on_status(DiagnosticArray())
    assert compensator.compensator.load is kept
