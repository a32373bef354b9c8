"""What was aimed at beside what was measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

Row = tuple[str, str, str, bool]
"""Quantity, aim, measured, whether the aim is met."""


def judge(results: dict[str, Any]) -> list[Row]:
    """Rows of all sections present in the results."""
    judges: dict[str, Callable[[dict[str, Any]], Iterator[Row]]] = {
        "table_one": _table_one,
        "four_fingers": _four_fingers,
        "feasibility": _feasibility,
        "coverage": _coverage,
        "live": _live,
        "batch_time": _batch_time,
        "excitation": _excitation,
        "in_hand": _in_hand,
    }
    return [row for name, of in judges.items() if name in results for row in of(results[name])]


def _at_most(name: str, aim: float, value: float, unit: str = "") -> Row:
    return name, f"<= {aim:g}{unit}", f"{value:.3g}{unit}", value <= aim


def _table_one(result: dict[str, Any]) -> Iterator[Row]:
    rows = result["rows"]
    for variance, aim in (("0.0", 0.1), ("1.0", 0.35)):
        if variance not in rows:
            continue
        found = rows[variance]["methods"]["ours (batch)"]["trace_error"]
        yield _at_most(f"Table I, variance {variance}: Eq. 34", aim, found)
    ratios = [
        max(row["ratio_to_bound"].values()) for row in rows.values() if row["bound"]["com_mm"]
    ]
    if ratios:
        yield _at_most("Table I: worst ratio to the Cramer-Rao bound", 1.3, max(ratios))


def _four_fingers(result: dict[str, Any]) -> Iterator[Row]:
    found = result["methods"]["ours (batch)"]
    yield _at_most("four fingers: affine-invariant distance", 0.09, found["distance"])
    yield _at_most("four fingers: mass", 0.1, found["mass_percent"], " %")
    yield _at_most("four fingers: centre of mass", 0.08, found["com_mm"], " mm")
    limit = result["bounds"]["frame from poses"]["rms_ratio"]
    for key, title in (("distance", "all ten"), ("mass_percent", "mass"), ("com_mm", "centre")):
        name = f"four fingers: error / bound, RMS over recordings, {title}"
        yield _at_most(name, 1.2, limit[key])


def _feasibility(result: dict[str, Any]) -> Iterator[Row]:
    rows = result["situations"].values()
    published, feasible = (sum(row[key] for row in rows) for key in ("published", "feasible"))
    yield (
        "published estimates that can exist",
        "100 %",
        f"{feasible} of {published}",
        feasible == published,
    )


def _coverage(result: dict[str, Any]) -> Iterator[Row]:
    for kind in ("batch", "live"):
        if result[kind]:
            low, high = min(result[kind].values()), max(result[kind].values())
            text = f"{100 * low:.0f} to {100 * high:.0f} %"
            met = low >= 0.85 and high <= 0.95
            yield f"90 % intervals that hold, {kind}, each parameter", "85 to 95 %", text, met
    misfit = result["misfit"]
    low = min(misfit["coverage"].values())
    name = "the same with a hidden 20 % force scale, least of all parameters"
    yield name, ">= 85 %", f"{100 * low:.0f} %", low >= 0.85
    growth = misfit["interval_growth_smallest"]
    yield "smallest growth of an interval then", ">= 1", f"{growth:.2f}", growth >= 1.0


def _live(result: dict[str, Any]) -> Iterator[Row]:
    name = f"live update, 99 % of {result['updates']}, processor time"
    yield _at_most(name, 5.0, result["cpu_ms"]["p99"], " ms")
    if result.get("undisturbed", {}).get("ms"):
        name = "live update, 99 % of those that no other program interrupted"
        yield _at_most(name, 5.0, result["undisturbed"]["ms"]["p99"], " ms")
    name = "live update, last over first decile"
    yield _at_most(name, 1.15, result["last_over_first_decile"])
    memory = result["memory_mib"]
    name = "memory, peak over that after a tenth"
    yield _at_most(name, 1.05, memory["peak"] / memory["after_first_tenth"])


def _batch_time(result: dict[str, Any]) -> Iterator[Row]:
    yield _at_most("batch of 30 s, median, processor time", 3.0, result["cpu_s"]["median"], " s")


def _excitation(result: dict[str, Any]) -> Iterator[Row]:
    gain = result["gain"]["free"]
    name = "designed motion: distance, fixed sines over designed"
    yield name, "> 1", f"{gain:.2f}", gain > 1.0


def _in_hand(result: dict[str, Any]) -> Iterator[Row]:
    for key, aim, unit, title in (
        ("mass_percent", 2.0, " %", "mass"),
        ("com_mm", 2.0, " mm", "centre of mass"),
    ):
        worst = max(row["ours"][key] for row in result["rows"] if row["ours"])
        yield _at_most(f"in hand, worst object: {title}", aim, worst, unit)
