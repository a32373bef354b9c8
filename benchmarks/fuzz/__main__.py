"""Reads thousands of mutated files: no traceback, no hang over 10 s, no gigabyte of memory."""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.fuzz.kinds import KINDS
from benchmarks.fuzz.workers import Case, Outcome, run_cases

FAILURES = ("traceback", "hang", "memory")
"""Ends that no file may have."""


def fuzz(
    count: int, seed: int = 0, kinds: Sequence[str] = tuple(KINDS), workers: int | None = None
) -> Iterator[Outcome]:
    """Yield what becomes of mutated files of each kind in turn.

    Args:
        count: of all cases.
        seed: of the mutations.
        kinds: of files.
        workers: processes at the same time; one for each processor if None.
    """
    cases = [(kinds[k % len(kinds)], k // len(kinds)) for k in range(count)]
    yield from run_all(cases, seed, workers)


def run_all(cases: Sequence[Case], seed: int, workers: int | None = None) -> Iterator[Outcome]:
    """Yield what becomes of the cases named."""
    with tempfile.TemporaryDirectory() as folder:
        for kind in {kind for kind, _ in cases}:
            (Path(folder) / kind).mkdir()
            KINDS[kind].seeds(Path(folder) / kind)
        yield from run_cases(cases, Path(folder), seed, workers or os.cpu_count() or 1)


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the counts by kind, and every case that failed."""
    counts = {
        kind: dict(Counter(one.end for one in outcomes if one.kind == kind)) for kind in KINDS
    }
    failed = [asdict(one) for one in outcomes if one.end in FAILURES]
    return {
        "cases": len(outcomes),
        "ends": dict(Counter(one.end for one in outcomes)),
        "kinds": {kind: found for kind, found in counts.items() if found},
        "longest_s": max((one.seconds for one in outcomes), default=0.0),
        "most_memory_mb": max((one.memory for one in outcomes), default=0) / 1e6,
        "failed": failed,
    }


def describe(found: dict[str, Any]) -> str:
    """Return the counts for people."""
    ends = ("read", "refused", *FAILURES)
    lines = [f"{'':10s}" + "".join(f"{end:>11s}" for end in ends)]
    for kind, counts in {**found["kinds"], "all": found["ends"]}.items():
        lines.append(f"{kind:10s}" + "".join(f"{counts.get(end, 0):11d}" for end in ends))
    lines.append(
        f"longest {found['longest_s']:.1f} s of processor time, most memory "
        f"{found['most_memory_mb']:.0f} MB beyond what the process held"
    )
    for one in found["failed"]:
        lines.append(f"--only {one['kind']}:{one['number']}  {one['end']}: {one['words'].strip()}")
    return "\n".join(lines)


def main() -> int:
    """Run the cases asked for until Ctrl-C, print the counts; return 1 if one failed."""
    options = _parse()
    if options.only:
        cases = [
            (kind, int(number)) for kind, _, number in (o.partition(":") for o in options.only)
        ]
        running = run_all(cases, options.seed, options.workers)
    else:
        running = fuzz(options.count, options.seed, options.kinds, options.workers)
    outcomes = []
    with suppress(KeyboardInterrupt):
        for outcome in running:
            outcomes.append(outcome)
            if outcome.end in FAILURES and not options.json:
                last = outcome.words.strip().splitlines()[-1]
                print(f"{outcome.kind}:{outcome.number} {outcome.end}: {last}", flush=True)
    found = summary(outcomes)
    print(json.dumps(found) if options.json else describe(found))
    return 1 if found["failed"] else 0


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="of all files (default 10000)")
    parser.add_argument("--seed", type=int, default=0, help="of the mutations (default 0)")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=[*KINDS], metavar="KIND")
    parser.add_argument("--only", nargs="+", metavar="KIND:NUMBER", help="cases, as named")
    parser.add_argument("--workers", type=int, help="processes at once (default: all CPUs)")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser.parse_args()
