"""Shapes of objects on a table: accuracy, views, parts, honesty, time."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.shape.figures import draw
from benchmarks.shape.peers import PEERS, compare_peers
from benchmarks.shape.real import CLOUDS, real_clouds
from benchmarks.shape.trial import Trial, run_trial

STRATEGIES = ("active", "uniform", "random")
NEAR = 1.1
"""Chamfer distance over that of the best after eight looks, from which it has converged."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="bench shape", description=__doc__)
    parser.add_argument("--objects", nargs=2, type=int, default=[1, 120], metavar=("A", "B"))
    parser.add_argument("--step", type=int, default=1, help="every STEP-th object")
    parser.add_argument("--views", type=int, default=0, metavar="N", help="compare strategies on N")
    parser.add_argument("--peers", action="store_true", help="others on the points of all looks")
    parser.add_argument("--only", choices=("real",), help="only the real clouds")
    parser.add_argument("--draw", type=Path, metavar="PNG", help="draw the looks at the objects")
    parser.add_argument("--quick", action="store_true", help="three objects")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args(arguments)
    numbers = list(range(options.objects[0], options.objects[1] + 1, options.step))
    if options.quick:
        numbers = [121, 133, 145]
    if options.only == "real":
        return show_real(options.json)
    if options.draw:
        draw(numbers, options.draw)
        return 0
    trials = []
    for number in numbers:
        trials.append(run_trial(number, peers=compare_peers if options.peers else None))
        if not options.json:
            print(describe(trials[-1]), flush=True)
    found = {"objects": summarise(trials), "trials": [vars(trial) for trial in trials]}
    if options.peers:
        found["peers_median_m"] = {
            name: float(np.median([trial.peers[name] for trial in trials if trial.peers]))
            for name in PEERS
        }
    if options.views:
        places = np.linspace(0, len(numbers) - 1, min(options.views, len(numbers)))
        found["views"] = compare_strategies([numbers[k] for k in places.round().astype(int)])
    print(json.dumps(found if options.json else {**found, "trials": len(trials)}))
    return int(any(trial.failure for trial in trials))


def show_real(as_json: bool) -> int:
    """Print what real clouds come to; 1 if they are not here."""
    found = real_clouds()
    if as_json:
        print(json.dumps(found))
    elif not found:
        print(f"no clouds in {CLOUDS}")
    else:
        for name, one in found.items():
            size = " x ".join(f"{1e3 * value:.1f}" for value in one["extents_m"])
            changes = ", ".join(
                f"{how} {'other parts' if change is None else f'{change:.1e}'}"
                for how, change in one["changes"].items()
            )
            print(f"{name}: {one['parts']} parts, {size} mm, {one['seconds']:.2f} s; {changes}")
    return int(not found)


def describe(trial: Trial) -> str:
    """A row for people."""
    path = " ".join(f"{1e3 * value:.2f}" for value in trial.chamfer)
    return (
        f"{trial.number:4d} {trial.kind:12s} {trial.outline:10s} parts {trial.parts[-1:]} of "
        f"{trial.wanted}{'' if trial.differ else ' (flush)'} chamfer mm {path} "
        f"fit {np.mean(trial.fit_s or [0]):.2f} s {trial.failure}"
    )


def summarise(trials: Sequence[Trial]) -> dict[str, object]:
    """Figures of all trials and of each kind."""
    good = [trial for trial in trials if not trial.failure]
    last = np.array([trial.chamfer[-1] for trial in good])
    differ = [trial for trial in good if trial.differ]
    axes = np.array([e for trial in good for e in trial.axes_error])
    z = np.abs([value for trial in good for value in trial.z])
    return {
        "n": len(trials),
        "failed": len(trials) - len(good),
        "chamfer_median_m": float(np.median(last)),
        "chamfer_worst_m": float(last.max()),
        "chamfer_below_2mm": int((last <= 0.002).sum()),
        "by_kind_median_m": {
            kind: float(np.median([t.chamfer[-1] for t in good if t.kind == kind]))
            for kind in sorted({t.kind for t in good})
        },
        "looks_median": float(np.median([len(t.chamfer) for t in good])),
        "parts_right": sum(t.parts[-1] == t.wanted for t in differ),
        "parts_of": len(differ),
        "flush_one": sum(t.parts[-1] == 1 for t in good if not t.differ),
        "flush_of": len(good) - len(differ),
        "axes_error_median_m": float(np.median(axes)) if len(axes) else None,
        "within_90": float(np.mean(z < 1.645)) if len(z) else None,
        "intervals": len(z),
        "fit_median_s": float(np.median([s for t in good for s in t.fit_s])),
        "fit_first_look_median_s": float(np.median([t.fit_s[0] for t in good])),
    }


def compare_strategies(numbers: Sequence[int]) -> dict[str, object]:
    """Looks that each strategy needs until its distance is near the best after eight."""
    looks: dict[str, list[int]] = {name: [] for name in STRATEGIES}
    for number in numbers:
        paths = {name: run_trial(number, name).chamfer for name in STRATEGIES}
        best = min(path[-1] for path in paths.values())
        for name, path in paths.items():
            near = [k + 1 for k, value in enumerate(path) if value <= NEAR * best + 1e-4]
            looks[name].append(near[0] if near else len(path) + 1)
    return {name: {"median": float(np.median(v)), "all": v} for name, v in looks.items()}
