"""Hours of clean touch: how often the statistic tells a change where there is none.

Neither Bullet nor the filter: objects follow drawn ways, forces are those of the mechanics under
friction that differs from place to place, and what the filter would believe of the velocity is off
by noise that lasts a few steps, as it is in recordings. An hour takes minutes.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kept import read_rows
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.change import ChangeMonitor
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, SeenPose
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.mechanics.linkage import applied, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull
from tactile_dynamics_ros.core.planar.mechanics.simulation import support_resistance
from tactile_dynamics_ros.sim.objects import planar_object

STEP, HEIGHT, EVERY = 0.01, 0.012, 3
"""s of a step, m of the push above the table, steps from pose to pose."""
FIT_STD = np.array([0.05, 0.2, 1e-3, 1e-3])
"""Of ln friction force, ln mass and centre of mass, m: what fits to five pushes state."""
BELIEVED = np.array([3.5e-3, 3.5e-3, 0.1])
"""Of the filter's velocity, m/s and rad/s, at 30 Hz of poses."""
POSE = np.array([5e-4, 5e-4, 3.5e-3])
FORCE, OFFSET = 0.03, 0.02
"""N, noise of each force and of what stays of it."""
LASTS, PLACE, ACROSS = 3.5, 0.03, 0.03
"""Steps and m over which errors of the velocity and friction are alike; share of friction across
the way."""
TOUCH = 20.0
"""s of touch for which one reference is held."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--quiet-hours", type=float, default=1.0, help="of touch, of each spread")
    parser.add_argument("--quiet-spreads", type=float, nargs="+", default=[0.05, 0.1])
    parser.add_argument("--quiet-rows", type=Path, default=Path("out/explore_quiet.jsonl"))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """One row for each object and spread; those in the file are not made again."""
    path: Path = options.quiet_rows
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = read_rows(path)
    done = {(row["case"], row["spread"]) for row in rows}
    count = 2 if options.quick else int(np.ceil(3600.0 * options.quiet_hours / TOUCH))
    for case in range(count):
        for spread in options.quiet_spreads:
            if (case, spread) in done:
                continue
            rows.append(_row(case, spread))
            with path.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
        if case % 20 == 0:
            print(f"{case} of {count}", file=sys.stderr, flush=True)
    return {"rows": rows}


@dataclass(frozen=True, eq=False)
class _Push:
    """One way of an object: poses and velocities (N, 3) of its frame, and forces (N, 2)."""

    pose: Array
    rate: Array
    force: Array


def _row(case: int, spread: float) -> dict[str, Any]:
    rng = np.random.default_rng([case, round(1e3 * spread), 461])
    part = planar_object(1 + case % 40).parts[0]
    process = PatchProcess(convex_hull(part.corners))
    truth = np.array([np.log(part.mass * part.friction), np.log(part.mass), *part.com])
    monitor = ChangeMonitor(process)
    monitor.refer(truth + FIT_STD * rng.standard_normal(4), np.diag(FIT_STD**2))
    time, most, alarms = 0.0, 0.0, 0
    while monitor.touch < TOUCH:
        push = _drawn(process, truth, spread, rng)
        time = _show(monitor, push, time, rng) + 1.0
        most = max(most, 0.0 if monitor.change is None else monitor.change.statistic)
        if monitor.alarm is not None:
            alarms += 1
            monitor.alarm = None
            monitor.pieces.clear()
    return {
        "case": case, "spread": spread, "touch_s": monitor.touch, "alarms": alarms, "most": most
    }  # fmt: skip


def _drawn(process: PatchProcess, truth: Array, spread: float, rng: np.random.Generator) -> _Push:
    """A push of 40 to 80 mm at 0.05 to 0.2 m/s that turns the object more or less."""
    speed, way = np.exp(rng.uniform(*np.log([0.05, 0.2]))), rng.uniform(0.04, 0.08)
    count = int(way / speed / STEP)
    pace = speed * np.minimum(
        1.0, np.minimum(np.arange(count), np.arange(count)[::-1]) * 0.02 / speed
    )
    heading, turning = rng.uniform(-np.pi, np.pi), rng.normal(0.0, 6.0)
    rate = np.column_stack([pace * np.cos(heading), pace * np.sin(heading), pace * turning])
    start = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(-np.pi, np.pi)])
    pose = start + np.cumsum(rate, axis=0) * STEP
    motion = PusherMotion(start, start, STEP, HEIGHT, touching=True)
    link = process.link_of(np.tile(truth, (count, 1)), motion)
    arm = turned(link.com, pose[:, 2])
    centre = rate.copy()
    centre[:, :2] += rate[:, 2:] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    force = np.zeros((count, 2))
    for _ in range(3):
        friction = np.column_stack([-force, np.zeros(count)])
        height = np.full(count, HEIGHT)
        resistance = support_resistance(link, pose[:, 2], centre, friction, force, height)
        force = applied(resistance, centre)[:, :2]
    gone = np.cumsum(pace) * STEP
    ahead, aside = _field(gone, rng), _field(gone, rng)
    across = np.stack([-force[:, 1], force[:, 0]], axis=1)
    force = force * (1.0 + spread * ahead[:, None]) + ACROSS * aside[:, None] * across
    gain = np.gradient(centre[:, :2], STEP, axis=0)
    noise = OFFSET * rng.standard_normal(2) + FORCE * rng.standard_normal((count, 2))
    return _Push(pose, rate, force + link.mass[:, None] * gain + noise)


def _field(gone: Array, rng: np.random.Generator) -> Array:
    """Smooth unit noise along a way (N,), m."""
    knots = np.arange(0.0, gone[-1] + 2.0 * PLACE, PLACE)
    return np.asarray(np.interp(gone, knots, rng.standard_normal(len(knots))))


def _show(monitor: ChangeMonitor, push: _Push, time: float, rng: np.random.Generator) -> float:
    """Show a push to a monitor; return when it ends, s."""
    keep = np.exp(-1.0 / LASTS)
    off = np.zeros(3)
    covariance = np.diag(np.square([2e-4, 2e-4, 1e-3, *BELIEVED]))
    for k in range(1, len(push.pose) - 1):
        off = keep * off + np.sqrt(1.0 - keep**2) * BELIEVED * rng.standard_normal(3)
        before, after = push.pose[k - 1], push.pose[k]
        state = np.concatenate([before, push.rate[k - 1] + off])
        motion = PusherMotion(before, after, STEP, HEIGHT, touching=True)
        seen = SeenPose(before + POSE * rng.standard_normal(3), POSE, STEP)
        measured = MeasuredWrench(push.force[k], np.full(2, FORCE))
        monitor.see(time, (state, covariance), motion, measured, (seen,) if k % EVERY == 0 else ())
        time += STEP
    monitor.release(time)
    return time


def table(found: dict[str, Any]) -> str:
    """Touch and alarms of each spread."""
    lines = [
        "| friction differs by | objects | touch, min | false alarms | largest statistic |",
        "|---|---|---|---|---|",
    ]
    for spread in sorted({row["spread"] for row in found["rows"]}):
        rows = [row for row in found["rows"] if row["spread"] == spread]
        touch = sum(row["touch_s"] for row in rows) / 60.0
        alarms, most = sum(row["alarms"] for row in rows), max(row["most"] for row in rows)
        lines.append(f"| {spread:g} | {len(rows)} | {touch:.0f} | {alarms} | {most:.1f} |")
    return "\n".join(lines)
