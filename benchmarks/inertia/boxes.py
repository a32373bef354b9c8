"""Sections `wrist_ft` and `in_hand`: paper A's boxes on a force/torque sensor and in the hand."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.inertia.in_hand import record_in_hand
from benchmarks.inertia.published import (
    RELAXED_RIGIDITY,
    VISION,
    WRIST,
    published_score,
    published_truth,
)
from benchmarks.inertia.scores import Score, deviations
from benchmarks.peers.paper_a import METHODS, TimeSteps, estimate_as_published
from benchmarks.support.live_replay import replay_streams
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.core.tactile.calibration import NORMAL_90
from tactile_dynamics_ros.sim.simulated_robot import Readings
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.objects import HeldObject
from tactile_dynamics_ros.synthetic.scenario import GRAVITY, Scenario, ScenarioOptions

BOXES = ("box_0", "box_1", "box_2", "box_3", "box_4")
MEASURES = ("trace_error", "distance", "mass_percent", "com_mm", "inertia")

DRAWN = ("mass_percent", "com_mm")
"""Measures of which every run is kept, for box plots."""

PROCESSES = 2
"""Recordings at a time."""

_TRIPLES = 60
_FORCE_STD = np.array([0.035, 0.035, 0.13])
_TORQUE_STD = np.array([1.7e-3, 1.7e-3, 3.5e-4])
_POSITION_STD, _ROTATION_STD = 1e-4, 3.5e-4


def wrist_recording(box: str, seed: int) -> tuple[Streams, InertialParameters]:
    """A box bolted to a HEX-E on an arm: 30 s, 100 Hz, its noise, poses from encoders."""
    truth = published_truth(box)
    body = HeldObject("box", np.full(3, 0.2), truth.mass, truth.com, truth.inertia_com)
    scenario = dataclasses.replace(Scenario.draw(seed, ScenarioOptions()), body=body)
    time = np.arange(0.0, scenario.options.duration, 0.01)
    motion = scenario.motion.evaluate(time)
    wrench = body.inertial_wrench(motion, GRAVITY)
    rng = randomness.stream(seed, "noise")
    count = len(time)
    noise = [
        motion.to_world(std * rng.normal(size=(count, 3))) for std in (_TORQUE_STD, _FORCE_STD)
    ]
    tilt = exp_so3(_ROTATION_STD * rng.normal(size=(count, 3)))
    variance = np.repeat([_ROTATION_STD**2, _POSITION_STD**2], 3)
    pose = PoseStream(
        time,
        motion.position + _POSITION_STD * rng.normal(size=(count, 3)),
        tilt @ motion.rotation,
        np.broadcast_to(np.diag(variance), (count, 6, 6)).copy(),
    )
    spread = np.einsum("nij,j,nij->ni", motion.rotation, _FORCE_STD**2, motion.rotation)
    wrist = ContactStream(
        "wrist",
        time,
        wrench[:, 3:] + noise[1],
        wrench[:, :3] + noise[0],
        np.sqrt(spread),
        time,
        motion.position,
        motion.rotation,
        carries_torque=True,
    )
    return Streams(pose, {"wrist": wrist}), truth


Recordings = tuple[dict[int, Streams], InertialParameters]
"""By the paper's table that has its like, what was recorded of one motion; and the truth."""


@dataclass(frozen=True)
class BoxRun:
    """One recording of a box.

    Attributes:
        ours, live: scores of both estimators, None where they were not run.
        in_stds, live_in_stds: errors in standard deviations (10,).
        reproduced: score of paper A's best method.
    """

    ours: Score | None = None
    in_stds: Array | None = None
    live: Score | None = None
    live_in_stds: Array | None = None
    reproduced: Score | None = None


def run_wrist(seeds: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Errors per box on the wrist sensor, beside the paper's Table II."""
    return {"seeds": seeds, "rows": _box_rows(_on_wrist, seeds, 0, say)[WRIST]}


def _on_wrist(box: str, seed: int) -> Recordings:
    streams, truth = wrist_recording(box, seed)
    return {WRIST: streams}, truth


def run_in_hand(seeds: int, live_seeds: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Errors per box in the simulated hand (live: the first seeds), beside Tables IV and III."""
    rows = _box_rows(in_hand_recording, seeds, live_seeds, say)
    found = {"rows": rows[RELAXED_RIGIDITY], "vision_rows": rows[VISION]}
    return {"seeds": seeds, "live_seeds": live_seeds, **found}


def in_hand_recording(box: str, seed: int) -> Recordings:
    """A box that the simulated hand moves: with published poses, and with those of vision alone."""
    seen: list[tuple[float, Array]] = []

    def look(readings: Readings) -> None:
        if readings.vision is not None:
            seen.append((readings.time, readings.vision))

    streams, truth, _ = record_in_hand(box, seed, watch=look)
    start, stop = streams.pose.time[[0, -1]]
    time, pose = (np.array(part) for part in zip(*seen, strict=True))
    aloft = (time >= start) & (time <= stop)
    vision = PoseStream(time[aloft], pose[aloft, :3, 3], pose[aloft, :3, :3], None)
    return {RELAXED_RIGIDITY: streams, VISION: Streams(vision, streams.contacts)}, truth


def _run_case(
    record: Callable[[str, int], Recordings], live_seeds: int, case: tuple[str, int]
) -> dict[int, BoxRun]:
    recorded, truth = record(*case)
    return {table: _run(streams, truth, case[1], live_seeds) for table, streams in recorded.items()}


def _run(streams: Streams, truth: InertialParameters, seed: int, live_seeds: int) -> BoxRun:
    if not streams.contacts:
        return BoxRun()
    estimate = estimate_body(streams).to_estimate()
    run = BoxRun(
        Score.of(truth, estimate.inertia.dynamic_parameters, 0.0),
        deviations(estimate, truth),
    )
    if seed < live_seeds:
        last = list(replay_streams(streams))[-1]
        lively = Score.of(truth, last.inertia.dynamic_parameters, 0.0)
        run = dataclasses.replace(run, live=lively, live_in_stds=deviations(last, truth))
    if seed == 0 and not any(c.carries_torque for c in streams.contacts.values()):
        run = dataclasses.replace(run, reproduced=_reproduce(streams, truth))
    return run


def _box_rows(
    record: Callable[[str, int], Recordings],
    seeds: int,
    live_seeds: int,
    say: Callable[[str], None],
) -> dict[int, list[dict[str, Any]]]:
    """Run all boxes with every seed, a hand of its own each; by table a row per box."""
    cases = [(box, seed) for seed in range(seeds) for box in BOXES]
    found: dict[int, dict[str, list[BoxRun]]] = {}
    with ProcessPoolExecutor(PROCESSES) as pool:
        for (box, seed), runs in zip(
            cases, pool.map(partial(_run_case, record, live_seeds), cases), strict=True
        ):
            for table, run in runs.items():
                mass = (
                    "no contact" if run.ours is None else f"mass {run.ours.mass_percent:.2f} % off"
                )
                say(f"{box}, seed {seed}, beside table {table}: {mass}")
                found.setdefault(table, {}).setdefault(box, []).append(run)
    return {
        table: [_box_row(box, table, runs) for box, runs in boxes.items()]
        for table, boxes in found.items()
    }


def _box_row(box: str, table: int, runs: list[BoxRun]) -> dict[str, Any]:
    ours, live, reproduced = (
        [score for run in runs if (score := getattr(run, name)) is not None]
        for name in ("ours", "live", "reproduced")
    )
    in_stds, live_in_stds = (
        [each for run in runs if (each := getattr(run, name)) is not None]
        for name in ("in_stds", "live_in_stds")
    )
    return {
        "object": box,
        "runs": len(ours),
        "ours": _measures(ours),
        "each": {key: [round(getattr(score, key), 4) for score in ours] for key in DRAWN},
        "live": _measures(live),
        "paper": _measures([published_score(table, box)]),
        "paper's method here": _measures(reproduced),
        "coverage": {"ours": _coverage(in_stds), "live": _coverage(live_in_stds)},
        "deviations": {
            name: float(value)
            for name, value in zip(PARAMETER_NAMES, np.median(np.abs(in_stds), axis=0), strict=True)
        },
        "within_3_percent_and_3_mm": float(
            np.mean([s.mass_percent <= 3.0 and s.com_mm <= 3.0 for s in ours])
        ),
    }


def _coverage(in_stds: list[Array]) -> float:
    """Share of the 90 % intervals that hold."""
    return float(np.mean(np.abs(in_stds) < NORMAL_90)) if in_stds else 0.0


def _reproduce(streams: Streams, truth: InertialParameters) -> Score:
    """Paper A's best method on our recording."""
    stride = max(len(streams.pose.time) // _TRIPLES, 1)
    bounds = truth.com - 0.1, truth.com + 0.1
    steps = TimeSteps.from_streams(streams, stride)
    found = estimate_as_published(steps, METHODS[3], None, bounds)
    return Score.of(truth, found.dynamic_parameters, 0.0)


def _measures(scores: list[Score]) -> dict[str, float]:
    if not scores:
        return {}
    return {name: float(np.median([getattr(s, name) for s in scores])) for name in MEASURES}
