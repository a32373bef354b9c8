"""Exploring and pushing to goals on the simulated table, beside simpler ways."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.explore import actions, changes, detection, estimates, goals, quiet

Section = tuple[Callable[[argparse.Namespace], dict[str, Any]], Callable[[dict[str, Any]], str]]
SECTIONS: dict[str, Section] = {
    "actions": (actions.measure, actions.table),
    "estimates": (estimates.measure, estimates.table),
    "goals": (goals.measure, goals.table),
    "changes": (changes.measure, changes.table),
    "quiet": (quiet.measure, quiet.table),
    "detection": (detection.measure, detection.table),
}
"""What measures each section and what makes a table of it; add a line to add one."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sections and print them."""
    parser = argparse.ArgumentParser(prog="bench explore", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=sorted(SECTIONS), default=sorted(SECTIONS))
    parser.add_argument("--quick", action="store_true", help="few cases of each section")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    actions.add_arguments(parser)
    estimates.add_arguments(parser)
    goals.add_arguments(parser)
    changes.add_arguments(parser)
    detection.add_arguments(parser)
    quiet.add_arguments(parser)
    options = parser.parse_args(arguments)
    found = {}
    for name in options.only:
        measure, table = SECTIONS[name]
        found[name] = measure(options)
        if not options.json:
            print(f"## {name}\n\n{table(found[name])}\n", flush=True)
    if options.json:
        print(json.dumps(found))
    return 0
