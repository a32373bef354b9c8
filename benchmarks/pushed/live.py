"""Pushes by command over DDS: what the status of property_estimator tells, against the truth."""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, PoseWithCovarianceStamped
from rclpy.node import Node

from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command, verb_command
from tactile_dynamics_ros.cli.topics import call_trigger, short_lived_node, spin_until
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.names import PROPERTY_STATUS, REVEAL, link_topic
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

FIRST, TABLES = 121, {"even": 0.0, "uneven": 0.1}
"""First object of one part that no training has seen; variation of friction over each table."""
SPEEDS = (0.03, 0.15, 0.08)
"""Of the pushes of each object, m/s: slow, fast and stopped hard, between."""
PATIENCE = 120.0
"""Real time for one answer, s."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--live-objects", type=int, default=6, help="of one part, on each table")
    parser.add_argument("--live-tables", nargs="+", choices=sorted(TABLES), default=[*TABLES])
    parser.add_argument("--live-first", type=int, default=FIRST, help="number of the first object")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Rows of each table."""
    count = 1 if options.quick else options.live_objects
    numbers = range(options.live_first, options.live_first + count)
    chosen = ["even"] if options.quick else options.live_tables
    return {name: [push_object(number, TABLES[name]) for number in numbers] for name in chosen}


class Heard:
    """What a node of the benchmark hears.

    Args:
        node: that subscribes.
    """

    def __init__(self, node: Node) -> None:
        self.outline: Array | None = None
        self.pose: Array | None = None
        self.statuses: list[DiagnosticArray] = []
        pose, outline = (link_topic("link_1", kind) for kind in ("pose", "footprint"))
        node.create_subscription(PoseWithCovarianceStamped, pose, self._on_pose, STREAM)
        node.create_subscription(PolygonStamped, outline, self._on_outline, LATCHED)
        node.create_subscription(DiagnosticArray, PROPERTY_STATUS, self.statuses.append, LATCHED)

    @property
    def status(self) -> dict[str, dict[str, str]]:
        """Newest status: values by the names of its parts."""
        return {s.name: status_values(s) for s in self.statuses[-1].status} if self.statuses else {}

    @property
    def fits(self) -> int:
        """Fits that failed or not."""
        told = self.status.get("solver", {})
        return int(told.get("fits", 0)) + (1000 if told.get("refused") else 0)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        yaw = 2.0 * np.arctan2(turn.z, turn.w)
        self.pose = np.array([place.x, place.y, yaw])

    def _on_outline(self, message: PolygonStamped) -> None:
        self.outline = np.array([[p.x, p.y] for p in message.polygon.points])

    def way(self, k: int, travel: float) -> tuple[Array, Array]:
        """Start and end (2,) of the k-th push: there and back, a little off the middle."""
        assert self.pose is not None and self.outline is not None
        x, y, yaw = self.pose
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        corners = self.outline @ turn.T + [x, y]
        middle, forth = corners.mean(axis=0), 1.0 if k % 2 == 0 else -1.0
        side = middle[1] + 0.15 * np.ptp(corners[:, 1]) * (1.0 if k < 2 else -1.0)
        edge = corners[:, 0].min() if forth > 0.0 else corners[:, 0].max()
        start = np.array([edge - 0.02 * forth, side])
        return start, start + [(travel + 0.02) * forth, 0.0]


def push_object(number: int, spread: float, seed: int = 5) -> dict[str, Any]:
    """Push one object three times and compare what is told after each."""
    with (
        private_domain(),
        tempfile.TemporaryDirectory() as scratch,
        Supervisor(Path(scratch) / "logs") as running,
        short_lived_node() as node,
    ):
        simulated = {
            "scene": "table", "object_number": number, "seed": seed, "place_spread": 0.0,
            "vision_rate_hz": 100.0, "friction_spread": spread,
        }  # fmt: skip
        running.start("robot_sim", node_command("robot_sim", None, simulated))
        running.start("property_estimator", node_command("property_estimator", None, {}))
        heard = Heard(node)
        ready = spin_until(node, lambda: bool(heard.statuses) and heard.pose is not None, PATIENCE)
        if not ready:
            return {"number": number, "refused": "no status within the time given"}
        steps = [_push(node, heard, k, speed) for k, speed in enumerate(SPEEDS)]
        truth = json.loads(call_trigger(node, REVEAL, PATIENCE)[1])
    return {"number": number, "steps": [_compared(step, truth) for step in steps]}


def _push(node: Node, heard: Heard, k: int, speed: float) -> dict[str, Any]:
    """Push, wait for the fit, and return the status before it and after it."""
    start, end = heard.way(k, 0.06)
    before, fits = heard.status, heard.fits
    words = ["push", "--from", *map(str, start), "--to", *map(str, end), "--speed", str(speed)]
    verb = subprocess.Popen([*verb_command(*words), "--json"], stdout=subprocess.PIPE, text=True)
    spin_until(node, lambda: verb.poll() is not None, PATIENCE)
    began = time.monotonic()
    during = next(
        (
            {s.name: status_values(s) for s in message.status}
            for message in reversed(heard.statuses)
            if status_values(message.status[-1]).get("source") == "filter"
        ),
        before,
    )
    spin_until(node, lambda: heard.fits != fits, PATIENCE)
    return {"filter": during, "after": heard.status, "fit_s": time.monotonic() - began}


def _compared(step: dict[str, Any], truth: dict[str, Any]) -> dict[str, Any]:
    part = truth["objects"][0]["parts"][0]
    known = {"mass": part["mass"], "friction_force_n": 9.81 * part["mass"] * part["friction"]}
    row: dict[str, Any] = {"fit_s": step["fit_s"]}
    row["p99_ms"] = float(step["after"].get("solver", {}).get("update_ms_p99", "nan"))
    row["source"] = step["after"].get("solver", {}).get("source")
    row["refused"] = step["after"].get("solver", {}).get("refused")
    for name in ("filter", "after"):
        told = step[name].get("link_1", {})
        row[name] = {
            quantity: (float(told[quantity]) / value - 1.0, float(told[f"{quantity}_std"]) / value)
            for quantity, value in known.items()
            if quantity in told
        }
        row[name]["undetermined"] = told.get("undetermined", "")
    return row


def table(found: dict[str, Any]) -> str:
    """A line for each table and number of pushes."""
    head = (
        "| table | pushes | n | force % median, worst | within 3 % | within 2 std "
        "| filter: force %, within 2 std | mass % (where told) | update p99 ms "
        "| answer after the push s |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    for name, rows in found.items():
        for k in range(len(SPEEDS)):
            steps = [row["steps"][k] for row in rows if "steps" in row]
            lines.append(_line(f"{name} | {k + 1}", steps))
    return "\n".join(lines)


def _line(name: str, steps: list[dict[str, Any]]) -> str:
    told = [step["after"]["friction_force_n"] for step in steps]
    live = [step["filter"]["friction_force_n"] for step in steps if step["filter"]]
    off = 100.0 * np.abs([value for value, _ in told])
    live_off = 100.0 * np.abs([value for value, _ in live])
    mass = [
        100.0 * abs(step["after"]["mass"][0])
        for step in steps
        if "mass" not in step["after"]["undetermined"].split(",")
    ]
    cells = [
        name,
        len(steps),
        f"{np.median(off):.2f}, {off.max():.2f}",
        f"{np.sum(off < 3.0)}",
        f"{sum(abs(value) < 2.0 * std for value, std in told)}",
        f"{np.median(live_off):.1f}, {sum(abs(value) < 2.0 * std for value, std in live)}",
        f"{np.median(mass):.1f} ({len(mass)})" if mass else "-",
        f"{max(step['p99_ms'] for step in steps):.1f}",
        f"{np.median([step['fit_s'] for step in steps]):.1f}",
    ]
    return "| " + " | ".join(str(cell) for cell in cells) + " |"
