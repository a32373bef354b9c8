"""The simulated arm pushes by command over DDS, and what was recorded is a pushed object."""

import json
import subprocess

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_msgs.msg import Bool

from tactile_dynamics_ros.cli.supervisor import node_command, verb_command
from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.recording.pushed import PushedRecording, recorded_model
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.names import REVEAL
from tactile_dynamics_ros.ros.shell import LATCHED

BLOCK = 121
"""Object of one part."""
WEIGHTLESS = {"touch.force_noise": 0.0, "friction_spread": 0.0}


@pytest.fixture
def table(system, listener):
    """A simulated table whose object's truth is known."""
    parameters = {
        "scene": "table",
        "object_number": BLOCK,
        "vision_rate_hz": 100.0,
        "place_spread": 0.0,
        **WEIGHTLESS,
    }
    system.start("robot_sim", node_command("robot_sim", None, parameters))
    listener.follow(PoseStamped, "/pusher/pose")
    listener.follow(PoseWithCovarianceStamped, "/object/pose")
    listener.wait_for_new("/object/pose", 60.0, 20)
    return system


def push(*words):
    """Start the verb; return its process."""
    command = verb_command("push", *words, "--json")
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def told(listener):
    """Newest status of property_estimator: texts by name of the status and key."""
    statuses = listener.seen["/property_estimator/status"]
    return {s.name: status_values(s) for s in statuses[-1].status} if statuses else {}


def test_a_push_by_command_moves_the_object_and_the_friction_is_told(table, listener, tmp_path):
    table.start("property_estimator", node_command("property_estimator", None, {}))
    listener.follow(DiagnosticArray, "/property_estimator/status", latched=True)
    listener.wait(lambda: told(listener), 60.0, "a status")
    record = table.start_verb("record", "record", str(tmp_path / "bag"))
    listener.wait(lambda: (tmp_path / "bag").exists(), 30.0, "a recording")
    before = listener.wait_for_new("/object/pose").pose.pose.position.x
    verb = push("--from", "0.44", "0", "--to", "0.53", "0", "--speed", "0.1")
    said, complaint = verb.communicate(timeout=120.0)
    assert verb.returncode == 0, complaint
    assert json.loads(said)["reached"]
    poses = listener.seen["/object/pose"]
    listener.wait(lambda: poses[-1].pose.pose.position.x > before + 0.01, 60.0, "the object moved")
    table.stop(["record"])
    assert not record.running
    assert recorded_model(tmp_path / "bag") == "pushed"
    streams = PushedRecording.from_bag(tmp_path / "bag").streams
    (link,), contact = streams.links, streams.contacts["pusher"]
    assert len(link.footprint) >= 4
    touched = contact.force[np.linalg.norm(contact.force, axis=1) > 0.0]
    assert len(touched) > 20
    assert np.median(contact.normal[:, 0]) > 0.9  # into the object
    assert np.median(touched[:, 0]) > 0.5
    tried = ("fits", "refused")
    listener.wait(lambda: {told(listener)["solver"][k] for k in tried} != {"0", ""}, 120.0, "a fit")
    truth = json.loads(call_trigger(listener.node, REVEAL, 30.0)[1])["objects"][0]["parts"][0]
    link = told(listener)["link_1"]
    force, std = float(link["friction_force_n"]), float(link["friction_force_n_std"])
    assert abs(force - 9.81 * truth["mass"] * truth["friction"]) < 3.0 * std
    assert std < 0.25 * force  # a filter's; one push is not always enough for a fit


def test_an_emergency_stop_ends_a_push_and_forbids_another(table, listener):
    tell = listener.node.create_publisher(Bool, "/emergency_stop", LATCHED)
    verb = push("--from", "0.4", "0.2", "--to", "0.45", "0.2", "--speed", "0.01")
    start = listener.wait_for_new("/pusher/pose").pose.position

    def moved():
        now = listener.seen["/pusher/pose"][-1].pose.position
        return abs(now.x - start.x) + abs(now.y - start.y) > 0.02

    listener.wait(moved, 60.0, "the tip moves")
    tell.publish(Bool(data=True))
    assert verb.wait(30.0) == 1
    assert "emergency stop" in verb.stderr.read()
    places = []

    def rests():
        now = listener.wait_for_new("/pusher/pose", count=20).pose.position
        places.append(np.array([now.x, now.y, now.z]))
        return len(places) > 1 and np.abs(places[-1] - places[-2]).max() < 1e-7

    listener.wait(rests, 30.0, "the arm rests")
    refused = push("--from", "0.4", "0.2", "--to", "0.45", "0.2", "--speed", "0.01")
    assert refused.wait(60.0) == 1
    listener.wait_for_new("/pusher/pose", count=20)
    assert rests()
    assert np.abs(places[-1] - places[-2]).max() < 1e-6
