"""What the explorer's actions tell on the simulated table, poses at 30 Hz, beside the truth."""

from __future__ import annotations

import argparse
import json
import sys
from itertools import product
from typing import Any

import numpy as np

from benchmarks.explore.goals import BOUNDS
from benchmarks.explore.stage import RATE, planar
from benchmarks.pushed.simulated import errors
from benchmarks.support.pushing_robot import ReadingLog, perform
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.planar.actions.affordances import (
    ExploreConfig,
    Surroundings,
    fits,
    pulls,
    pushes,
)
from tactile_dynamics_ros.core.planar.actions.straight import StraightAction
from tactile_dynamics_ros.core.planar.control.performance import Seen, WayConfig, action_of
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.sim.planar.simulated_table import (
    SimulatedTable,
    SimulatedTableConfig,
    TableReadings,
)

PLANS = {
    "three pushes": ("push", "push", "push"),
    "two shakes, a stop, a push": ("shake", "stop", "shake", "push"),
}
"""Manners in their order; where no grip holds an object its shakes are left out."""
_NUMBERS = (7, 18, 121, 126)
"""Objects of one part: light, heavy, an ellipse and a box, the last two made for tests."""
_VARIATION = 0.1
"""Relative variation of friction from place to place, as on real tables."""


class _Log(ReadingLog):
    """Readings with the zeros of what touches nothing, as nodes publish them."""

    def add(self, readings: TableReadings) -> None:
        super().add(readings)
        for measured in readings.touch:
            if not measured.touching:
                entry = (measured.time, np.zeros(3), measured.pose)
                self._measured.setdefault(measured.name, []).append(entry)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--plans", nargs="+", choices=sorted(PLANS), default=list(PLANS))
    parser.add_argument("--estimated", type=int, nargs="+", default=_NUMBERS, help="objects")
    parser.add_argument("--estimate-seeds", type=int, nargs="+", default=[13, 14])


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """One row per object and seed of each plan; rows go to standard error as they come."""
    numbers, seeds = options.estimated, options.estimate_seeds
    if options.quick:
        numbers, seeds = numbers[:1], seeds[:1]
    found: dict[str, Any] = {}
    for plan, number, seed in product(options.plans, numbers, seeds):
        row = _row(PLANS[plan], number, seed)
        found.setdefault(plan, []).append(row)
        print(json.dumps({"plan": plan, **row}), file=sys.stderr, flush=True)
    return found


def _row(plan: tuple[str, ...], number: int, seed: int) -> dict[str, Any]:
    config = SimulatedTableConfig(
        friction_spread=_VARIATION,
        seed=seed,
        object_number=number,
        vision_rate_hz=RATE,
        depth_rate_hz=0.0,
    )
    table = SimulatedTable(config)
    log, rng = _Log(table.outlines), np.random.default_rng(seed)
    row: dict[str, Any] = {"object": number, "seed": seed}
    try:
        row["done"] = [manner for manner in plan if _act(table, log, manner, rng)]
        truth = table.reveal()["links"][0]
        found = estimate(log.streams(table))
    except TactileDynamicsError as error:
        return row | {"refused": str(error)}
    finally:
        table.world.close()
    assert isinstance(found, PushedEstimate)
    return row | {"undetermined": list(found.undetermined)} | errors(found, truth)


def _act(table: SimulatedTable, log: ReadingLog, manner: str, rng: np.random.Generator) -> bool:
    """Do what was drawn of a manner, without its way through the air; False where none fits."""
    outline, config = table.outlines[0], ExploreConfig(manners=(manner,))
    pose = planar(outline.pose())
    around = Surroundings(pose, room=(BOUNDS.low, BOUNDS.high))
    drawn = pushes(outline.corners, config) + pulls(outline.corners, config, around)
    possible = [one for one in drawn if one.manner == manner and fits(one, around)]
    if not possible:
        return False
    chosen = possible[rng.integers(len(possible))]
    seen = Seen(0.0, table.pusher.frame.copy(), pose, 0.0)
    radius = table.config.pusher.tip_radius
    action = action_of(chosen, seen, WayConfig(), table.config.table_height, radius, radius)
    first = next(k for k, leg in enumerate(action.legs) if leg.name == "descend")
    action = StraightAction(action.legs[first:])
    table.pusher.place(action.legs[0].start, action.legs[0].width)
    for readings in perform(table, action):
        log.add(readings)
    return True


def table(found: dict[str, Any]) -> str:
    """Medians of errors, shares of intervals that hold and the largest error of each plan."""
    lines = [
        "| actions | n | product % | mass % | CoM mm | 90 % hold | mass, mean; largest z of all "
        "| mass undetermined | refused |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for plan, rows in found.items():
        told = [row for row in rows if "z" in row]
        z = np.array([list(row["z"].values()) for row in told])
        product_, mass = (
            100.0 * np.median([abs(row["relative"][n]) for row in told])
            for n in ("friction_force_n", "mass")
        )
        lines.append(
            f"| {plan} | {len(rows)} | {product_:.1f} | {mass:.1f} "
            f"| {1e3 * np.median([row['com_m'] for row in told]):.1f} "
            f"| {np.mean(np.abs(z) < 1.645):.2f} | {z[:, 1].mean():.1f}; {np.abs(z).max():.1f} std "
            f"| {sum('mass' in row['undetermined'] for row in told)} | {len(rows) - len(told)} |"
        )
    return "\n".join(lines)
