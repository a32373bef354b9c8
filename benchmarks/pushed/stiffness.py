"""Pushes without a force sensor: the scale by a robot's stated stiffness, from its tip's lag."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.support.compliant_pushes import Compliant, draw_arms, push_compliantly
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.core.planar.tip import Stiffness, contact_of_tip, force_by_stiffness
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions
from tactile_dynamics_ros.synthetic.pushed.recordings import PushOptions

CASES = {
    "300 N/m to 10 %, four pushes": (300.0, 0.1, 4),
    "1000 N/m to 10 %, four pushes": (1000.0, 0.1, 4),
    "1000 N/m to 1 %, one push": (1000.0, 0.01, 1),
}
"""Stated stiffness, its relative std, and pushes: a soft arm, a usual one, and one push alone."""
_NUMBERS = ("friction_force_n", "mass")
_IN_90 = 1.645
"""Standard deviations within which nine of ten errors lie."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--stiffness-seeds", type=int, nargs="+", default=list(range(9420, 9436)))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Errors and stated std of every case."""
    seeds = options.stiffness_seeds[: 2 if options.quick else None]
    return {name: _rows(name, *case, seeds) for name, case in CASES.items()}


def _rows(
    name: str, stated: float, std: float, count: int, seeds: Sequence[int]
) -> list[dict[str, Any]]:
    actions = ActionOptions(count=count, gap=0.03, speed=(0.05, 0.25))
    made = push_compliantly(seeds, PushOptions(actions=actions), draw_arms(seeds, stated, std))
    rows = []
    for seed, one in zip(seeds, made, strict=True):
        rows.append({"seed": seed, **_row(one, Stiffness(np.full(2, stated), std))})
        print(f"{name}: {rows[-1]}", file=sys.stderr, flush=True)
    return rows


def _row(made: Compliant, stiffness: Stiffness) -> dict[str, Any]:
    contact = contact_of_tip(made.link, made.time, made.place)
    try:
        pushed, doubt, mass_doubt = force_by_stiffness(
            made.link, contact, made.place, made.target, stiffness
        )
        contacts = {"pusher": pushed}
        streams = PushedStreams((made.link,), contacts, force_doubt=doubt, mass_doubt=mass_doubt)
        found = estimate(streams)
    except TactileDynamicsError as error:
        return {"refused": str(error)}
    assert isinstance(found, PushedEstimate)
    row: dict[str, Any] = {"undetermined": list(found.undetermined), "error": found.error}
    for name in _NUMBERS:
        value, spread = found.values[name]
        row[name] = {"value": value, "std": spread, "truth": made.truth[name]}
    return row


def table(found: dict[str, Any]) -> str:
    """Errors, std, how many 90 % intervals hold, how many are determined; NRMSE by the range."""
    head = (
        "| case | n (refused) | friction force: median error, std, in 90 %, determined "
        "| mass: the same | mass NRMSE | largest z where determined |\n|---|---|---|---|---|---|\n"
    )
    return head + "".join(_line(name, rows) for name, rows in found.items())


def _line(name: str, rows: list[dict[str, Any]]) -> str:
    told = [row for row in rows if "refused" not in row]
    parts, largest = [], 0.0
    for number in _NUMBERS:
        value, std, truth = np.array([list(row[number].values()) for row in told]).T
        z = np.abs(value - truth) / std
        known = [number not in row["undetermined"] for row in told]
        largest = max(largest, float(z[known].max(initial=0.0)))
        parts.append(
            f"{np.median(np.abs(value / truth - 1.0)):.0%}, {np.median(std / value):.0%}, "
            f"{np.sum(z < _IN_90)}/{len(z)}, {sum(known)}"
        )
    scale = float(np.sqrt(np.mean((value - truth) ** 2)) / np.ptp(truth))
    counts = f"{len(rows)} ({len(rows) - len(told)})"
    return f"| {name} | {counts} | {' | '.join(parts)} | {scale:.2f} | {largest:.1f} |\n"
