"""Does every verb answer as it did? Twenty-nine small recordings, five verbs each."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.golden.answers import answer, differences
from benchmarks.golden.recordings import RECORDINGS

FOLDER = Path(__file__).parent / "expected"


def expected(name: str) -> dict[str, Any]:
    """What was answered before."""
    document: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text())
    return document


def main(arguments: Sequence[str] | None = None) -> int:
    """Ask; print what differs. The exit code is 1 if anything does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=RECORDINGS, default=list(RECORDINGS))
    parser.add_argument("--write", action="store_true", help="keep these answers as expected")
    options = parser.parse_args(arguments)
    differing = 0
    for name in options.only:
        found = json.loads(json.dumps(answer(RECORDINGS[name]())))
        path = FOLDER / f"{name}.json"
        lines = sorted(differences(expected(name), found)) if path.exists() else ["new"]
        differing += bool(lines)
        print(f"{name}: {'as before' if not lines else f'{len(lines)} differences'}", flush=True)
        print("".join(f"  {line}\n" for line in lines), end="", flush=True)
        if options.write and lines:
            FOLDER.mkdir(exist_ok=True)
            path.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n")
    return int(differing > 0 and not options.write)
