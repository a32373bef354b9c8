"""Node: what the world applies on an arm shows in its joint torques, and doubts are said."""

from __future__ import annotations

import json

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from tactile_dynamics_ros.core.joints.estimate import fit
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.nodes.joint_monitor import JointMonitorNode
from tactile_dynamics_ros.ros.names import (
    JOINT_STATES,
    MONITOR_EXTERNAL,
    MONITOR_STATUS,
    MONITOR_VALID,
    MONITOR_WRENCH,
)
from tactile_dynamics_ros.ros.shell import LATCHED
from tactile_dynamics_ros.ros.wire import encode_joint_state, to_stamp
from tactile_dynamics_ros.synthetic.joints import JointOptions, generate

URDF = load_robot("allegro_iiwa").urdf
TOUCHED, TORQUE = 1, 8.0


@pytest.fixture(scope="module")
def recorded():
    """Twelve seconds of an arm."""
    return generate(URDF, 5, {}, JointOptions(duration=12.0)).streams


@pytest.fixture(scope="module")
def files(recorded, tmp_path_factory):
    """The model of the arm, and its URDF, as files."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(URDF)
    document = fit(recorded).known.to_document()
    (folder / "arm.json").write_text(json.dumps(document))
    return folder


def play(bench, streams, since, names=None):
    """Send two seconds from a time on; something presses on a joint in the second of them."""
    first = int(np.searchsorted(streams.time, since))
    for k in range(first, first + 1000):
        effort = streams.effort[k].copy()
        if streams.time[k] > since + 1.0:
            effort[TOUCHED] -= TORQUE
        stamp = to_stamp(100.0 + float(streams.time[k]))
        message = encode_joint_state(
            names or streams.names, stamp, streams.position[k], effort=effort
        )
        bench.send(JOINT_STATES, message)
        if k % 20 == 0:
            bench.work(0.05)


def start(bench, files):
    node = bench.start(
        JointMonitorNode, "-p", f"model:={files / 'arm.json'}", "-p", f"urdf:={files / 'arm.urdf'}"
    )
    bench.follow(JointState, f"/{MONITOR_EXTERNAL}")
    bench.follow(WrenchStamped, f"/{MONITOR_WRENCH}")
    bench.follow(Bool, f"/{MONITOR_VALID}", profile=LATCHED)
    bench.follow(DiagnosticArray, f"/{MONITOR_STATUS}", profile=LATCHED)
    return node


def test_a_press_on_a_joint_shows_in_its_torque_and_in_no_other(bench, recorded, files):
    start(bench, files)
    play(bench, recorded, 4.0)
    seen = bench.seen[f"/{MONITOR_EXTERNAL}"]
    bench.until(lambda: len(seen) > 20)
    time = np.array([one.stamp.sec + 1e-9 * one.stamp.nanosec for one in seen]) - 100.0
    torque = np.array([one.efforts for one in seen])
    before, after = torque[time < 4.9], torque[time > 5.1]
    assert len(before) > 5 and len(after) > 5
    np.testing.assert_allclose(after[:, TOUCHED].mean(), TORQUE, atol=1.0)
    assert np.abs(before[:, TOUCHED]).mean() < 1.0
    others = [j for j in range(7) if j != TOUCHED]
    assert np.abs(after[:, others]).mean() < 0.5


def test_an_effect_added_live_takes_its_torque_away_at_once(bench, tmp_path):
    made = generate(URDF, 9401, {"load_dependent_friction": 2.0}, JointOptions(duration=14.0))
    streams = made.streams
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.json").write_text(json.dumps(fit(streams).known.to_document()))
    node = start(bench, tmp_path)
    seen = bench.seen[f"/{MONITOR_EXTERNAL}"]

    def torques(since, until):
        first = len(seen) + 3
        for k in range(*np.searchsorted(streams.time, [since, until]), 4):
            stamp = to_stamp(100.0 + float(streams.time[k]))
            message = encode_joint_state(
                streams.names, stamp, streams.position[k], effort=streams.effort[k]
            )
            bench.send(JOINT_STATES, message)
            if k % 20 == 0:
                bench.work(0.01)
        return np.sqrt(np.mean([one.efforts**2 for one in seen[first:]], axis=0))

    before = torques(0.0, 10.0)
    [wrong] = node.set_parameters([Parameter("effects", value=["viscous_drag"])])
    assert not wrong.successful and "expected one of" in wrong.reason
    [right] = node.set_parameters([Parameter("effects", value=["load_dependent_friction"])])
    assert right.successful
    bench.until(lambda: node.monitor.known.labels == ("load_dependent_friction",))
    after = torques(10.0, 14.0)
    worst = int(np.argmax(before))
    assert after[worst] < 0.4 * before[worst]
    assert (after < 1.2 * before).all()
