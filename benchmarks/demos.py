"""Whole demos, each hidden effect and tables: exit, time, verdict, truth, how the error falls."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.cli.supervisor import verb_command
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import inertia_vector
from tactile_dynamics_ros.sim.hidden_effects import CATALOGUED, OUTSIDE

OBJECTS = (*range(121, 127), *range(133, 136), *range(145, 148))
"""Numbers of config/planar_objects.yaml kept for tests: six of one part, three of two parts, three
with a joint."""
LONGEST = 1500.0
"""s of real time until a demo is ended: five times what one takes on two idle cores."""
COLUMNS = ("demo", "exit", "s", "verdict", "named", "largest deviation, std", "before", "after")
"""Headings of the table; errors are in multiples of the stated noise."""


def main() -> int:
    """Play the demos and print a row for each.

    Returns:
        0 if every demo ended with 0, a report and no traceback.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=("held", "planar"), help="demos of one kind")
    parser.add_argument("--effects", nargs="*", default=("none", *CATALOGUED, *OUTSIDE))
    parser.add_argument("--objects", nargs="*", type=int, default=OBJECTS)
    parser.add_argument("--seed", type=int, default=1, help="of every demo (1)")
    parser.add_argument("--load", type=int, default=0, help="busy loops beside each demo (0)")
    parser.add_argument("--out", type=Path, required=True, help="folder; what is there is kept")
    parser.add_argument("--json", action="store_true", help="rows as JSON")
    options = parser.parse_args()
    rows = []
    shown = sys.stderr if options.json else sys.stdout
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}", file=shown)
    for name, words in _cases(options):
        row = play(options.out / name, [*words, "--seed", str(options.seed)], options.load)
        rows.append({"demo": name} | row)
        print(format_row(rows[-1]), file=shown, flush=True)
    if options.json:
        print(json.dumps(rows))
    return 0 if all(row["exit"] == 0 and row["report"] for row in rows) else 1


def _cases(options: argparse.Namespace) -> Iterator[tuple[str, list[str]]]:
    """Yield name and arguments of each demo."""
    if options.only != "planar":
        for effect in options.effects:
            yield f"held-{effect}", ["--hidden", effect]
    if options.only != "held":
        for number in options.objects:
            yield f"planar-{number}", ["--planar", "--object", str(number)]


def play(out: Path, words: Sequence[str], load: int = 0) -> dict[str, Any]:
    """Play one demo, or read what it left when it was played before; return its row.

    Args:
        out: folder of recording, report and logs; the row is kept beside it.
        words: arguments of `tactile-dynamics demo`.
        load: number of busy loops beside it.
    """
    kept = out.with_suffix(".json")
    if kept.exists():
        found: dict[str, Any] = json.loads(kept.read_text())
        return found
    out.parent.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    with busy(load):
        command = verb_command("demo", *words, "--json", "--out", str(out))
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST)
    document = json.loads(done.stdout) if done.returncode == 0 else {}
    row = {
        "exit": done.returncode,
        "seconds": round(time.monotonic() - started, 1),
        "report": bool(document) and Path(document["report"]).exists(),
        "traceback": "Traceback" in done.stderr,
        "last_line": (done.stderr.strip().splitlines() or [""])[-1],
    }
    row |= _of_table(document) if "--planar" in words else _of_hand(document)
    kept.write_text(json.dumps(row, indent=1))
    return row


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Let so many processes compute for nothing meanwhile."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def _of_hand(document: dict[str, Any]) -> dict[str, Any]:
    """Return verdict, names, errors, and how far estimates are off in standard deviations."""
    if not document:
        return _row("", [], None, None, None)
    story = document.get("explanation") or {}
    error, groups = story.get("error", {}), story.get("groups", {})
    return _row(
        str(story.get("verdict", "none")),
        [" or ".join(groups.get(name, [name])) for name in story.get("effects", [])],
        deviation(document["offline"], document["truth"]),
        error.get("before"),
        error.get("after"),
    ) | {"live": (document.get("diagnosis") or {}).get("verdict")}


def deviation(estimate: dict[str, Any], truth: dict[str, Any]) -> float:
    """Return the largest deviation of mass, centre of mass and inertia, in standard deviations.

    What the motion does not determine is left out.

    Args:
        estimate: document of `estimate`.
        truth: as the simulator reveals it.
    """

    def ten(numbers: Any) -> Any:
        mass, com, inertia = (numbers(name) for name in ("mass", "com", "inertia_com"))
        return np.array([mass, *com, *inertia_vector(np.array(inertia))])

    off = np.abs(ten(lambda n: estimate[n]["value"]) - ten(lambda n: truth[n]))
    known = [name not in estimate.get("undetermined", ()) for name in PARAMETER_NAMES]
    return float(np.max((off / ten(lambda n: estimate[n]["std"]))[known], initial=0.0))


def _of_table(document: dict[str, Any]) -> dict[str, Any]:
    """Return the same of a demo on a table."""
    if not document:
        return _row("", [], None, None, None)
    changed = document.get("changed") or {}
    found = changed.get("diagnosis") or {}
    named = [found["effect"]] if found.get("effect") else []
    known = [row for row in document["compared"] if not row["undetermined"]]
    off = [abs(row["value"] - row["truth"]) / row["std"] for row in known]
    return _row(
        str(found.get("verdict", "none")),
        named + [name for name in found.get("group", []) if name not in named],
        max(off) if off else None,
        changed.get("before"),
        changed.get("after"),
    )


def _row(
    verdict: str, named: list[str], off: float | None, before: float | None, after: float | None
) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "named": named,
        "largest_deviation": off,
        "before": before,
        "after": after,
    }


def format_row(row: dict[str, Any]) -> str:
    """Return a line of the table.

    Args:
        row: of `play`, with the name of the demo.
    """
    numbers = [
        "-" if row[key] is None else f"{row[key]:.2f}"
        for key in ("largest_deviation", "before", "after")
    ]
    cells = (row["demo"], row["exit"], f"{row['seconds']:.0f}", row["verdict"] or "-")
    named = ", ".join(row["named"]) or "-"
    return f"| {' | '.join(str(cell) for cell in (*cells, named, *numbers))} |"
