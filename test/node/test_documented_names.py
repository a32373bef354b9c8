"""docs/ros.md has every topic and service of every node, with who offers and who uses it."""

import importlib
from collections import defaultdict
from pathlib import Path

import pytest
import rclpy
from rclpy.action import get_action_server_names_and_types_by_node
from test_node_parameters import node_class

import tactile_dynamics_ros
from tactile_dynamics_ros.cli.live import node_names
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.ros.actions import INTERFACES, interface

ROBOT = load_robot()
PUSHING = ("pusher", "pad_left", "pad_right")
"""Contacts of an arm that pushes."""

ROOT = Path(tactile_dynamics_ros.__file__).parents[1]
HAND = "/hand"
GLOBAL = {names.CLOCK, names.DIAGNOSTICS, names.EMERGENCY_STOP, names.TF}
OF_ROS = ("/rosout", "/parameter_events")


def documented(heading, columns, first=""):
    """Return the rows of a table under a heading of docs/ros.md, without the last column.

    Args:
        heading: of the section. columns: of the table.
        first: heading of its first column, where the section has several tables.
    """
    text = (ROOT / "docs" / "ros.md").read_text().split(f"## {heading}\n")[1].split("\n## ")[0]
    table = text[text.index(f"| {first}") :].split("\n\n")[0]
    lines = [line for line in table.splitlines() if line.startswith("|")][2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert all(len(row) == columns and row[-1] for row in rows), rows
    return {tuple(cell.replace("`", "") for cell in row[:-1]) for row in rows}


def type_name(kind):
    """Return the name of a message or service type, like std_msgs/Bool."""
    return f"{kind.__module__.split('.')[0]}/{kind.__name__}"


def name_of(resolved):
    """Return a name relative to the hand's namespace, global ones with their slash."""
    parts = resolved.removeprefix(f"{HAND}/").split("/")
    named = (*ROBOT.fingers, *(PUSHING if parts[0] in ("contact", "pad") else ()))
    return "/".join("<finger>" if part in named else part for part in parts)


TABLE = ("-p", "scene:=table", "-p", "vision_rate_hz:=30.0")
STARTS = [
    *((name, ()) for name in node_names()),
    ("robot_sim", TABLE),
    ("robot_sim", (*TABLE, "-p", "place_contacts:=false")),
    ("contact_state", ("-p", "pushing:=true")),
]
"""Nodes, and arguments with which one has other topics."""


@pytest.fixture(scope="module")
def interfaces():
    """Return publishers and subscribers of topics, servers and clients of services, actions."""
    topics, services = (defaultdict(lambda: (set(), set())) for _ in range(2))
    actions = set()
    for node_name, arguments in STARTS:
        rclpy.init(args=["--ros-args", "-r", f"__ns:={HAND}", *arguments])
        node = node_class(node_name)()
        used = [(topics, 0, node.resolve_topic_name(p.topic), p.msg_type) for p in node.publishers]
        used += [(topics, 1, s.topic_name, s.msg_type) for s in node.subscriptions]
        servers, clients = ((node.services, 0), (node.clients, 1))
        for found, side in (servers, clients):
            used += [
                (services, side, node.resolve_service_name(s.srv_name), s.srv_type) for s in found
            ]
        for where, side, resolved, kind in used:
            of_ros = resolved.startswith((*OF_ROS, f"{HAND}/{node_name}/get_type_description"))
            if not of_ros and not type_name(kind).startswith(("rcl_interfaces", "lifecycle_msgs")):
                where[name_of(resolved), type_name(kind)][side].add(node_name)
        own = node.get_name(), node.get_namespace()
        for name, (kind,) in get_action_server_names_and_types_by_node(node, *own):
            actions.add((name_of(name), kind.replace("/action/", "/"), node_name))
        node.destroy_node()
        rclpy.shutdown()
    return topics, services, actions


def listed(found):
    """Return rows of names, types, and those on both sides."""
    everybody = set(node_names())

    def who(nodes):
        return "all" if nodes == everybody else ", ".join(sorted(nodes)) or "-"

    return {(*key, who(first), who(second)) for key, (first, second) in found.items()}


def test_topics_are_documented(interfaces):
    expected = listed(interfaces[0])
    try:
        importlib.import_module("tf2_msgs.msg")
    except ImportError:
        expected.add(("/tf", "tf2_msgs/TFMessage", "kinematic_tracker", "-"))
    if interface("msg.Estimate") is None:
        expected |= {row for row in documented("Topics", 5) if row[1].startswith(INTERFACES)}
    assert documented("Topics", 5) == expected


def test_services_are_documented(interfaces):
    assert documented("Services", 5) == listed(interfaces[1])


@pytest.mark.skipif(interface("action.Push") is None, reason="tactile_dynamics_msgs is not built")
def test_actions_are_documented(interfaces):
    assert documented("Actions", 4, "action") == interfaces[2]


def test_the_messages_of_the_package_are_documented():
    files = (ROOT / "interfaces" / "msg").glob("*.msg")
    assert documented("Actions", 2, "message") == {(f"{INTERFACES}/{f.stem}",) for f in files}


def test_only_what_all_hands_share_is_global(interfaces):
    names_used = {name for found in interfaces[:2] for name, _ in found}
    assert {name for name in names_used if name.startswith("/")} <= GLOBAL
