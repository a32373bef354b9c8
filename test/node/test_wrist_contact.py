"""A wrist sensor named by its topic and a frame: tf places it, and the load is estimated."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from built_interfaces import build, require_compilers
from geometry_msgs.msg import InertiaStamped, PoseStamped, TransformStamped
from test_inertial_estimator import INERTIA

from benchmarks.support.tables import WristOptions, wrist_table
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.nodes.contact_state import ContactStateNode
from tactile_dynamics_ros.nodes.inertial_estimator import InertialEstimatorNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.shell import LATCHED

WRENCH = "/force_torque_sensor_broadcaster/wrench"
WORDS = ("-p", f"wrist.wrench:={WRENCH}", "-p", "wrist.base:=base", "-p", "contacts:=[wrist]")


@pytest.fixture(scope="module", autouse=True)
def transforms(tmp_path_factory):
    """Build tf2_msgs, which no wheel brings."""
    require_compilers()
    out = tmp_path_factory.mktemp("interfaces")
    text = "geometry_msgs/TransformStamped[] transforms\n"
    uses = ["geometry_msgs", "std_msgs", "builtin_interfaces"]
    build("tf2_msgs", {"msg/TFMessage.msg": text}, uses, out)
    sys.path.insert(0, str(out))
    yield
    sys.path.remove(str(out))


def frame(parent, child, pose, time):
    """Return a message of tf with one frame."""
    from tf2_msgs.msg import TFMessage

    found = TransformStamped(header=cv.header(time, parent), child_frame_id=child)
    place, turn = found.transform.translation, found.transform.rotation
    place.x, place.y, place.z = map(float, pose[:3, 3])
    turn.x, turn.y, turn.z, turn.w = map(float, matrix_to_quaternion(pose[:3, :3]))
    return TFMessage(transforms=[found])


def test_a_topic_and_a_frame_are_enough_for_an_estimate(bench):
    table, body = wrist_table(2, WristOptions(duration=15.0, rate_hz=100.0, bias_n=2.0))
    streams = table.streams()
    poses, wrist = streams.pose, streams.contacts["wrist"]
    bench.start(ContactStateNode, *WORDS)
    bench.nodes.append(InertialEstimatorNode())
    seen = bench.follow(InertiaStamped, INERTIA, profile=LATCHED)
    offset = np.eye(4)
    offset[:3, 3] = [0.0, 0.0, 0.04]
    bench.send("/tf_static", frame("tool0", "ft_sensor", offset, 0.0), profile=LATCHED)
    for k in range(len(poses.time)):
        time = float(poses.time[k]) + 10.0
        flange = np.eye(4)
        flange[:3, :3] = poses.rotation[k]
        flange[:3, 3] = poses.position[k] - poses.rotation[k] @ offset[:3, 3]
        bench.send("/tf", frame("base", "tool0", flange, time))
        into = poses.rotation[k].T
        measured = -np.concatenate([into @ wrist.torque[k], into @ wrist.force[k]])
        bench.send(WRENCH, cv.wrench_to_message(measured, time, "ft_sensor"))
        if k % 5 == 4:
            bench.work()
    bench.until(lambda: seen and seen[-1].header.stamp.sec >= 24)
    found = seen[-1].inertia
    assert found.m == pytest.approx(body.mass, rel=0.02)
    com = [found.com.x, found.com.y, found.com.z]
    np.testing.assert_allclose(com, body.com, atol=2e-3)


def test_a_frame_that_nobody_publishes_is_named(bench):
    node = bench.start(ContactStateNode, *WORDS, "-p", "wrist.sensor:=tol0")
    places = bench.follow(PoseStamped, "/contact/wrist/pose")
    bench.send("/tf_static", frame("base", "tool0", np.eye(4), 0.0), profile=LATCHED)
    bench.send(WRENCH, cv.wrench_to_message(np.zeros(6), 1.0, ""))
    bench.until(lambda: node.faults.counts["no_frame"] == 1)
    assert "'tol0' is not in /tf" in node.faults._last and "tool0" in node.faults._last
    assert not places
