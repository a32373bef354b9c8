"""The policy for `ros2 security`: what each node uses, and nothing that it must not."""

import xml.etree.ElementTree as ET

import pytest

from benchmarks.policy import POLICY, accesses, policy_of
from tactile_dynamics_ros.cli.supervisor import node_command
from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.ros.actions import interface


def allowed(action):
    """Names of the enclaves that may do something, by what they may do it with."""
    found = {}
    for enclave in ET.parse(POLICY).iter("enclave"):
        for group in enclave.iter():
            if group.get(action) == "ALLOW":
                for entry in group:
                    found.setdefault(entry.text, set()).add(enclave.get("path").rpartition("/")[2])
    return found


@pytest.mark.skipif(interface("action.Push") is None, reason="tactile_dynamics_msgs is not built")
def test_the_shipped_policy_is_what_the_nodes_use():
    assert POLICY.read_text() == policy_of(accesses()), "run ./dev bench policy"


def test_only_a_person_stops_motion_calls_for_it_and_nobody_asks_for_the_truth():
    assert allowed("publish")[names.EMERGENCY_STOP] == {"operator"}
    assert allowed("publish")[names.GOAL_POSE] == {"operator"}
    for service in (names.GRASP_START, names.EXPLORE, names.PROBE, names.SHAPE_START):
        assert allowed("request")[service] == {"operator"}
    for action in (names.EXPLORE, names.PROBE, names.PUSH):
        assert allowed("call")[action] == {"operator"}
        assert allowed("execute")[action] == {action.partition("/")[0]}
    assert names.REVEAL not in allowed("request")


def test_commands_to_a_robot_come_from_the_nodes_that_move_it():
    moving = {"grasp_controller", "friction_probe"}
    assert allowed("publish")[names.JOINT_COMMAND] <= moving
    assert allowed("publish")[names.PUSHER_TARGET] == {"explorer", "push_controller"}
    assert allowed("subscribe")[names.JOINT_COMMAND] >= {"robot"}


def test_every_node_is_started_in_its_own_enclave():
    words = node_command("model_check")
    assert words[words.index("--enclave") + 1] == "/tactile_dynamics_ros/model_check"


def test_a_ros_without_security_says_so_in_one_line(tmp_path, monkeypatch, capfd):
    from tactile_dynamics_ros.nodes import model_check

    (tmp_path / "enclaves").mkdir()
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path))
    assert model_check.main() != 0
    said = capfd.readouterr().err
    assert "error: " in said and "Traceback" not in said
