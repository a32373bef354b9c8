"""Pushing to goals on the simulated table: search with estimate, with prior, and by rules."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np

from benchmarks.explore.searches import Averaged, PathIntegral, PlainSearch
from benchmarks.explore.stage import Stage
from benchmarks.peers.centring import CentringPusher
from benchmarks.support.pushing_robot import PushOptions, simulate_pushes
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.planar.control.controller import PushController
from tactile_dynamics_ros.core.planar.control.plan import Bounds, PushPlanner
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.sim.objects import planar_object
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTableConfig

OBJECTS = tuple(range(121, 129))
"""Of one part, made for tests: none of them was used to tune the controller (1 to 34 were)."""
JOINTED = tuple(range(145, 157))
"""Of two parts on a joint, made for tests: 81 to 120, of the same kind, were looked at instead."""
PAPERS_GOAL = np.array([0.5, 0.1, 0.0])
"""m, m, rad: the goal of Dutta et al., section IV-B5."""
BOUNDS = Bounds(np.array([0.2, -0.45]), np.array([0.85, 0.45]))

Maker = Callable[[PushedBody, Array, Bounds], PushPlanner]
WAYS: dict[str, tuple[bool, Maker]] = {
    "estimated": (True, PushPlanner),
    "prior": (False, PushPlanner),
    "averaged": (False, Averaged),
    "jointless": (False, PushPlanner),
    "centring": (True, CentringPusher),
    "cross_entropy": (True, PlainSearch),
    "mppi": (True, PathIntegral),
}
"""Whether the centre of mass is estimated (from four pushes) or taken in the middle of the outline,
and what decides on pushes; *averaged* counts with centres all about the middle. Of two parts
neither centre is known; *jointless* never looks for their joint, so that the second part is only
in the way once it turns."""
OF_TWO = ("prior", "jointless")
"""Ways that push objects of two parts too; the others know one body with one centre."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument(
        "--goals",
        type=int,
        default=3,
        help="of each object, each from another start; every other one is the paper's",
    )
    pairs = f"numbers; {JOINTED[0]} to {JOINTED[-1]} are of two parts on a joint"
    parser.add_argument("--objects", type=int, nargs="+", default=OBJECTS, help=pairs)
    parser.add_argument("--ways", nargs="+", choices=sorted(WAYS), default=list(WAYS))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """One row per object and goal of each way; rows go to standard error as they come."""
    numbers, goals = options.objects, options.goals
    if options.quick:
        numbers, goals = numbers[:2], 1
    found: dict[str, Any] = {way: [] for way in options.ways}
    known = any(WAYS[way][0] for way in options.ways)
    pairs = {number for number in numbers if len(planar_object(number).parts) > 1}
    centres = {
        number: estimated_centre(number) if known and number not in pairs else None
        for number in numbers
    }
    for k, number, way in product(range(goals), numbers, options.ways):
        if number in pairs and way not in OF_TWO:
            continue
        row = _row(number, k, way, centres[number])
        found[way].append(row)
        print(json.dumps({"way": way, **row}), file=sys.stderr, flush=True)
    return found


def estimated_centre(number: int) -> Array | None:
    """Centre of mass (2,) from four pushes of the object, m; None where they do not tell."""
    table = SimulatedTableConfig(seed=900 + number, object_number=number)
    try:
        found = estimate(simulate_pushes(table, PushOptions(count=4)).streams)
    except TactileDynamicsError:
        return None
    return np.array([found.values[name][0] for name in ("com_x", "com_y")])


def _row(number: int, k: int, way: str, centre: Array | None) -> dict[str, Any]:
    seed = 10 * number + k
    estimated, make = WAYS[way]
    stage = Stage(SimulatedTableConfig(seed=seed, object_number=number), way != "jointless")
    try:
        body = stage.body(centre if estimated else None)
        goal = PAPERS_GOAL if k % 2 == 0 else _drawn(seed)
        controller = PushController(make(body, goal, BOUNDS))
        start = stage.truth() - goal
        outcome = stage.run(controller)
        away = stage.truth() - goal
        taken = stage.body(None).words
    finally:
        stage.close()
    turn = abs((away[2] + np.pi) % (2.0 * np.pi) - np.pi)
    distance = float(np.hypot(*away[:2]))
    inside = distance <= 0.01 and turn <= np.deg2rad(8.0) and outcome.duration_s <= 120.0
    return {
        "object": number,
        "seed": seed,
        "start_m": float(np.hypot(*start[:2])),
        "error_m": distance,
        "error_deg": float(np.rad2deg(turn)),
        "success": bool(inside),
        "told_reached": outcome.reached,
        "pushes": outcome.pushes,
        "duration_s": outcome.duration_s,
        "because": outcome.why,
        "centre_known": centre is not None,
        "object_taken_for": taken,
    }


def _drawn(seed: int) -> Array:
    rng = np.random.default_rng([seed, 5])
    return np.array([0.5, 0.0, 0.0]) + rng.uniform(-1.0, 1.0, 3) * [0.12, 0.15, np.pi]


def table(found: dict[str, Any]) -> str:
    """Medians, 90 % and successes of each way."""
    lines = [
        "| way | n | median mm | 90 % mm | median deg | 90 % deg | success | pushes | s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for way, rows in found.items():
        away = 1e3 * np.array([row["error_m"] for row in rows])
        turn = np.array([row["error_deg"] for row in rows])
        good = sum(row["success"] for row in rows)
        middle = [np.median([row[name] for row in rows]) for name in ("pushes", "duration_s")]
        lines.append(
            f"| {way} | {len(rows)} | {np.median(away):.1f} | {np.quantile(away, 0.9):.1f} | "
            f"{np.median(turn):.1f} | {np.quantile(turn, 0.9):.1f} | {good} of {len(rows)} | "
            f"{middle[0]:.0f} | {middle[1]:.0f} |"
        )
    return "\n".join(lines)
