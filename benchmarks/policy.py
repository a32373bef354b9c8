"""Security policy of all nodes, for `ros2 security`, as they are with the shipped robots."""

from __future__ import annotations

import argparse
import importlib
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import rclpy

import tactile_dynamics_ros
from tactile_dynamics_ros.cli.bringup import configuration_files, nodes_of
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.ros.actions import interface
from tactile_dynamics_ros.ros.recorder import TRANSITIONS
from tactile_dynamics_ros.ros.shell import Shell

CONFIG = Path(tactile_dynamics_ros.__file__).parents[1] / "config"
POLICY = CONFIG / "security_policy.xml"
SIMULATED = ".simulated.yaml"
SENSED = ("contact", "biotac", "pad")
"""First parts of topics of single contacts or sensors, which each robot names in its own way."""
BESIDE = {
    names.OBJECT_POSE: {"object/*/pose", names.TF},
    names.OBJECT_FOOTPRINT: {"object/*/footprint"},
}
"""What is used beside a topic if an object has several parts, and where tf2_msgs is installed."""
ON_ITS_OWN = ("joint_monitor", "payload_writer", "weigher", "wrench_compensator")
"""Nodes of no shipped configuration, which people start beside one."""
SECRET = names.REVEAL
"""Service that tells the truth of a simulation: of use to demonstrations alone."""


@dataclass
class Access:
    """Names that a node may use; relative ones are in its namespace."""

    publish: set[str] = field(default_factory=set)
    subscribe: set[str] = field(default_factory=set)
    reply: set[str] = field(default_factory=set)
    request: set[str] = field(default_factory=set)
    execute: set[str] = field(default_factory=set)
    call: set[str] = field(default_factory=set)

    def add(self, node: Shell) -> None:
        """Add what a running node has."""
        self.publish |= _topics(entry.topic_name for entry in node.publishers)
        self.publish.add(f"{node.get_name()}{TRANSITIONS}")
        self.subscribe |= _topics(entry.topic_name for entry in node.subscriptions)
        self.reply |= {_general(entry.srv_name) for entry in node.services}
        self.request |= {_general(entry.srv_name) for entry in node.clients}
        self.execute |= {_general(name) for name in node.actions}


def _topics(used: Iterable[str]) -> set[str]:
    """Return topics as a policy has them."""
    found = {_general(name) for name in used}
    return found.union(*(BESIDE.get(name, set()) for name in found))


def _general(name: str) -> str:
    """Return a name as a policy has it: relative unless it is global, all sensors together."""
    kept = {names.CLOCK, names.DIAGNOSTICS, names.EMERGENCY_STOP, names.TF, "/tf_static"}
    if name in kept | {"/rosout", "/parameter_events"}:
        return name
    name = name.lstrip("/")
    first = name.partition("/")[0]
    return f"{first}/*" if first in SENSED else name


def accesses() -> dict[str, Access]:
    """Start every node of every shipped robot; return what each uses, by the name of its enclave.

    Nodes offer their actions only where tactile_dynamics_msgs is installed.

    Beside the nodes there are `robot`, the driver of a real robot, which does what the simulated
    one does, and `operator`: people's tools, which may hear all, call what nodes offer, set
    parameters, say where an object is to go and stop all motion.
    """
    found: defaultdict[str, Access] = defaultdict(Access)
    for extra in sorted(CONFIG.glob(f"*{SIMULATED}")):
        config = extra.with_name(extra.name.replace(SIMULATED, ".yaml"))
        files = configuration_files(config, simulate=True)
        words = [word for file in files for word in ("--params-file", str(file))]
        for name in nodes_of(config):
            rclpy.init(args=["--ros-args", *words])
            node = node_class(name)()
            found[name].add(node)
            node.destroy_node()
            rclpy.shutdown()
    for name in ON_ITS_OWN:
        rclpy.init(args=[])
        node = node_class(name)()
        found[name].add(node)
        node.destroy_node()
        rclpy.shutdown()
    simulated, nodes = found["robot_sim"], list(found.values())
    moves = {names.EMERGENCY_STOP, names.GOAL_POSE}
    found["robot"] = Access(simulated.publish - {names.CLOCK}, set(simulated.subscribe))
    heard = {topic for node in nodes for topic in node.publish}
    offered = {service for node in nodes for service in node.reply}
    goals = {action for node in nodes for action in node.execute}
    found["operator"] = Access(moves, heard | moves, set(), offered - {SECRET}, call=goals)
    return {name: found[name] for name in sorted(found)}


def node_class(name: str) -> type[Shell]:
    """Return the class that a node's main function runs."""
    module = importlib.import_module(f"tactile_dynamics_ros.nodes.{name}")
    classes = (v for v in vars(module).values() if isinstance(v, type) and issubclass(v, Shell))
    return next(v for v in classes if v.__module__ == module.__name__)


def policy_of(found: dict[str, Access]) -> str:
    """Return the policy as XML: an enclave for each node, everything else denied."""
    root = ET.Element("policy", version="0.2.0")
    enclaves = ET.SubElement(root, "enclaves")
    for name, access in found.items():
        enclave = ET.SubElement(enclaves, "enclave", path=f"{names.ENCLAVES}/{name}")
        profiles = ET.SubElement(enclave, "profiles")
        profile = ET.SubElement(profiles, "profile", ns="/", node=name)
        common = {"/rosout", "/parameter_events"}
        _allow(profile, "topic", "publish", access.publish | common)
        _allow(profile, "topic", "subscribe", access.subscribe | {"/parameter_events", names.CLOCK})
        _allow(profile, "service", "reply", access.reply)
        _allow(profile, "service", "request", access.request)
        _allow(profile, "action", "execute", access.execute)
        _allow(profile, "action", "call", access.call)
    ET.indent(root, "  ")
    head = "<!-- Made by `./dev bench policy`: what each node uses, and nothing else. -->"
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{head}\n{ET.tostring(root, "unicode")}\n'


def _allow(profile: ET.Element, kind: str, action: str, allowed: Iterable[str]) -> None:
    """Add what is allowed, if anything is."""
    if ordered := sorted(allowed):
        group = ET.SubElement(profile, f"{kind}s", {action: "ALLOW"})
        for name in ordered:
            ET.SubElement(group, kind).text = name


def main() -> int:
    """Write the policy.

    Returns:
        0.
    """
    argparse.ArgumentParser(description=f"{__doc__} Writes {POLICY}.").parse_args()
    if interface("action.Push") is None:
        raise SystemExit("error: tactile_dynamics_msgs is not installed; ./dev env builds it")
    with private_domain():
        POLICY.write_text(policy_of(accesses()))
    print(POLICY)
    return 0
