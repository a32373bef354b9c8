"""Shapes on a table live, by service call over DDS: time, looks and sizes against the truth."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from tactile_dynamics_ros.cli.bringup import write_parameters
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command
from tactile_dynamics_ros.cli.topics import call_trigger, short_lived_node, spin_until
from tactile_dynamics_ros.ros.conversions import to_seconds
from tactile_dynamics_ros.ros.names import CLOCK, REVEAL, SHAPE_START
from tactile_dynamics_ros.ros.shell import STREAM
from tactile_dynamics_ros.share import share_file

NUMBERS = (121, 133, 145)
"""The first test object of each family: homogeneous, of two parts, jointed."""
PATIENCE = 240.0
"""Real time for one object, s."""
MOST_SECONDS = 60.0
"""Simulated time that an object may take, s."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print; 1 if an object is refused or takes too long."""
    parser = argparse.ArgumentParser(prog="bench shape_live", description=__doc__)
    parser.add_argument("--objects", nargs="+", type=int, default=NUMBERS, metavar="N")
    parser.add_argument("--seed", type=int, default=0, help="of place, turn and noise")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args(arguments)
    found = []
    for number in options.objects:
        found.append(look_at_object(number, options.seed))
        if not options.json:
            print(describe(found[-1]), flush=True)
    if options.json:
        print(json.dumps(found))
    return int(any("refused" in one or one["simulated_s"] > MOST_SECONDS for one in found))


def look_at_object(number: int, seed: int) -> dict[str, Any]:
    """Start the simulated table and the node, call the service, compare with the truth."""
    with (
        private_domain(),
        tempfile.TemporaryDirectory() as scratch,
        Supervisor(Path(scratch) / "logs") as running,
        short_lived_node() as node,
    ):
        files = write_parameters(share_file("config/planar_pusher.yaml"), Path(scratch))
        chosen = {"object_number": number, "seed": seed}
        for name, file in files.items():
            given = chosen if name == "robot_sim" else {}
            running.start(name, node_command(name, file, given))
        times: list[float] = []
        node.create_subscription(
            Clock, CLOCK, lambda tick: times.append(to_seconds(tick.clock)), STREAM
        )
        offered = node.create_client(Trigger, SHAPE_START)
        spin_until(node, lambda: bool(times) and offered.service_is_ready(), PATIENCE)
        spin_until(node, lambda: times[-1] > times[0] + 2.0, PATIENCE)
        began = times[-1]
        success, message = call_trigger(node, SHAPE_START, PATIENCE)
        took = times[-1] - began
        truth = json.loads(call_trigger(node, REVEAL, PATIENCE)[1])
    if not success:
        return {"number": number, "simulated_s": took, "refused": message}
    return {"number": number, "simulated_s": took, **compared(json.loads(message), truth)}


def compared(told: dict[str, Any], truth: dict[str, Any]) -> dict[str, Any]:
    """Return looks, numbers of parts, and errors of each true part's length, width and height, m.

    Lengths and widths are along the axes of the true part, of the found part nearest to it.
    """
    errors = []
    for part in truth["objects"][0]["parts"]:
        pose, corners = np.array(part["pose"]), np.array(part["corners"])
        outlines = [
            (np.array(one["footprint"]) - pose[:2, 3]) @ pose[:2, :2] for one in told["parts"]
        ]
        away = [float(np.linalg.norm(o.mean(axis=0) - corners.mean(axis=0))) for o in outlines]
        nearest = int(np.argmin(away))
        flat = np.ptp(outlines[nearest], axis=0) - np.ptp(corners, axis=0)
        height = 2.0 * told["parts"][nearest]["semi_axes_m"][2] - part["height"]
        errors.append([*map(float, flat), height])
    return {
        "looks": told["looks"],
        "parts": len(told["parts"]),
        "true_parts": len(errors),
        "errors_m": errors,
        "words": [part["words"] for part in told["parts"]],
    }


def describe(found: dict[str, Any]) -> str:
    """Return a row for people."""
    row = f"{found['number']:4d} {found['simulated_s']:5.1f} s simulated"
    if "refused" in found:
        return f"{row}: refused: {found['refused']}"
    sizes = "; ".join(" ".join(f"{1e3 * e:+.1f}" for e in part) for part in found["errors_m"])
    parts = f"{found['parts']} of {found['true_parts']} parts"
    return f"{row}, {found['looks']} looks, {parts}, size off by {sizes} mm: {found['words']}"
