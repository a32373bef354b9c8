"""Robots of config/ take an object and estimate it live, all by the same nodes, over DDS."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.cli.supervisor import verb_command

BAR = str(Path(__file__).parent / "objects" / "bar.yaml")
CASES = (
    ("allegro_iiwa", "box_2"),
    ("allegro_iiwa_left", "box_2"),
    ("panda_gripper", "rubiks_cube"),
    ("panda_gripper", BAR),
)
"""Configuration and object of each row."""


def main() -> int:
    """Run the demo of each robot over DDS and print how far its estimates are from the truth.

    Returns:
        0 if all masses, live and from the recording, are within 5 % and all centres within 5 mm.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="runs of each (3)")
    parser.add_argument("--first", type=int, default=0, help="first seed (0)")
    parser.add_argument("--duration", type=float, default=30.0, help="of the motion, s (30)")
    parser.add_argument("--robots", nargs="*", help="configurations; all if left out")
    options = parser.parse_args()
    print("robot              object       seed  live: mass %  com mm  recording: mass %  com mm")
    good = True
    for robot, name in CASES:
        if options.robots and robot not in options.robots:
            continue
        for seed in range(options.first, options.first + options.seeds):
            errors = run_demo(robot, name, seed, options.duration)
            good &= errors is not None and bool(np.all(np.abs(errors) < 5.0))
            told = " no estimate"
            if errors is not None:
                told = "".join(f"{e:{w}.2f}" for e, w in zip(errors, (12, 10, 17, 10), strict=True))
            print(f"{robot:18s} {Path(name).stem:12s} {seed:4d}{told}", flush=True)
    return 0 if good else 1


def run_demo(robot: str, name: str, seed: int, duration: float) -> np.ndarray | None:
    """Return errors (4,) of mass (%) and centre (mm), live and offline; None without estimate."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["demo", "--config", f"config/{robot}.yaml", "--object", name, "--json"]
        words += ["--seed", str(seed), "--duration", f"{duration:g}", "--out", f"{folder}/demo"]
        done = subprocess.run(verb_command(*words), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        print(done.stderr.strip().splitlines()[-1], file=sys.stderr)
        return None
    document: dict[str, Any] = json.loads(done.stdout)
    truth, live = document["truth"], document["live"]["value"]
    if live is None:
        return None
    mass = 100.0 * (live[0] / truth["mass"] - 1.0)
    centre = 1e3 * np.linalg.norm(np.array(live[1:4]) - truth["com"])
    return np.array([mass, centre, document["error"]["mass_percent"], document["error"]["com_mm"]])
