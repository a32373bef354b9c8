"""SIGKILL of any node while the hand holds an object: the others carry on, the recording stays."""

import os
import signal
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from tactile_dynamics_ros.cli.bringup import nodes_of
from tactile_dynamics_ros.cli.live import DEFAULT_CONFIG
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.share import share_file

PHASE = "/grasp_controller/phase"
OUTPUT = {
    "contact_state": "/contact/thumb/force",
    "biotac_force": "/biotac/thumb/force",
    "kinematic_tracker": "/object/pose",
    "inertial_estimator": "/inertial_estimator/status",
    "grasp_controller": "/joint_command",
    "robot_sim": "/joint_states",
}
TYPES = {
    "/contact/thumb/force": WrenchStamped,
    "/biotac/thumb/force": WrenchStamped,
    "/object/pose": PoseWithCovarianceStamped,
    "/joint_command": JointState,
    "/joint_states": JointState,
}


def kill_and_wait(system, listener, name):
    """Kill a node, see the others alive, and wait until its output has come back."""
    others = {n: m.process.pid for n, m in system.members.items() if n != name}
    os.kill(system.members[name].process.pid, signal.SIGKILL)
    system.members[name].process.wait(timeout=10)
    while listener.node.get_topic_names_and_types() and system.members[name].restarts == 0:
        system.watch()
        time.sleep(0.05)
    if name == "grasp_controller":
        listener.wait(lambda: listener.seen[PHASE][-1].data.startswith("idle"), 60.0, "idle")
        listener.start_grasp()
    listener.wait_for_new(OUTPUT[name], 120.0, count=3)
    assert {n: m.process.pid for n, m in system.members.items() if n != name} == others
    assert all(m.running for m in system.members.values())


def samples(listener):
    """Return the number of samples that the estimator has used."""
    status = listener.seen["/inertial_estimator/status"][-1].status
    found = {s.name: status_values(s) for s in status}
    return int(found["solver"]["samples"])


def estimate_grows(listener, timeout=120.0):
    """Wait until the estimator has used more samples than before.

    A tracker that starts, or that lost the touch for half a second, averages 15 poses from vision
    first: ten seconds of the hand's time, 40 of a machine's that also does other work.
    """
    listener.wait_for_new("/inertial_estimator/status", timeout)
    before = samples(listener)
    try:
        listener.wait(lambda: samples(listener) > before + 5, timeout, "more samples")
    except AssertionError as error:
        status = listener.seen["/inertial_estimator/status"][-1].status
        said = "; ".join(f"{s.name}: {s.message}" for s in status)
        raise AssertionError(f"{error}: {before} before, {samples(listener)} now; {said}") from None


@pytest.mark.timeout(900)
def test_any_node_may_be_killed(over_udp, system, listener, tmp_path):
    recording = tmp_path / "recording"
    system.start_verb("recorder", "record", str(recording))
    extra = {
        "grasp_controller": {"excite_forever": True},
        "biotac_force": {"tare_file": tmp_path / "tare.npy"},
    }
    for name in nodes_of(share_file(DEFAULT_CONFIG)):
        system.start_node(name, **extra.get(name, {}))
    for topic, kind in TYPES.items():
        listener.follow(kind, topic)
    listener.follow(DiagnosticArray, "/inertial_estimator/status", latched=True)
    listener.follow(String, PHASE, latched=True)
    phases = listener.seen[PHASE]
    listener.start_grasp()
    listener.wait(lambda: phases and phases[-1].data == "excite", 150.0, "object in the hand")
    estimate_grows(listener)
    for name in [n for n in OUTPUT if n != "robot_sim"]:
        kill_and_wait(system, listener, name)
        estimate_grows(listener)
    listener.wait(lambda: phases[-1].data != "excite", 30.0, "the phase of the new controller")
    assert phases[-1].data == "resumed"

    kill_and_wait(system, listener, "robot_sim")
    system.stop(["recorder"])
    streams = Recording.from_bag(recording).streams
    assert len(streams.contacts) == 4
    assert len(streams.pose.time) > 300
    assert all(np.isfinite(c.force).all() for c in streams.contacts.values())


def test_recording_stays_readable_after_its_recorder_was_killed(
    over_udp, system, listener, tmp_path
):
    recording = tmp_path / "recording"
    system.start_node("robot_sim")
    recorder = system.start_verb("recorder", "record", str(recording))
    file = recording / "recording.mcap"
    listener.wait(lambda: file.exists() and file.stat().st_size > 2**20, 90.0, "a megabyte")
    os.kill(recorder.process.pid, signal.SIGKILL)
    recorder.process.wait(timeout=10)
    from tactile_dynamics_ros.recording.bag_files import read_tables

    bag = read_tables(recording, lambda topic: topic == "/wrist/wrench")
    assert len(bag.tables["/wrist/wrench"]) > 50
