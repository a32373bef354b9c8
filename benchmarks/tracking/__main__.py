"""Trackers of a held object compared: ./dev bench tracking [--json] [--only SECTION ...]."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tracking.inertia import estimate_with_each
from benchmarks.tracking.page import render
from benchmarks.tracking.recovery import recover
from benchmarks.tracking.scores import Errors, measure, summarise
from benchmarks.tracking.search import search_on_table
from benchmarks.tracking.tape import Slip, load_tape
from benchmarks.tracking.trackers import LiveChain, follow_plain_icp
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.object_shape import load_shape
from tactile_dynamics_ros.share import object_file

RUNS = (
    ("box_0", 201),
    ("rubiks_cube", 202),
    ("soup_can", 203),
    ("box_2", 204),
    ("mug", 205),
    ("pudding_box", 206),
    ("gelatin_box", 207),
    ("tuna_can", 208),
    ("foam_brick", 209),
    ("potted_meat_can", 210),
)
BOXES = ("box_0", "box_2")
SEED_STEP = 100
SLIPS = (("box_0", 211, (1.0, 0.0, 0.0)), ("soup_can", 212, (0.0, 0.0, -1.0)))
END_ON = ("pudding_box", 3)
"""A box that stands with its narrow end to the camera."""
SECTIONS = ("accuracy", "search", "recovery", "inertia")


def main() -> int:
    """Run the chosen sections; return 0 if the fused pose meets its targets."""
    options = _parse()
    results: dict[str, Any] = {"excitation_s": options.duration}
    runs = RUNS[: options.runs]
    if "accuracy" in options.only:
        results |= _compare(runs, options)
    if "inertia" in options.only:
        boxes = [run for run in runs if run[0] in BOXES]
        results["inertia"], results["inertia_fused"] = _estimate(boxes, options)
    if "search" in options.only:
        results["search"] = _search(options)
    if "recovery" in options.only:
        results["recovery"] = _recover(options)
    print(json.dumps(results) if options.json else render(results))
    fused = results.get("trackers", {}).get("fused")
    if fused is None:
        return 0
    low, high = fused["nees_band_95"]
    met = fused["position_rms_mm"] <= 1.0 and fused["rotation_rms_deg"] <= 0.5
    return 0 if met and low <= fused["nees"] <= high else 1


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=SECTIONS)
    parser.add_argument("--runs", type=int, default=len(RUNS), help="objects, one run each")
    parser.add_argument("--searches", type=int, default=20, help="of each object on the table")
    parser.add_argument("--per-box", type=int, default=1, help="runs of each box for inertia")
    parser.add_argument("--duration", type=float, default=8.0, help="of the motion in hand, s")
    parser.add_argument("--tapes", type=Path, help="folder in which runs are kept")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser.parse_args()


def say(text: str) -> None:
    """Tell how far it is."""
    print(text, file=sys.stderr, flush=True)


def _compare(runs: tuple[tuple[str, int], ...], options: argparse.Namespace) -> dict[str, Any]:
    errors: dict[str, list[Errors]] = {}
    vision_s, kinematic_s, outcomes = [], [], []
    for name, seed in runs:
        tape, shape = load_tape(options.tapes, name, seed, options.duration), _shape(name)
        replay = LiveChain(shape, HandKinematics()).run(tape)
        plain = follow_plain_icp(tape, shape, replay.kinematic)
        tracks = {
            "fused": replay.fused,
            "vision_only": replay.vision,
            "kinematic_only": replay.kinematic,
            "plain_icp": plain,
        }
        for label, track in tracks.items():
            errors.setdefault(label, []).append(measure(tape, shape, track))
        vision_s += replay.vision.seconds
        kinematic_s += replay.kinematic.seconds
        outcomes.append(tape.outcome)
        fused = errors["fused"][-1]
        say(
            f"{name} seed {seed}: fused {1e3 * np.sqrt(np.mean(fused.position**2)):.2f} mm "
            f"{np.rad2deg(np.sqrt(np.mean(fused.rotation**2))):.2f} deg NEES "
            f"{np.mean(fused.nees):.1f} ({tape.outcome})"
        )
    return {
        "objects": [name for name, _ in runs],
        "outcomes": outcomes,
        "trackers": {label: summarise(found) for label, found in errors.items()},
        "per_object": {label: [_brief(run) for run in found] for label, found in errors.items()},
        "timing": {
            "image_ms_median": 1e3 * float(np.median(vision_s)),
            "image_ms_95": 1e3 * float(np.percentile(vision_s, 95)),
            "image_ms_longest": 1e3 * float(np.max(vision_s)),
            "kinematic_ms_median": 1e3 * float(np.median(kinematic_s)),
        },
    }


def _estimate(
    runs: list[tuple[str, int]], options: argparse.Namespace
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Estimate the inertia of boxes from each tracker's poses; say how good the fused ones are."""
    found, errors = [], []
    for name, first in runs:
        for seed in range(first, first + SEED_STEP * options.per_box, SEED_STEP):
            tape, shape = load_tape(options.tapes, name, seed, options.duration), _shape(name)
            replay = LiveChain(shape, HandKinematics()).run(tape)
            tracks = {
                "fused": replay.fused,
                "vision_only": replay.vision,
                "kinematic_only": replay.kinematic,
            }
            errors.append(measure(tape, shape, replay.fused))
            found.append(estimate_with_each(tape, tracks))
            say(json.dumps({"seed": seed, **found[-1]}))
    return found, summarise(errors)


def _brief(run: Errors) -> dict[str, float]:
    return {
        "position_rms_mm": 1e3 * float(np.sqrt(np.mean(run.position**2))),
        "rotation_rms_deg": float(np.rad2deg(np.sqrt(np.mean(run.rotation**2)))),
        "nees": float(np.mean(run.nees)),
    }


def _search(options: argparse.Namespace) -> list[dict[str, Any]]:
    found = []
    for name, seed in (END_ON, *RUNS)[: options.runs]:
        found.append(search_on_table(name, seed, _shape(name), options.searches))
        say(json.dumps(found[-1]))
    return found


def _recover(options: argparse.Namespace) -> list[dict[str, Any]]:
    found = []
    for name, seed in RUNS[:3]:
        tape = load_tape(options.tapes, name, seed, options.duration)
        for kind in ("occlusion", "wrong_pose"):
            found.append(recover(tape, _shape(name), kind))
            say(json.dumps(found[-1]))
    for name, seed, axis in SLIPS:
        tape = load_tape(options.tapes, name, seed, options.duration, Slip(np.array(axis)))
        if tape.slipped is None:
            say(f"{name} seed {seed}: did not slip ({tape.outcome})")
            continue
        found.append(recover(tape, _shape(name), "slip"))
        say(json.dumps(found[-1]))
    return found


def _shape(name: str):
    return load_shape(object_file(name))
