"""How long a step of the filter takes with each model, of one link and of two."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.filter.dual import DualConfig, DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import (
    MeasuredWrench,
    Observation,
    SeenPose,
)
from tactile_dynamics_ros.core.planar.filter.process import Process, PusherMotion
from tactile_dynamics_ros.synthetic.pushed.objects import PushedObject
from tactile_dynamics_ros.synthetic.pushed.sensed import POSE_STD

STEPS, PERIOD, SPEED = 60, 1.0 / 15.0, 0.025
"""Steps that are timed, s of each, m/s of the tip."""
CONFIG = DualConfig(hypotheses=70, motions=30)
"""100 points in all, as paper B has."""


def step_times(process: Process, thing: PushedObject) -> dict[str, float]:
    """Mean and 99th percentile of the CPU time of a step, ms, while link_1 is pushed along x."""
    offsets = np.array([[0.0, 0.0, 0.0], [*thing.offset, 0.0]])[: len(thing.links)]
    belief = DualFilter(process, offsets.ravel(), POSE_STD, CONFIG)
    way, start = np.array([SPEED * PERIOD, 0.0, 0.0]), float(thing.links[0].corners[:, 0].min())
    times = []
    for k in range(STEPS):
        at = np.array([start, 0.0, 0.0]) + k * way
        motion = PusherMotion(at, at + way, PERIOD, touching=True, normal=np.array([1.0, 0.0]))
        poses = tuple(SeenPose(o + (k + 1) * way, POSE_STD, 0.0, n) for n, o in enumerate(offsets))
        measured = MeasuredWrench(np.array([3.0, 0.0]), np.full(2, 0.03))
        began = time.process_time()
        belief.step(motion, Observation(poses, measured))
        times.append(1e3 * (time.process_time() - began))
    return {"mean_ms": float(np.mean(times)), "p99_ms": float(np.quantile(times, 0.99))}


def table(found: dict[str, Any]) -> str:
    """Rows for people."""
    rows = ["| a step of the filter, 100 points | mean ms | p99 ms |", "|---|---|---|"]
    rows += [f"| {n} | {one['mean_ms']:.1f} | {one['p99_ms']:.1f} |" for n, one in found.items()]
    return "\n".join([*rows, ""])
