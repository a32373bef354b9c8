"""Grasp success over seeded objects and places: python benchmarks/grasp.py [--json]."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys

from benchmarks.grasp_trial import TrialResult, draw_trials, run_trial
from tactile_dynamics_ros.core.manipulation.excitation import ExcitationConfig
from tactile_dynamics_ros.core.manipulation.grasp_controller import GraspConfig
from tactile_dynamics_ros.sim.objects import list_objects


def main() -> int:
    """Run the trials, print a table and return 0 if at least 19 of 20 succeed."""
    options = _parse()
    behaviour = GraspConfig(excitation=ExcitationConfig(duration=options.duration))
    objects = options.objects or list_objects()
    trials = draw_trials(objects, options.trials, options.seed, behaviour)
    results = []
    for number, trial in enumerate(trials, start=1):
        result = run_trial(trial)
        results.append(result)
        line = _line(number, trial.world.object_name, result)
        print(line, file=sys.stderr if options.json else sys.stdout, flush=True)
    successes = sum(result.success for result in results)
    factors = sorted(result.real_time_factor for result in results)
    summary = {
        "successes": successes,
        "trials": len(results),
        "excitation_s": options.duration,
        "real_time_factor_median": factors[len(factors) // 2],
        "slip_mm_max": max(result.slip_mm for result in results),
    }
    if options.json:
        rows = [
            {"object": trial.world.object_name, **dataclasses.asdict(result)}
            for trial, result in zip(trials, results, strict=True)
        ]
        print(json.dumps({**summary, "results": rows}))
    else:
        print(", ".join(f"{key} {value:.4g}" for key, value in summary.items()))
    return 0 if successes >= 0.95 * len(results) else 1


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--duration", type=float, default=30.0, help="of the excitation, s")
    parser.add_argument("--objects", nargs="*", help="names; all objects if left out")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser.parse_args()


def _line(number: int, name: str, result: TrialResult) -> str:
    verdict = "ok    " if result.success else "FAILED"
    return (
        f"{number:3d} {name:16s} {verdict} slip {result.slip_mm:5.1f} mm {result.turn_deg:5.1f} deg"
        f"  fingers >= {result.fingers}  {result.duration:5.1f} s at "
        f"{result.real_time_factor:4.1f}x  {result.outcome}"
    )


if __name__ == "__main__":
    sys.exit(main())
