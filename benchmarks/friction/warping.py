"""A carton whose faces give way: the probe has to notice, and not be sure of a wrong number."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.biotac_press_rig import calibrate_units
from benchmarks.friction.probe_trial import run_probe_trial
from benchmarks.friction.subjects import SUBJECTS
from benchmarks.friction.trials import Case, build_trial, holds_truth, run_cases, summarise
from tactile_dynamics_ros.core.errors import TactileDynamicsError

CARTON = next(subject for subject in SUBJECTS if subject.name == "box of sugar")
STIFFNESS = (0.15, 0.25, 0.4)
"""Of the faces' hinges, N m/rad: one newton beside the middle turns a face by 5 to 13 degrees."""
FIRST_HAND = 1500


def run_warping(count: int, processes: int, cache: Path) -> list[dict[str, Any]]:
    """Probe the carton with several hands, its faces more or less stiff."""
    cases = [Case(CARTON, FIRST_HAND + k, trial=k) for k in range(count)]
    return run_cases(cases, processes, cache, probe_carton)


def probe_carton(case: Case) -> dict[str, Any]:
    """Run one probe of the carton."""
    trial = build_trial(case, calibrate_units(case.hand))
    stiffness = STIFFNESS[case.trial % len(STIFFNESS)]
    world = replace(trial.robot.world, warp_stiffness=stiffness)
    trial = replace(trial, robot=replace(trial.robot, world=world))
    row: dict[str, Any] = {"subject": "warping carton", "hand": case.hand, "stiffness": stiffness}
    try:
        return row | summarise(case, trial, run_probe_trial(trial))
    except TactileDynamicsError as error:
        return row | {"outcome": str(error)}


def summarise_warping(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How often it was noticed, and how often a number was given with false confidence."""
    done = [row for row in rows if "estimate" in row]
    said = [row for row in done if row["estimate"]["normal_moves"]]
    outside = [row for row in done if not holds_truth(row)]
    return {
        "probes": len(rows),
        "with_estimate": len(done),
        "said_so": len(said),
        "truth_outside_interval": len(outside),
        "confident_and_wrong": sum(not row["estimate"]["normal_moves"] for row in outside),
        "errors": [row["true_static"] - row["estimate"]["static"] for row in done],
    }
