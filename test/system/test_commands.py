"""Verbs that talk to running nodes."""

import json
import signal
import subprocess

import pytest

from tactile_dynamics_ros.cli.supervisor import verb_command


def run_verb(*words, timeout=60):
    """Run a verb to its end."""
    return subprocess.run(verb_command(*words), capture_output=True, text=True, timeout=timeout)


def test_echo_call_set_and_record_against_running_nodes(system, tmp_path):
    system.start_node("robot_sim")
    system.start_node("inertial_estimator")
    echo = run_verb("echo", "/joint_states", "--count", "2", "--json", "--timeout", "40")
    assert echo.returncode == 0, echo.stderr
    first, second = (json.loads(line) for line in echo.stdout.splitlines())
    assert len(first["position"]) == 23
    assert second["header"]["stamp"] != first["header"]["stamp"]

    reveal = run_verb("call", "/robot_sim/reveal", "--json")
    assert json.loads(reveal.stdout)["message"]["object"] == "box_0"
    missing = run_verb("call", "/robot_sim/nothing", "--timeout", "1")
    assert (missing.returncode, missing.stderr.count("\n")) == (2, 1)

    change = run_verb("set", "inertial_estimator", "effects", "[viscous_drag]")
    assert change.returncode == 0, change.stderr
    assert "now: waiting for object/pose" in change.stdout
    refused = run_verb("set", "inertial_estimator", "effects", "[magic]")
    assert refused.returncode == 2
    assert "magic" in refused.stderr

    out = tmp_path / "recording"
    record = run_verb("record", str(out), "--duration", "6", "--json")
    counts = json.loads(record.stdout)["topics"]
    assert counts["/joint_states"] > 20
    assert counts["/biotac/raw"] > 20
    again = run_verb("record", str(out), "--duration", "1")
    assert again.returncode == 2


def test_a_call_waits_for_its_answer_while_the_node_lives(listener):
    from rclpy.task import Future
    from std_srvs.srv import Trigger

    answer, asked = Future(), []

    async def serve(_, response):
        asked.append(1)
        await answer
        return response

    service = listener.node.create_service(Trigger, "/silent", serve)
    words = verb_command("call", "/silent")
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as call:
        listener.wait(lambda: asked, 30.0, "/silent")
        assert call.poll() is None
        listener.node.destroy_service(service)
        listener.wait(lambda: call.poll() is not None, 30.0, "end of the call")
        assert "its node ended before it answered" in call.stderr.read()
    assert call.returncode == 1


def test_echo_of_a_silent_topic_says_what_exists():
    done = run_verb("echo", "/nowhere", "--timeout", "1")
    assert done.returncode == 2
    assert "/nowhere" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_nodes_stop_cleanly_on_signals(system, listener, number):
    from sensor_msgs.msg import JointState

    member = system.start_node("robot_sim")
    listener.follow(JointState, "/joint_states")
    listener.wait(lambda: listener.seen["/joint_states"], 60.0, "/joint_states")
    member.process.send_signal(number)
    assert member.process.wait(timeout=15) == 0
    assert "Traceback" not in member.last_words(50)


def test_up_starts_what_the_file_lists_and_stops_all(tmp_path, listener):
    from sensor_msgs.msg import JointState

    words = [
        "up",
        "--simulate",
        "--without",
        "grasp_controller",
        "--logs",
        str(tmp_path / "logs"),
        "--json",
    ]
    process = subprocess.Popen(verb_command(*words), stdout=subprocess.PIPE, text=True)
    try:
        nodes = json.loads(process.stdout.readline())["nodes"]
        assert "grasp_controller" not in nodes
        listener.follow(JointState, "/joint_states")
        listener.wait(lambda: listener.seen["/joint_states"], 60.0, "/joint_states")
        alive = set()

        def all_there():
            alive.update(listener.node.get_node_names())
            return set(nodes) <= alive

        listener.wait(all_there, 60.0, "all nodes")
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=40) == 0
    assert len(list((tmp_path / "logs").glob("*.log"))) == len(nodes)
