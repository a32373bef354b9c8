"""What diagnose says of simulated pushes: clean ones, hidden effects, and what no catalogue has."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from benchmarks.pushed import linked
from benchmarks.support.pushing_robot import simulate_pushes
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.numerics.regime import split_label
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTableConfig
from tactile_dynamics_ros.synthetic import pushed

CLEAN = "none"
"""Stands for recordings in which nothing is hidden."""
_PUSHES = 4
"""Pushes of two parts, two on each: they turn a joint and go four ways."""
_MAGNITUDE, _IN_REGIME = 1.35, 2.0
"""Multiples of the typical size at which effects are hidden, as for held objects, and inside a
regime."""
_ON_TABLE = tuple(range(121, 133))
"""Objects of one part in config/planar_objects.yaml that are made for tests."""
_FAR = pushed.ActionOptions(count=8, travel=0.2, duration=3.0, speed=(0.05, 0.2))
"""Pushes that go over a border and back, where something acts beyond it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    known = (CLEAN, *pushed.CATALOGUE, *pushed.OUTSIDE)
    choices = (*known, *pushed.JOINTED, *pushed.REGIONAL)
    parser.add_argument("--diagnosed", nargs="+", choices=choices, default=list(known))
    parser.add_argument("--diagnosis-seeds", type=int, nargs="+", default=[210, 211, 212])
    parser.add_argument("--variations", type=float, nargs="+", default=[0.0, 0.05])
    parser.add_argument(
        "--diagnosed-kind",
        choices=("single", "table", *linked.KINDS),
        default="single",
        help="one part; one part on the simulated table of the nodes; or two parts",
    )


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Verdicts of every effect, seed and variation of friction."""
    names, seeds = options.diagnosed, options.diagnosis_seeds
    if options.quick:
        names, seeds = [CLEAN, "support_tilt"], seeds[:1]
    rows = []
    for variation, name, seed in product(options.variations, names, seeds):
        row = _row(name, seed, variation, options.diagnosed_kind)
        said = row.get("effect") or row.get("verdict") or row["refused"]
        print(f"{name}, seed {seed}, variation {variation:g}: {said}", file=sys.stderr, flush=True)
        rows.append(row)
    return {"rows": rows, "magnitude": _MAGNITUDE}


def _row(name: str, seed: int, variation: float, kind: str) -> dict[str, Any]:
    size = _IN_REGIME if name in pushed.REGIONAL else _MAGNITUDE
    hidden = {} if name == CLEAN else {name: size}
    if kind == "table":
        streams, truth = _on_table(name, seed, variation)
    else:
        if kind == "single":
            far = {"actions": _FAR} if name in pushed.REGIONAL else {}
            options = pushed.PushOptions(variation=variation, **far)
            made = pushed.generate([seed], hidden, options)[0]
        else:
            made = linked.recorded([seed], kind, _PUSHES, True, variation, hidden=hidden)[0][0]
        streams, truth = made.streams, made.truth()["effects"]
    row: dict[str, Any] = {"hidden": name, "seed": seed, "variation": variation}
    start = time.process_time()
    try:
        model = PushDiscrepancy.of_streams(streams)
        row["rms"] = float(np.sqrt(np.mean(model.residual**2)))
        found = diagnose(model)
    except TactileDynamicsError as error:
        return row | {"refused": str(error), "cpu_s": time.process_time() - start}
    named = found.explained_model.parameters() if found.effect else {}
    return row | {
        "cpu_s": time.process_time() - start,
        "stated_variation": [model.table.along, model.table.field, model.table.length],
        "verdict": found.verdict,
        "effect": found.effect,
        "group": list(found.group),
        "before": found.before.rms,
        "after": found.after.rms,
        "floor": found.floor,
        "parameters": named,
        "truth": {k: v["parameters"] for k, v in truth.items()},
    }


def _on_table(name: str, seed: int, variation: float) -> tuple[PushedStreams, dict[str, Any]]:
    """Six pushes on the table of PyBullet that the nodes are tried on, markers at 100 Hz."""
    config = SimulatedTableConfig(
        seed=seed,
        object_number=_ON_TABLE[seed % len(_ON_TABLE)],
        friction_spread=variation,
        hidden_effect="none" if name == CLEAN else name,
        hidden_magnitude=_MAGNITUDE,
        hidden_time=0.0,
    )
    made = simulate_pushes(config)
    hidden = {} if name == CLEAN else {name: made.truth["hidden_effect"]}
    return made.streams, hidden


def _is_right(row: dict[str, Any]) -> bool:
    """Whether a verdict is true: the name or its group; adequate; or unexplained."""
    if row["hidden"] == CLEAN:
        return bool(row.get("verdict") == "adequate")
    if row["hidden"] in pushed.OUTSIDE:
        return bool(row.get("verdict") == "unexplained")
    return _true_name(row) in map(_plain, (row.get("effect"), *row.get("group", ())))


def _true_name(row: dict[str, Any]) -> str:
    hidden: str = row["hidden"]
    return pushed.REGIONAL[hidden][0] if hidden in pushed.REGIONAL else hidden


def _plain(name: str | None) -> str:
    """Name of an effect without its regime."""
    return split_label(name)[0] if name else ""


def table(found: dict[str, Any]) -> str:
    """Counts of every effect as Markdown."""
    lines = ["| hidden | variation | n | true | alone | verdicts | error | CPU s |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    cases = {(row["variation"], row["hidden"]): None for row in found["rows"]}
    for variation, name in cases:
        rows = [r for r in found["rows"] if (r["variation"], r["hidden"]) == (variation, name)]
        right = sum(map(_is_right, rows))
        alone = sum(_plain(r.get("effect")) == _true_name(r) and not r["group"] for r in rows)
        lines.append(
            f"| `{name}` | {variation:g} | {len(rows)} | {right} | {alone or ''} | "
            f"{_verdicts(rows)} | {_errors(rows)} | {np.median([r['cpu_s'] for r in rows]):.0f} |"
        )
    return "\n".join(lines)


def _verdicts(rows: Sequence[dict[str, Any]]) -> str:
    said = [r.get("effect") or r.get("verdict") or "refused" for r in rows]
    return ", ".join(f"{said.count(word)} {word}" for word in sorted(set(said)))


def _errors(rows: Sequence[dict[str, Any]]) -> str:
    told = [r for r in rows if "before" in r]
    if not told:
        return ""
    before, after = (
        float(np.median([r[k] / r["floor"] for r in told])) for k in ("before", "after")
    )
    return f"{before:.2f} to {after:.2f}"
