"""Section `live`: what an update costs, early and late, beside the alternatives."""

from __future__ import annotations

import dataclasses
import resource
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import psutil

from benchmarks.inertia.peers import SmoothedData, batch_resolve, plain_isam2
from benchmarks.inertia.scenarios import Case, four_fingers
from benchmarks.support.live_replay import replay_streams
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.inertia.live import IncrementalInertialEstimator
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    affine_invariant_distance,
    is_feasible,
)
from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions
from tactile_dynamics_ros.synthetic.sensors import SensorOptions, read_sensors

_MEMORY_EVERY = 500


@dataclasses.dataclass
class _Watch:
    """An estimator whose updates are timed; `preempted`: how often each lost the processor."""

    estimator: IncrementalInertialEstimator
    cpu: list[float] = dataclasses.field(default_factory=list)
    wall: list[float] = dataclasses.field(default_factory=list)
    preempted: list[int] = dataclasses.field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.estimator, name)

    def update(self) -> Any:
        switches = _preemptions()
        cpu, wall = time.thread_time(), time.perf_counter()
        estimate = self.estimator.update()
        self.wall.append(time.perf_counter() - wall)
        self.cpu.append(time.thread_time() - cpu)
        self.preempted.append(_preemptions() - switches)
        return estimate


def _preemptions() -> int:
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw


def long_recording(updates: int, seed: int = 0) -> tuple[Streams, InertialParameters]:
    """Four fingers at 100 Hz for as many updates."""
    options = ScenarioOptions(duration=updates / 100.0, physics_rate_hz=100.0)
    scenario = Scenario.draw(seed, options)
    streams = read_sensors(scenario.simulate(), (), SensorOptions(), seed)
    body = scenario.body
    return streams, InertialParameters(body.mass, body.com, body.inertia_com)


def run_live(updates: int, peer_steps: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Latency percentiles, growth and memory over many updates; the alternatives' growth."""
    say(f"live: {updates} updates with four fingers at 100 Hz")
    streams, truth = long_recording(updates)
    watch, process = _Watch(IncrementalInertialEstimator()), psutil.Process()
    memory, feasible, last = [], True, None
    for count, last in enumerate(replay_streams(streams, watch)):  # type: ignore[arg-type]
        feasible = feasible and is_feasible(last.inertia.dynamic_parameters)
        if count % _MEMORY_EVERY == 0:
            memory.append(process.memory_info().rss / 2**20)
    assert last is not None
    tenth = updates // 10
    cpu, wall = 1e3 * np.array(watch.cpu), 1e3 * np.array(watch.wall)
    early, late = np.median(cpu[:tenth]), np.median(cpu[-tenth:])
    settled = memory[len(memory) // 10 :]
    return {
        "updates": updates,
        "cpu_ms": _percentiles(cpu),
        "wall_ms": _percentiles(wall),
        "undisturbed": _undisturbed(cpu, np.array(watch.preempted)),
        "last_over_first_decile": float(late / early),
        "mean_last_over_first_decile": float(cpu[-tenth:].mean() / cpu[:tenth].mean()),
        "memory_mib": {"after_first_tenth": settled[0], "peak": max(memory), "last": memory[-1]},
        "all_feasible": feasible,
        "distance_at_end": affine_invariant_distance(
            truth.pseudo_inertia, last.inertia.pseudo_inertia
        ),
        "alternatives": _alternatives(four_fingers(0), peer_steps, late, say),
    }


def run_batch_time(seeds: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Seconds for a 30 s recording."""
    say("batch: seconds per 30 s recording")
    cpu, wall = [], []
    for seed in range(seeds):
        streams = four_fingers(seed).streams
        started = time.thread_time(), time.perf_counter()
        estimate_body(streams).to_estimate()
        cpu.append(time.thread_time() - started[0])
        wall.append(time.perf_counter() - started[1])
    return {
        "recordings": seeds,
        "cpu_s": {"median": float(np.median(cpu)), "max": float(np.max(cpu))},
        "wall_s": {"median": float(np.median(wall)), "max": float(np.max(wall))},
    }


def _alternatives(
    case: Case, steps: int, ours: float, say: Callable[[str], None]
) -> dict[str, Any]:
    say(f"live: plain iSAM2 and batch GTSAM up to step {steps}")
    data = SmoothedData.of(case)
    truth = case.truth.pseudo_inertia
    marks = [k for k in (100, 300, 1000, 1700) if k <= steps]
    isam, costs = plain_isam2(data, steps)
    solved, solving = batch_resolve(data, marks)
    exact = InertialParameters.from_dynamic_parameters
    return {
        "our_update_ms": float(ours),
        "plain_isam2": {
            "ms_at_step": {str(k): float(1e3 * np.median(costs[k - 20 : k])) for k in marks},
            "over_ours_at_last": float(1e3 * np.median(costs[-20:]) / ours),
            "distance": affine_invariant_distance(truth, exact(isam).pseudo_inertia),
        },
        "batch_resolved": {
            "ms_at_step": {str(k): float(1e3 * c) for k, c in zip(marks, solving, strict=True)},
            "over_ours_at_last": float(1e3 * solving[-1] / ours),
            "distance": affine_invariant_distance(truth, exact(solved).pseudo_inertia),
        },
    }


def _undisturbed(cpu: np.ndarray, preempted: np.ndarray) -> dict[str, Any]:
    """Updates during which no other program took the processor (and cooled its caches)."""
    kept = cpu[preempted == 0]
    return {"share": len(kept) / len(cpu), "ms": _percentiles(kept) if len(kept) else {}}


def _percentiles(values: np.ndarray) -> dict[str, float]:
    names = {"p50": 50, "p90": 90, "p99": 99, "max": 100}
    return {name: float(np.percentile(values, q)) for name, q in names.items()}
