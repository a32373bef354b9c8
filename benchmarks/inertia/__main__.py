"""Inertial estimation: accuracy beside paper A, the bound and peers; honesty; cost per update."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

SECTIONS = (
    "table_one",
    "four_fingers",
    "coverage",
    "early",
    "feasibility",
    "live",
    "batch_time",
    "excitation",
    "wrist_ft",
    "in_hand",
    "hand_intervals",
)


def run(
    sections: Sequence[str], quick: bool, say: Callable[[str], None], hands: int | None = None
) -> dict[str, Any]:
    """Results by section; the one in the hand with the first ``hands`` of them."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from benchmarks.inertia import accuracy, boxes, cost, gain, honesty

    hands = hands or (1 if quick else 20)

    runs: dict[str, Callable[[], dict[str, Any]]] = {
        "table_one": lambda: accuracy.run_table_one(*((2, 1, 1) if quick else (20, 3, 1)), say),
        "four_fingers": lambda: accuracy.run_four_fingers(
            *((3, 3, 1) if quick else (48, 24, 8)), say
        ),
        "coverage": lambda: honesty.run_coverage(
            *((12, 2, 4, 6.0) if quick else (240, 240, 120, 10.0)), say
        ),
        "early": lambda: honesty.run_early(3 if quick else 40, say),
        "feasibility": lambda: honesty.run_feasibility(1 if quick else 5, say),
        "live": lambda: cost.run_live(*((2000, 300) if quick else (60000, 1700)), say),
        "batch_time": lambda: cost.run_batch_time(2 if quick else 10, say),
        "excitation": lambda: gain.run_excitation(2 if quick else 20, 15.0, say),
        "wrist_ft": lambda: boxes.run_wrist(1 if quick else 20, say),
        "in_hand": lambda: boxes.run_in_hand(hands, min(hands, 5), say),
        "hand_intervals": lambda: honesty.run_hand(hands, say),
    }
    results = {name: runs[name]() for name in SECTIONS if name in sections}
    machine = {"cpus": os.cpu_count(), "python": platform.python_version(), "quick": quick}
    return {"machine": machine, **results}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print tables, or JSON alone with `--json`."""
    parser = argparse.ArgumentParser(prog="./dev bench inertia", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    parser.add_argument("--quick", action="store_true", help="few seeds, a few minutes")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=SECTIONS, metavar="SECTION")
    parser.add_argument("--hands", type=int, metavar="N", help="of in_hand; 20, or 1 with --quick")
    parser.add_argument(
        "--load", nargs="+", type=Path, metavar="JSON", help="saved results instead"
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="Markdown page to write into")
    options = parser.parse_args(arguments)

    def say(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    results: dict[str, Any] = {}
    for path in options.load or ():
        results |= json.loads(path.read_text())
    if not options.load:
        results = run(options.only, options.quick, say, options.hands)
    if options.write:
        from benchmarks.inertia.page import keep_results, write_page

        write_page(keep_results(results), options.write)
    if options.json:
        print(json.dumps(results, indent=2))
    else:
        from benchmarks.inertia.tables import render

        print(render(results))
    return 0
