"""Simulated pushes of one part: product, mass and centre against the truth, beside simple peers."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.pushed.bound import bound
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions

CONDITIONS = {
    "six": pushed.PushOptions(actions=ActionOptions(count=6, speed=(0.03, 0.2))),
    "two": pushed.PushOptions(actions=ActionOptions(count=2, speed=(0.03, 0.2))),
    "uneven": pushed.PushOptions(
        actions=ActionOptions(count=6, speed=(0.03, 0.2)),
        variation=0.1,
        uneven=0.1,
        sensors=SensorOptions(systematic=1.0),
    ),
    "slow": pushed.PushOptions(actions=ActionOptions(count=6, speed=(0.02, 0.025))),
    "slow_15_hz": pushed.PushOptions(
        actions=ActionOptions(count=4, speed=(0.02, 0.025), pauses=0, hard_stop=False),
        sensors=SensorOptions(force_rate_hz=15.0, rate_hz=15.0),
    ),
}
"""Six and two pushes at 30 to 200 mm/s; six on a table that varies by 10 %, with an uneven face and
lasting errors of height and contact point; six at 20 to 25 mm/s; four of those at 15 Hz without a
stop. Force 0.03 N, pose 0.5 mm and 0.2 deg, contact 0.3 mm, 100 Hz where nothing else is said."""
_WINDOW = 0.1
"""s over which the peer differentiates poses: shorter is noise, longer blurs starts and stops."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--first-seed", type=int, default=200, help="of simulated pushes")
    parser.add_argument("--objects", type=int, default=20, help="seeds of each condition")
    parser.add_argument("--conditions", nargs="+", choices=sorted(CONDITIONS), default=None)
    parser.add_argument(
        "--bound", action="store_true", help="Cramer-Rao bound on even tables beside the errors"
    )


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Errors over their std, and those of peers, of each condition."""
    count = 2 if options.quick else options.objects
    seeds = range(options.first_seed, options.first_seed + count)
    chosen = options.conditions or list(CONDITIONS)
    return {name: _rows(seeds, CONDITIONS[name], options.bound) for name in chosen}


def _rows(
    seeds: Sequence[int], condition: pushed.PushOptions, bounded: bool
) -> list[dict[str, Any]]:
    rows = []
    for hidden in pushed.generate(seeds, {}, condition):
        row = _row(hidden)
        if bounded and not condition.variation:
            row["bound"] = bound(hidden.scene, condition.sensors)
        print(f"seed {hidden.scene.seed}: {row['cpu_s']:.1f} s", file=sys.stderr, flush=True)
        rows.append(row)
    return rows


def _row(hidden: pushed.HiddenPush) -> dict[str, Any]:
    truth = hidden.truth()["links"][0]
    peers = _peers(hidden.streams)
    row: dict[str, Any] = {
        "mean_force": peers[0] / truth["friction_force_n"] - 1.0,
        "balance_product": peers[1] / truth["friction_force_n"] - 1.0,
        "balance_mass": peers[2] / truth["mass"] - 1.0,
        "ellipsoid_com_m": float(np.linalg.norm(_ellipsoid_centre(hidden.streams) - truth["com"])),
        "centroid_m": float(np.hypot(*truth["com"])),
    }
    start = time.process_time()
    try:
        found = estimate(hidden.streams)
    except NotIdentifiableError as error:
        return row | {"refused": str(error), "cpu_s": time.process_time() - start}
    row["cpu_s"] = time.process_time() - start
    row["undetermined"] = list(found.undetermined)
    row["rms"] = found.error
    return row | errors(found, truth)


def errors(found: PushedEstimate, truth: dict[str, Any]) -> dict[str, Any]:
    """Errors of an estimate: relative, of the centre in m, and over their std (z)."""
    known = {"friction_force_n": truth["friction_force_n"], "mass": truth["mass"]}
    known |= {"com_x": truth["com"][0], "com_y": truth["com"][1]}
    z = {
        name: (found.values[name][0] - value) / found.values[name][1]
        for name, value in known.items()
    }
    relative = {n: found.values[n][0] / known[n] - 1.0 for n in ("friction_force_n", "mass")}
    away = [found.values[n][0] - known[n] for n in ("com_x", "com_y")]
    return {"z": z, "relative": relative, "com_m": float(np.hypot(*away))}


def _peers(streams: PushedStreams) -> tuple[float, float, float]:
    """Median force while sliding (N), and product (N) and mass (kg) of a balance by least squares.

    m a + q v / |v| = F, with v and a of parabolas through the poses of 0.1 s; no latent motion.
    """
    link, contact = streams.links[0], next(iter(streams.contacts.values()))
    velocity, acceleration = _differentiated(link.time, link.pose[:, :2], contact.time)
    force = contact.force[:, :2]
    speed = np.linalg.norm(velocity, axis=1)
    sliding = speed > 0.015
    if sliding.sum() < 5:
        return float("nan"), float("nan"), float("nan")
    unit = velocity[sliding] / speed[sliding, None]
    columns = np.column_stack([acceleration[sliding].ravel(), unit.ravel()])
    mass, product = np.linalg.lstsq(columns, force[sliding].ravel(), rcond=None)[0]
    middle = float(np.median(np.linalg.norm(force[sliding], axis=1)))
    return middle, float(product), float(mass)


def _ellipsoid_centre(streams: PushedStreams) -> Array:
    """Centre of mass (2,), m, of an ellipsoid limit surface, by least squares while sliding.

    Force and velocity of the centre of friction are parallel: f x (v + omega x R c) = 0, with v of
    the frame's origin; the centre of friction is taken for that of mass, as nothing tips.
    Source: Lynch, Maekawa, Tanie 1992.
    """
    link, contact = streams.links[0], next(iter(streams.contacts.values()))
    velocity, _ = _differentiated(link.time, link.pose, contact.time)
    yaw = np.interp(contact.time, link.time, link.pose[:, 2])
    force, sliding = contact.force[:, :2], np.linalg.norm(velocity[:, :2], axis=1) > 0.015
    cos, sin = np.cos(yaw), np.sin(yaw)
    turns = np.stack([np.column_stack([-sin, -cos]), np.column_stack([cos, -sin])], axis=1)
    moved = velocity[:, 2, None, None] * turns
    columns = force[:, :1] * moved[:, 1] - force[:, 1:] * moved[:, 0]
    lack = force[:, 1] * velocity[:, 0] - force[:, 0] * velocity[:, 1]
    return np.asarray(np.linalg.lstsq(columns[sliding], lack[sliding], rcond=None)[0])


def _differentiated(time_of: Array, place: Array, at: Array) -> tuple[Array, Array]:
    velocity, acceleration = np.zeros((2, len(at), place.shape[1]))
    for k, now in enumerate(at):
        near = np.abs(time_of - now) < _WINDOW
        if near.sum() < 4:
            continue
        fit = np.polynomial.polynomial.polyfit(time_of[near] - now, place[near], 2)
        velocity[k], acceleration[k] = fit[1], 2.0 * fit[2]
    return velocity, acceleration


def table(found: dict[str, Any]) -> str:
    """Medians of errors, shares of intervals that hold, what was called undetermined, peers."""
    head = (
        "| pushes | n | product % | CoM mm | mass % | 90 % hold: product, CoM, mass | largest z "
        "| mass undetermined | refused | mean force % | balance: product, mass % "
        "| centroid, ellipsoid mm | cpu s | bound: product %, CoM mm, mass % |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    lines += [_line(name, rows) for name, rows in found.items()]
    return "\n".join(lines)


def _line(name: str, rows: list[dict[str, Any]]) -> str:
    told = [row for row in rows if "z" in row]
    refused = len(rows) - len(told)

    def median(pick: Any, of: list[dict[str, Any]]) -> float:
        return float(np.median([abs(pick(row)) for row in of])) if of else float("nan")

    def hold(*names: str) -> str:
        inside = [abs(row["z"][n]) < 1.645 for row in told for n in names]
        return f"{np.mean(inside):.2f}" if inside else "-"

    largest = max((abs(value) for row in told for value in row["z"].values()), default=float("nan"))
    unknown = sum("mass" in row["undetermined"] for row in told)
    holds = ", ".join([hold("friction_force_n"), hold("com_x", "com_y"), hold("mass")])
    balance = (
        f"{100 * median(lambda r: r['balance_product'], rows):.1f}, "
        f"{100 * median(lambda r: r['balance_mass'], rows):.0f}"
    )
    cells = [
        name,
        len(rows),
        f"{100 * median(lambda r: r['relative']['friction_force_n'], told):.2f}",
        f"{1e3 * median(lambda r: r['com_m'], told):.2f}",
        f"{100 * median(lambda r: r['relative']['mass'], told):.1f}",
        holds,
        f"{largest:.1f}",
        unknown,
        refused,
        f"{100 * median(lambda r: r['mean_force'], rows):.1f}",
        balance,
        f"{1e3 * median(lambda r: r['centroid_m'], rows):.1f}, "
        f"{1e3 * median(lambda r: r['ellipsoid_com_m'], rows):.1f}",
        f"{median(lambda r: r['cpu_s'], rows):.1f}",
        _bound([row["bound"] for row in rows if "bound" in row]),
    ]
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def _bound(rows: list[dict[str, float]]) -> str:
    if not rows:
        return ""
    product, mass = (float(np.median([r[n] for r in rows])) for n in ("friction_force_n", "mass"))
    com = float(np.median([np.hypot(r["com_x"], r["com_y"]) for r in rows]))
    return f"{100 * product:.2f}, {1e3 * com:.2f}, {100 * mass:.1f}"
