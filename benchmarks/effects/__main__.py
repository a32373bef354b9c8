"""Does the diagnosis find what recordings hide, and say when it cannot?"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.effects.cases import (
    REPORT_START,
    SENSOR_SETS,
    Case,
    plan,
    plan_quick,
    with_sensors,
)
from benchmarks.effects.figures import draw_confusion, draw_thresholds
from benchmarks.effects.grading import count_confusions, grade, is_in_group
from benchmarks.effects.running import run_all

RECORDS = Path("out/bench_effects/records.jsonl")
IMAGES = Path("docs/figures")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, grade everything, print and draw."""
    options = _parse(arguments)
    records = run_all(_choose_cases(options), options.records, options.workers)
    summary = grade(records)
    if options.images:
        draw_confusion(count_confusions(records), options.images / "effects_confusion.png")
        singles = [r for r in records if r["kind"] == "single" and "crash" not in r]
        draw_thresholds(singles, is_in_group, options.images / "effects_thresholds.png")
    print(json.dumps(summary) if options.json else describe(summary))
    return 0


def describe(summary: dict[str, Any]) -> str:
    """The summary for people, with the required rate beside each line."""
    clean, single, calm, ambiguous, pairs, outside = (
        summary[key] for key in ("clean", "single", "calm", "ambiguous", "pairs", "outside")
    )
    seconds = summary["seconds"]
    lines = [
        _line("clean: adequate", clean["adequate"], clean["count"], ">= 95 %"),
        _line("clean: compare says adequate", clean["compare_adequate"], clean["count"], ""),
        _line("single: right name alone", single["right_alone"], single["count"], ">= 85 %"),
        _line("single: no group beside it", single["right_without_group"], single["count"], ""),
        _line("single: right name or group", single["right_or_group"], single["count"], ">= 95 %"),
        _line("single: worst effect", single["worst_effect_right_or_group"], None, ">= 70 %"),
        _line("single: error within 1.1 floor", single["error_at_floor"], None, ">= 90 %"),
        _line("single: parameter in its 95 %", single["coverage"], None, "90-98 %"),
        _line("calm: right name or group", calm["right_or_group"], calm["count"], ""),
        _line("groups: motion proposed", _ratio(ambiguous), ambiguous["count"], ""),
        _line("groups: resolved by it", ambiguous["resolved"], ambiguous["planned"], ">= 80 %"),
        _line("pairs: both in two steps", pairs["both_within_two"], pairs["count"], ""),
        _line("pairs: both in three steps", pairs["both_within_three"], pairs["count"], ">= 75 %"),
        _line("outside: unexplained", outside["unexplained"], outside["count"], ">= 85 %"),
        _line("outside: named wrongly", outside["wrong_name"], outside["count"], ""),
        _line("outside: unexplained, or 95 % of it is", outside["honest"], None, ">= 90 %"),
        _line("outside: frequency to 2 %", outside["frequency_within_two_percent"], None, ""),
        _line("outside: right channel first", outside["right_channel"], None, ""),
        f"diagnose: median {_number(seconds['diagnose_median'])} s, at most "
        f"{_number(seconds['diagnose_max'])} s; compare: {_number(seconds['compare_median'])} s",
        f"crashes: {len(summary['crashes'])}; effects too weak for their object: "
        f"{summary['out_of_reach']}",
        "",
        f"{'effect':18s} {'n':>3s} {'alone':>6s} {'group':>6s} {'cover':>6s} "
        f"{'before':>6s} {'from':>5s}  called",
    ]
    for name, entry in single["effects"].items():
        if not entry["count"]:
            continue
        called = ", ".join(f"{label} {count}" for label, count in entry["called"].items())
        lines.append(
            f"{name:18s} {entry['count']:3d} {_percent(entry['right_alone'])} "
            f"{_percent(entry['right_or_group'])} {_percent(entry['coverage'])} "
            f"{_number(entry['median_error_before']):>6s} "
            f"{_number(summary['thresholds'][name]):>5s}  {called}"
        )
    for name, called in outside["effects"].items():
        labels = ", ".join(f"{label} {count}" for label, count in called.items())
        lines.append(f"{name:18s} {sum(called.values()):3d} {labels}")
    return "\n".join(lines)


def _choose_cases(options: argparse.Namespace) -> list[Case]:
    if options.quick:
        cases = plan_quick(options.start)
    else:
        cases = plan(
            options.start,
            options.seeds,
            options.clean,
            options.pairs,
            options.outside,
            options.calm,
        )
    wanted = set(options.only or [])
    cases = [case for case in cases if not wanted or wanted & {case.kind, *case.effects}]
    cases = [case for case in cases if not options.levels or case.level in options.levels]
    if options.sensors is None:
        return cases
    return with_sensors(cases, options.sensors or tuple(SENSOR_SETS))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench effects", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few short recordings, about 30 s")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    parser.add_argument("--seeds", type=int, default=4, help="recordings per effect and size")
    parser.add_argument("--clean", type=int, default=60, help="recordings without an effect")
    parser.add_argument("--pairs", type=int, default=32, help="recordings with two effects")
    parser.add_argument("--outside", type=int, default=3, help="recordings per unknown effect")
    parser.add_argument("--calm", type=int, default=2, help="calm recordings per effect")
    parser.add_argument("--start", type=int, default=REPORT_START, help="first seed")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--only", nargs="*", help="kinds or effects, for example clean force_bias")
    parser.add_argument("--levels", nargs="*", type=float, help="only these sizes")
    parser.add_argument(
        "--sensors",
        nargs="*",
        choices=tuple(SENSOR_SETS),
        help="sensors of other laboratories, these or all of them in turn",
    )
    parser.add_argument(
        "--records", type=Path, default=RECORDS, help="file that is continued (one line per case)"
    )
    parser.add_argument("--images", type=Path, default=None, help=f"where to draw, e.g. {IMAGES}")
    return parser.parse_args(arguments)


def _line(what: str, share: float | None, count: int | None, wanted: str) -> str:
    number = f"({count})" if count is not None else ""
    return f"{what:32s} {_percent(share)} {number:7s} {wanted}"


def _ratio(ambiguous: dict[str, Any]) -> float | None:
    return ambiguous["planned"] / ambiguous["count"] if ambiguous["count"] else None


def _percent(share: float | None) -> str:
    return "   -  " if share is None else f"{100 * share:4.0f} %"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(main())
