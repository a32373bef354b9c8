"""Friction probing: accuracy, slip detection, objects in the air or warping, hidden effects."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.friction.accuracy import run_study, summarise_study
from benchmarks.friction.detection import score_detectors
from benchmarks.friction.figures import draw_study
from benchmarks.friction.hidden import FIRST_SEED, run_hidden
from benchmarks.friction.lifted import run_lifted, summarise_lifted
from benchmarks.friction.warping import run_warping, summarise_warping

PARTS = ("accuracy", "detection", "lifted", "warping", "hidden")


def main() -> int:
    """Run the wanted parts and print their numbers."""
    options = _parse()
    found: dict[str, Any] = {}
    cache = Path(options.cache)
    if {"accuracy", "detection"} & set(options.only):
        rows = run_study(options.hands, options.processes, cache / "study.jsonl")
        if "accuracy" in options.only:
            found["accuracy"] = summarise_study(rows)
        if "detection" in options.only:
            found["detection"] = score_detectors(rows)
        if options.figure:
            print(f"wrote {draw_study(rows, Path(options.figure))}", file=sys.stderr)
    if "lifted" in options.only:
        lifted = run_lifted(options.lifted, options.processes, cache / "lifted.jsonl")
        found["lifted"] = summarise_lifted(lifted)
    if "warping" in options.only:
        carton = run_warping(options.cartons, options.processes, cache / "warping.jsonl")
        found["warping"] = summarise_warping(carton)
    if "hidden" in options.only:
        found["hidden"] = run_hidden(options.seeds, options.start)
    print(json.dumps(found) if options.json else json.dumps(found, indent=1))
    return 0


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hands", type=int, default=10, help="fingertips, 10 probes with each")
    parser.add_argument("--cartons", type=int, default=6, help="probes of the warping carton")
    parser.add_argument("--lifted", type=int, default=4, help="hands that probe in the air")
    parser.add_argument("--seeds", type=int, default=20, help="recordings per hidden effect")
    parser.add_argument("--start", type=int, default=FIRST_SEED, help="first seed of those")
    parser.add_argument("--processes", type=int, default=2, help="probes at a time")
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    parser.add_argument("--cache", default="out/friction", help="folder of finished probes")
    parser.add_argument("--figure", metavar="PNG", help="also draw the box plots")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
