"""A friction probe from grasp to estimate: processes of their own over real DDS."""

import json
import subprocess

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String

from tactile_dynamics_ros.cli.supervisor import verb_command


@pytest.mark.timeout(280)
def test_a_held_object_is_probed_where_it_stands(system, listener):
    listener.follow(String, "/grasp_controller/phase", latched=True)
    system.start_node("robot_sim", seed=3, vision_rate_hz=30.0, depth_rate_hz=0.0)
    system.start_node("biotac_force")
    system.start_node("contact_state")
    system.start_node("friction_probe", most_slips=4, time_limit=12.0)
    system.start_node("grasp_controller", stand=600.0)
    phases = listener.seen["/grasp_controller/phase"]
    listener.wait(lambda: phases, 120.0, "a phase")
    listener.follow(DiagnosticStatus, "/friction_probe/progress", latched=True)
    listener.wait(
        lambda: listener.node.count_publishers("/friction_probe/progress"), 60.0, "friction_probe"
    )
    early = subprocess.run(
        verb_command("probe", "--json"), capture_output=True, text=True, timeout=60
    )
    assert early.returncode == 3, early.stderr
    assert not json.loads(early.stdout)["started"]
    listener.start_grasp()
    listener.wait(lambda: any(p.data == "squeeze" for p in phases), 120.0, "squeeze")
    document = probe_until_started()
    body = document["regions"]["body"]
    assert 0.7 < body["static"] < 1.1
    assert phases[-1].data == "squeeze"


def probe_until_started():
    """Ask until the grip has been built up, then return the result."""
    for _ in range(20):
        answer = subprocess.run(
            verb_command("probe", "--json"), capture_output=True, text=True, timeout=180
        )
        document = json.loads(answer.stdout)
        if document["started"]:
            assert answer.returncode == 0, answer.stdout + answer.stderr
            return document
    raise AssertionError(f"never started: {document}")
