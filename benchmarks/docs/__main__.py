"""Does every command and snippet of README and docs run as it stands?

Each page is followed from top to bottom in a folder of its own, with the files that its reader
brings; what it shows as output has to be printed, numbers aside.
"""

from __future__ import annotations

import json
import os
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.docs.pages import pages
from benchmarks.docs.session import Outcome, Session
from tactile_dynamics_ros.cli.domain import private_domain

_LAST_LINES = 5
"""Lines of output that are shown of a command that fails: the error, and what led to it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Follow the pages; print the table; return 1 if something failed."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="*", type=Path, help="README and all of docs if none")
    parser.add_argument(
        "--long",
        type=float,
        default=0.0,
        metavar="S",
        help="run also what takes minutes or hours, each for at most S seconds",
    )
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args(arguments)
    found = []
    for outcome in follow(options.pages or pages(), options.long):
        found.append(outcome)
        print(row(outcome), file=sys.stderr if options.json else sys.stdout, flush=True)
    failed = [one for one in found if one.failed]
    if options.json:
        print(json.dumps([asdict(one) | {"failed": one.failed} for one in found], indent=1))
    else:
        print("\n".join(summary(found)))
    return 1 if failed else 0


def follow(chosen: Sequence[Path], long_s: float) -> Iterator[Outcome]:
    """Follow pages one after the other, in a ROS domain of their own.

    Args:
        chosen: pages.
        long_s: s that a long command may run; 0 lists it only.
    """
    with private_domain():
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        environment = os.environ | {"PATH": path, "MPLBACKEND": "Agg"}
        for page in chosen:
            with TemporaryDirectory() as folder:
                yield from Session(page.resolve(), Path(folder), environment, long_s).follow()


def row(outcome: Outcome) -> str:
    """One line of the table."""
    code = "-" if outcome.exit is None else str(outcome.exit)
    mark = "FAILED " if outcome.failed else ""
    where = f"{outcome.page}:{outcome.line}"
    note = f"  [{mark}{outcome.note}]" if mark or outcome.note else ""
    return f"{where:28} exit {code:>3} {outcome.seconds:6.1f} s  {outcome.command}{note}"


def summary(found: Sequence[Outcome]) -> list[str]:
    """What failed, and how many commands ran."""
    lines = []
    for one in (one for one in found if one.failed):
        lines += ["", row(one), *(f"    {line}" for line in one.output.splitlines()[-_LAST_LINES:])]
    ran = sum(one.exit is not None for one in found)
    failed = sum(one.failed for one in found)
    return [*lines, "", f"{len(found)} commands and snippets: {ran} ran, {failed} failed"]
