"""Effects hidden in the simulated hand, diagnosed through raw counts of its fingertips.

The fingertips err by a few per cent, and the effects have the sizes that the simulator gives them
by itself, so that some are smaller than the errors of the sensors: then "adequate" is an honest
answer.

    python -m benchmarks.effects.in_hand --start 1000 --seeds 1
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.effects.product import ask_command
from benchmarks.effects.running import named_effects
from benchmarks.inertia.in_hand import record_in_hand
from benchmarks.kept import read_rows
from tactile_dynamics_ros.sim.hidden_effects import CATALOGUED, OUTSIDE
from tactile_dynamics_ros.synthetic.recordings import write_bag

RECORDS = Path("out/bench_effects/in_hand.jsonl")
_BOX = "box_0"


def main(arguments: Sequence[str] | None = None) -> int:
    """Record, diagnose, print one line each and the sums."""
    options = _parse(arguments)
    wanted = options.only or ["none", *CATALOGUED, *OUTSIDE]
    done = {(r["effect"], r["seed"]) for r in read_rows(options.records)}
    options.records.parent.mkdir(parents=True, exist_ok=True)
    for seed in range(options.start, options.start + options.seeds):
        for effect in wanted:
            if (effect, seed) not in done:
                record = diagnose_in_hand(effect, seed)
                print(describe(record), flush=True)
                with options.records.open("a") as file:
                    file.write(json.dumps(record) + "\n")
    print(summarise(read_rows(options.records)))
    return 0


def diagnose_in_hand(effect: str, seed: int) -> dict[str, Any]:
    """Grasp, lift and move a box with a hidden effect; diagnose what the topics carried."""
    streams, _, outcome = record_in_hand(_BOX, seed, hidden=effect)
    with tempfile.TemporaryDirectory() as folder:
        bag = str(write_bag(streams, Path(folder) / "recording"))
        answer = ask_command(["diagnose", bag])
    return {
        "effect": effect,
        "seed": seed,
        "outcome": outcome,
        "diagnosis": answer.json,
        "complaint": answer.complaint,
        "seconds": answer.seconds,
    }


def verdict_of(record: dict[str, Any]) -> str:
    """Right alone, right in a group, adequate, unexplained, wrong, or failed."""
    diagnosis = record["diagnosis"]
    if not diagnosis:
        return "failed"
    if diagnosis["verdict"] in ("adequate", "unexplained"):
        return str(diagnosis["verdict"])
    if record["effect"] not in named_effects(diagnosis):
        return "wrong"
    return "right alone" if diagnosis["verdict"] == "missing_effect" else "right in a group"


def describe(record: dict[str, Any]) -> str:
    """One line on one recording."""
    diagnosis = record["diagnosis"] or {}
    error = (diagnosis.get("error") or {}).get("before", float("nan"))
    called = ", ".join(named_effects(diagnosis)) or "-"
    return (
        f"{record['effect']:18s} {record['seed']:6d} error {error:5.2f}  "
        f"{verdict_of(record):16s} {called}  ({record['seconds']:.0f} s)"
    )


def summarise(records: Sequence[dict[str, Any]]) -> str:
    """Counts of the answers for clean recordings, catalogued effects and others."""
    groups = {"clean": ("none",), "catalogue": CATALOGUED, "not in it": OUTSIDE}
    lines = []
    for group, names in groups.items():
        counts = Counter(verdict_of(r) for r in records if r["effect"] in names)
        told = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
        lines.append(f"{group:10s} {sum(counts.values()):3d} recordings: {told}")
    return "\n".join(lines)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="benchmarks.effects.in_hand", description=__doc__)
    parser.add_argument("--start", type=int, default=1000, help="first seed")
    parser.add_argument("--seeds", type=int, default=1, help="recordings per effect")
    parser.add_argument("--only", nargs="*", help="effects, for example none viscous_drag")
    parser.add_argument("--records", type=Path, default=RECORDS, help="file that is continued")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
