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
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
)
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.nodes.joint_monitor import JointMonitorNode
from tactile_dynamics_ros.nodes.wrench_compensator import WrenchCompensatorNode
from tactile_dynamics_ros.recording.yaml_files import write_body
from tactile_dynamics_ros.ros.conversions import to_seconds
from tactile_dynamics_ros.ros.names import (
    COMPENSATED,
    COMPENSATED_VALID,
    JOINT_STATES,
    MONITOR_EXTERNAL,
    MONITOR_STATUS,
    MONITOR_VALID,
    MONITOR_WRENCH,
)
from tactile_dynamics_ros.ros.shell import LATCHED
from tactile_dynamics_ros.ros.wire import encode_joint_state, to_stamp
from tactile_dynamics_ros.synthetic.joints import JointOptions, Payload, generate

URDF = load_robot("allegro_iiwa").urdf
TOUCHED, TORQUE = 1, 8.0
EVERY_BLOCK = 200.0  # Hz: recordings are sent faster than they were measured, and each block counts


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
    given = {"model": files / "arm.json", "urdf": files / "arm.urdf", "rate_hz": EVERY_BLOCK}
    node = bench.start(
        JointMonitorNode, *(w for k, v in given.items() for w in ("-p", f"{k}:={v}"))
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
        for k in range(*np.searchsorted(streams.time, [since, until]), 5):
            stamp = to_stamp(100.0 + float(streams.time[k]))
            message = encode_joint_state(
                streams.names, stamp, streams.position[k], effort=streams.effort[k]
            )
            bench.send(JOINT_STATES, message)
            if k % 25 == 0:
                bench.work(0.005)
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


PUSH = np.array([6.0, -10.0, 8.0])


def test_a_push_on_a_load_shows_without_its_weight_and_without_a_wrist_sensor(bench, tmp_path):
    load = Payload.draw(2.0, 9402)
    bare = fit(generate(URDF, 9402, {}, JointOptions(duration=14.0, motion=1)).streams)
    streams = generate(URDF, 9402, {}, JointOptions(duration=5.0, payload=load)).streams
    arm, still = bare.samples.arm, np.zeros_like(streams.position)
    motion = arm.motion(streams.position, still, still)
    turn = motion.turns[-1] @ arm.flange_pose[:3, :3]
    force = np.einsum("nji,j->ni", turn, PUSH) * (streams.time > 3.0)[:, None]
    felt = np.einsum("nai,na->ni", arm.flange_jacobian(motion)[:, 3:], force)
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.json").write_text(json.dumps(bare.known.to_document()))
    body = InertialParameters(load.mass, load.com, load.inertia)
    write_body(KnownBody.exact(body, "load"), tmp_path / "load.yaml")
    given = {
        "joint_monitor": {
            "model": tmp_path / "arm.json",
            "urdf": tmp_path / "arm.urdf",
            "contact": "flange",
            "rate_hz": EVERY_BLOCK,
        },
        "wrench_compensator": {
            "contacts": "[flange]",
            "load": tmp_path / "load.yaml",
            "valid_topic": MONITOR_VALID,
        },
    }
    pairs = [(n, k, v) for n, values in given.items() for k, v in values.items()]
    bench.start(JointMonitorNode, *(w for n, k, v in pairs for w in ("-p", f"{n}:{k}:={v}")))
    bench.nodes.append(WrenchCompensatorNode())
    seen = bench.follow(WrenchStamped, f"/{COMPENSATED}")
    valid = bench.follow(Bool, f"/{COMPENSATED_VALID}", profile=LATCHED)
    bench.until(lambda: valid and not valid[-1].data)
    for k in range(0, len(streams.time), 2):
        message = encode_joint_state(
            streams.names,
            to_stamp(100.0 + float(streams.time[k])),
            streams.position[k],
            effort=streams.effort[k] - felt[k],
        )
        bench.send(JOINT_STATES, message)
        if k % 20 == 0:
            bench.work(0.01)
    time = np.array([to_seconds(one.stamp) for one in seen]) - 100.0
    at = np.searchsorted(streams.time, time)
    told = np.einsum("nij,nj->ni", turn[at], [one.values[:3] for one in seen])
    before, after = told[(time > 1.0) & (time < 2.9)], told[time > 3.1]
    assert any(one.data for one in valid)
    assert len(before) > 10 and len(after) > 10
    assert np.abs(np.median(before, axis=0)).max() < 0.06 * 9.81 * load.mass
    np.testing.assert_allclose(np.median(after, axis=0), PUSH, atol=2.5)
