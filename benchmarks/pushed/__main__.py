"""Pushed objects: friction, mass and centre of mass, on real and simulated pushes."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.pushed import (
    conventions,
    diagnoses,
    linked,
    live,
    live_effect,
    manners,
    real,
    simulated,
)

Section = tuple[Callable[[argparse.Namespace], dict[str, Any]], Callable[[dict[str, Any]], str]]
SECTIONS: dict[str, Section] = {
    "conventions": (conventions.measure, conventions.table),
    "diagnoses": (diagnoses.measure, diagnoses.table),
    "linked": (linked.measure, linked.table),
    "live_effect": (live_effect.measure, live_effect.table),
    "live": (live.measure, live.table),
    "manners": (manners.measure, manners.table),
    "real": (real.measure, real.table),
    "simulated": (simulated.measure, simulated.table),
}
"""What measures each section and what makes a table of it; add a line to add one."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sections and print them; 1 if one had to be skipped."""
    parser = argparse.ArgumentParser(prog="bench pushed", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=sorted(SECTIONS), default=sorted(SECTIONS))
    parser.add_argument("--quick", action="store_true", help="few cases of each section")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    for add in (
        conventions.add_arguments,
        diagnoses.add_arguments,
        linked.add_arguments,
        live.add_arguments,
        live_effect.add_arguments,
        manners.add_arguments,
        real.add_arguments,
        simulated.add_arguments,
    ):
        add(parser)
    options = parser.parse_args(arguments)
    found = {}
    for name in options.only:
        measure, table = SECTIONS[name]
        found[name] = measure(options)
        if not options.json:
            print(f"## {name}\n\n{table(found[name])}\n", flush=True)
    if options.json:
        print(json.dumps(found))
    return int(any("skipped" in section for section in found.values()))
