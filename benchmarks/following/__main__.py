"""Links of pushed objects followed in depth images: errors, honesty, occlusion, loss, time."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.following.peers import PEERS
from benchmarks.following.trial import Trial, images_per_second, run_trial


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="bench following", description=__doc__)
    parser.add_argument("--objects", nargs=2, type=int, default=[121, 156], metavar=("A", "B"))
    parser.add_argument("--step", type=int, default=1, help="every STEP-th object")
    parser.add_argument("--shapes", choices=("recovered", "true"), default="recovered")
    parser.add_argument("--follower", choices=("tracker", *PEERS), default="tracker")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args(arguments)
    follow = PEERS.get(options.follower)
    trials = []
    for number in range(options.objects[0], options.objects[1] + 1, options.step):
        trials.append(run_trial(number, options.shapes == "recovered", options.seed, follow))
        print(describe(trials[-1]), file=sys.stderr, flush=True)
    found = {"shapes": options.shapes, "follower": options.follower, **summarise(trials)}
    print(json.dumps(found, indent=None if options.json else 1))
    return 0


def describe(trial: Trial) -> str:
    """A row for people."""
    cells = [f"{trial.number:4d} {trial.kind:12s} {' + '.join(trial.outlines):20s}"]
    for phase in ("open", "half", "back"):
        if trial.position.get(phase):
            turn = np.rad2deg(np.median(trial.rotation.get(phase, [0.0])))
            cells.append(
                f"{phase} {trial.told[phase]}/{trial.images[phase]} "
                f"{1e3 * np.median(trial.position[phase]):.2f} mm {turn:.2f} deg "
                f"NEES {np.mean(trial.nees[phase]):.2f}"
            )
    cells.append(f"told when gone {trial.flagged}, found {trial.found}, wrong {trial.wrong}")
    return "; ".join([*cells, trial.failure])


def summarise(trials: Sequence[Trial]) -> dict[str, Any]:
    """Figures of all trials."""
    good = [trial for trial in trials if not trial.failure and trial.seconds]
    seconds = [s for trial in good for s in trial.seconds]
    return {
        "objects": len(trials),
        "failures": {trial.number: trial.failure for trial in trials if trial.failure},
        "links": sum(trial.links for trial in good),
        "phases": {phase: figures(good, phase) for phase in ("open", "half", "back")},
        "hidden_median": float(np.median([h for trial in good for h in trial.hidden])),
        "told_when_gone": sum(trial.flagged for trial in good),
        "objects_told_when_gone": sum(trial.flagged > 0 for trial in good),
        "found_again": sum(trial.found is not None for trial in good),
        "found_after_images_median": float(
            np.median([trial.found for trial in good if trial.found is not None] or [np.nan])
        ),
        "poses_off_by_1cm": sum(trial.wrong for trial in good),
        "image_ms_median": 1e3 * float(np.median(seconds)),
        "image_ms_95": 1e3 * float(np.percentile(seconds, 95)),
        "image_ms_median_by_links": {
            count: 1e3 / images_per_second([trial for trial in good if trial.links == count])
            for count in sorted({trial.links for trial in good})
        },
        "longest_ms": 1e3 * max(trial.longest for trial in good),
    }


def figures(trials: Sequence[Trial], phase: str) -> dict[str, float | None]:
    """Errors of a phase over all links and images; NEES per degree of freedom by run."""
    position = [e for trial in trials for e in trial.position.get(phase, [])]
    rotation = [e for trial in trials for e in trial.rotation.get(phase, [])]
    nees = [np.mean(trial.nees[phase]) for trial in trials if trial.nees.get(phase)]
    images = sum(trial.images.get(phase, 0) for trial in trials)
    if not position:
        return {"told": 0.0}
    return {
        "told": sum(trial.told.get(phase, 0) for trial in trials) / images,
        "position_median_mm": 1e3 * float(np.median(position)),
        "position_95_mm": 1e3 * float(np.percentile(position, 95)),
        "rotation_median_deg": float(np.rad2deg(np.median(rotation))) if rotation else None,
        "rotation_95_deg": float(np.rad2deg(np.percentile(rotation, 95))) if rotation else None,
        "nees_mean": float(np.mean(nees)),
        "nees_median_of_runs": float(np.median(nees)),
        "nees_worst_run": float(np.max(nees)),
    }
