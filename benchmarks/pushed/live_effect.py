"""A table that leans, over DDS: what model_check names after eight pushes, and once it is added."""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pushed.live import PATIENCE, Heard
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command, verb_command
from tactile_dynamics_ros.cli.topics import call_trigger, short_lived_node, spin_until
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.ros.names import DIAGNOSE, REVEAL

SPEEDS = (0.05, 0.1, 0.05, 0.1, 0.15, 0.03, 0.15, 0.08)
"""Of the pushes, m/s: each way along x and y twice, slow and fast."""
_ANSWER = 300.0
"""Real time for one diagnosis, s."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--leaning", type=int, nargs="+", default=[123], help="numbers of objects")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """What is named on a table that leans by 4 degrees, of each object."""
    return {"rows": [_named(number) for number in options.leaning]}


def _named(number: int) -> dict[str, Any]:
    with (
        private_domain(),
        tempfile.TemporaryDirectory() as scratch,
        Supervisor(Path(scratch) / "logs") as running,
        short_lived_node() as node,
    ):
        simulated = {
            "scene": "table", "object_number": number, "seed": 7, "place_spread": 0.0,
            "vision_rate_hz": 100.0, "friction_spread": 0.0, "hidden_effect": "support_tilt",
            "hidden_magnitude": 2.0,
        }  # fmt: skip
        running.start("robot_sim", node_command("robot_sim", None, simulated))
        running.start("property_estimator", node_command("property_estimator", None, {}))
        check = {"model": "pushed", "period": 20.0, "diagnosis_window": 60.0}
        running.start("model_check", node_command("model_check", None, check))
        heard = Heard(node)
        spin_until(node, lambda: heard.pose is not None and heard.outline is not None, PATIENCE)
        for k, speed in enumerate(SPEEDS):
            start, end = _way(heard, k)
            words = ("--from", *map(str, start), "--to", *map(str, end), "--speed", str(speed))
            subprocess.run(verb_command("push", *words), capture_output=True, check=True)
            spin_until(node, lambda: False, 0.5)
        first = _ask(node)
        names = json.dumps([first["effect"]] if first.get("effect") else [])
        subprocess.run(verb_command("set", "property_estimator", "effects", names), check=True)
        spin_until(node, lambda: f"effect {first.get('effect')}" in heard.status, PATIENCE)
        second = _ask(node)
        truth = json.loads(call_trigger(node, REVEAL, PATIENCE)[1])["hidden_effect"]
    return {"number": number, "first": first, "with_it": second, "truth": truth["parameters"]}


def _ask(node: Any) -> dict[str, Any]:
    """Diagnose; what counts of the answer."""
    began = time.monotonic()
    done, text = call_trigger(node, DIAGNOSE, _ANSWER)
    if not done:
        return {"refused": text}
    found = json.loads(text)
    named = [c["parameters"] for c in found["candidates"] if c["name"] == found["effect"]]
    told = {key: found[key] for key in ("verdict", "effect", "group", "error")}
    return told | {"parameters": named[:1], "seconds": time.monotonic() - began}


def _way(heard: Heard, k: int) -> tuple[Array, Array]:
    """Start and end (2,) of the k-th push: there and back along x, then along y, off the middle."""
    assert heard.pose is not None and heard.outline is not None
    x, y, yaw = heard.pose
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = heard.outline @ turn.T + [x, y]
    axis, forth = (k // 2) % 2, 1.0 if k % 2 == 0 else -1.0
    start = corners.mean(axis=0)
    start[axis] = (corners[:, axis].min() if forth > 0.0 else corners[:, axis].max()) - 0.02 * forth
    start[1 - axis] += 0.1 * float(np.ptp(corners[:, 1 - axis])) * (1.0 if k < 4 else -1.0)
    end = start.copy()
    end[axis] += 0.07 * forth
    return start, end


def table(found: dict[str, Any]) -> str:
    """Verdicts as Markdown."""
    lines = ["| object | first | with it | told | true |", "|---|---|---|---|---|"]
    for row in found["rows"]:
        first, second = row["first"], row["with_it"]
        way = np.array(row["truth"]["direction"]["value"]) * row["truth"]["angle"]["value"]
        lines.append(
            f"| {row['number']} | {first.get('verdict')} {first.get('effect')} "
            f"| {second.get('verdict')} | {_tilt(first)} | {way[0]:.4f}, {way[1]:.4f} |"
        )
    return "\n".join(lines)


def _tilt(answer: dict[str, Any]) -> str:
    told = answer.get("parameters") or [{}]
    return ", ".join(f"{v['value']:.4f} ± {v['std']:.4f}" for v in told[0].values())
