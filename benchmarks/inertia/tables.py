"""The results as Markdown tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.inertia.accuracy import PUBLISHED_EQ_34
from benchmarks.inertia.verdicts import judge

WITHIN = "within_3_percent_and_3_mm"


def render(results: dict[str, Any]) -> str:
    """All sections present in the results."""
    writers = {
        "table_one": _table_one,
        "four_fingers": _four_fingers,
        "coverage": _coverage,
        "early": _early,
        "feasibility": _feasibility,
        "live": _live,
        "batch_time": _batch_time,
        "excitation": _excitation,
        "wrist_ft": _wrist,
        "in_hand": _in_hand,
        "hand_intervals": _hand_intervals,
    }
    parts = [write(results[name]) for name, write in writers.items() if name in results]
    return "\n\n".join([_verdicts(results), *parts])


def _verdicts(results: dict[str, Any]) -> str:
    lines = [[*row[:3], "yes" if row[3] else "**no**"] for row in judge(results)]
    return "### Aims\n\n" + _table(["", "aim", "measured", "met"], lines)


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


_MEASURES = (
    ("trace_error", "Eq. 34", 3),
    ("distance", "affine-inv. distance", 4),
    ("mass_kg", "mass, kg", 5),
    ("com_mm", "CoM, mm", 3),
    ("inertia", "inertia, kg m^2", 6),
)


def _method_row(name: str, found: dict[str, float]) -> list[str]:
    values = [f"{found[key]:.{digits}f}" for key, _, digits in _MEASURES]
    spent = f"{found['seconds']:.2f}" if found["seconds"] else ""
    return [name, *values, f"{100 * found['feasible']:.0f} %", spent]


_METHOD_HEADER = ["method", *(title for _, title, _ in _MEASURES), "feasible", "CPU s"]


def _table_one(result: dict[str, Any]) -> str:
    text = [
        f"### Table I scenario (medians of {result['seeds']} seeds, live of "
        f"{result['live_seeds']}, paper's methods of {result['published_seeds']} with "
        f"{result['triples']} pose triples)"
    ]
    for variance, row in result["rows"].items():
        lines = [_method_row(name, found) for name, found in row["methods"].items()]
        limit = row["bound"]
        lines.append(
            [
                "Cramer-Rao bound",
                f"{limit['trace_error']:.3f}",
                f"{limit['distance']:.4f}",
                f"{limit['mass_percent'] * 0.013:.5f}",
                f"{limit['com_mm']:.3f}",
                "",
                "",
                "",
            ]
        )
        text.append(f"Force noise variance {variance} N^2\n\n" + _table(_METHOD_HEADER, lines))
    printed = ", ".join(f"{name} {value}" for name, value in PUBLISHED_EQ_34.items())
    text.append(f"The paper's own Table I scores, by Eq. 34: {printed}.")
    return "\n\n".join(text)


def _four_fingers(result: dict[str, Any]) -> str:
    lines = [_method_row(name, found) for name, found in result["methods"].items()]
    names = ("distance", "mass_percent", "com_mm")
    reachable, exact = (result["bounds"][key] for key in ("frame from poses", "motion known"))
    errors = (
        ("Cramer-Rao bound, body frame known through its poses", reachable["errors"]),
        ("Cramer-Rao bound, motion and body frame known exactly", exact["errors"]),
        ("ours (batch)", result["methods"]["ours (batch)"]),
        ("bound of poses without contacts", result["bound_of_poses_alone"]),
        ("ours (batch), poses alone", result["methods"]["ours (batch), poses alone"]),
    )
    everything = "RMS over recordings (distance: all ten parameters)"
    ratios = (
        (f"ours / bound with the frame through poses, {everything}", reachable["rms_ratio"]),
        ("the same, medians", reachable["ratio"]),
        (f"ours / bound with all known, {everything}", exact["rms_ratio"]),
        ("the same, medians", exact["ratio"]),
        (
            "ours, poses alone / bound of poses without contacts, medians",
            result["unaided_to_its_bound"],
        ),
    )
    limits = [[title, *(f"{row[name]:.4f}" for name in names)] for title, row in errors]
    limits += [[title, *(f"{row[name]:.2f}" for name in names)] for title, row in ratios]
    return (
        f"### Four fingers, 30 s, 0.03 N, 0.5 mm, 0.2 deg, 100 Hz (medians of {result['seeds']} "
        f"recordings; peers of {result['peer_seeds']}, live of {result['live_seeds']})\n\n"
        + _table(_METHOD_HEADER, lines)
        + "\n\n"
        + _table(["", "distance", "mass, %", "CoM, mm"], limits)
        + f"\n\nThe bound's own median distance is {exact['errors']['distance']:.3f}: from 30 s of "
        "such motion half of these objects cannot be known better. A median of one number, such as "
        f"the mass, over {result['seeds']} recordings scatters by "
        f"{117 / result['seeds'] ** 0.5:.0f} % around its expectation."
    )


def _coverage(result: dict[str, Any]) -> str:
    misfit = result["misfit"]
    kinds = misfit["coverage_by_kind"]
    lines = [
        [
            name,
            f"{100 * result['batch'][name]:.0f} %",
            f"{100 * result['live'][name]:.0f} %" if result["live"] else "",
            f"{misfit['interval_growth_median'][name]:.1f}",
            f"{100 * misfit['coverage'][name]:.0f} %",
            *(f"{100 * part[name]:.0f} %" for part in kinds.values()),
        ]
        for name in result["batch"]
    ]
    header = ["parameter", "batch", "live", "growth under misfit", "coverage under misfit"]
    header += [f"{kind.replace('_', ' ')} ({part['runs']})" for kind, part in kinds.items()]
    scatter = [
        f"{30 / result[key] ** 0.5:.0f} % over {result[key]} runs" for key in ("runs", "live_runs")
    ]
    return (
        f"### 90 % intervals that hold the truth ({result['runs']} batch and {result['live_runs']} "
        f"live runs of {result['duration_s']} s; misfit: one finger reads 20 % wrong, "
        f"or all by 8 to 20 % of either sign, {misfit['runs']} runs, whitened RMS "
        f"{misfit['whitened_rms_median']:.1f})\n\n"
        + _table(header, lines)
        + f"\n\nBy chance a share of 90 % scatters by {scatter[0]}, {scatter[1]}."
    )


def _early(result: dict[str, Any]) -> str:
    lines = [
        [
            f"{row['from_s']:g} to {row['to_s']:g} s",
            str(row["told"]),
            f"{100 * row['held']:.0f} %" if row["told"] else "",
            f"{row['largest']:.1f} std" if row["told"] else "",
        ]
        for row in result["spans"]
    ]
    return f"### Live estimates of a grasp's first seconds ({result['runs']} runs)\n\n" + _table(
        ["after", "numbers told", "90 % intervals that hold", "largest error"], lines
    )


def _feasibility(result: dict[str, Any]) -> str:
    lines = [
        [name, str(row["published"]), str(row["feasible"])]
        for name, row in result["situations"].items()
    ]
    return f"### Published live estimates ({result['seeds']} seeds)\n\n" + _table(
        ["situation", "published", "feasible"], lines
    )


def _live(result: dict[str, Any]) -> str:
    lines = [
        [kind, *(f"{result[key][name]:.2f}" for name in ("p50", "p90", "p99", "max"))]
        for kind, key in (("CPU, ms", "cpu_ms"), ("wall clock, ms", "wall_ms"))
    ]
    other = result["alternatives"]
    growth = [
        ["plain iSAM2, one global variable", *_growth(other["plain_isam2"])],
        ["batch GTSAM solved again", *_growth(other["batch_resolved"])],
    ]
    steps = list(other["plain_isam2"]["ms_at_step"])
    memory = {name: f"{value:.0f} MiB" for name, value in result["memory_mib"].items()}
    return (
        f"### Live: {result['updates']} updates at 100 Hz, four fingers\n\n"
        + _table(["update", "median", "90 %", "99 %", "max"], lines)
        + f"\n\nLast over first decile: {result['last_over_first_decile']:.3f}. Memory "
        f"{memory['after_first_tenth']} after a tenth, {memory['last']} at the end, peak "
        f"{memory['peak']}. All estimates feasible: {result['all_feasible']}. "
        f"{_had_processor(result)}\n\n"
        + _table(
            ["alternative", *(f"ms at step {k}" for k in steps), "times ours", "distance"], growth
        )
    )


def _had_processor(result: dict[str, Any]) -> str:
    """How much of a core the run had, and what it needs when left alone."""
    share = result["cpu_ms"]["p50"] / result["wall_ms"]["p50"]
    text = f"The run had {100 * share:.0f} % of a core"
    if share < 0.9:
        text += "; caches that other programs had emptied count as its own time"
    alone = result.get("undisturbed", {})
    if alone.get("ms"):
        text += (
            f". The {100 * alone['share']:.0f} % of updates that nothing interrupted took "
            f"{alone['ms']['p50']:.2f} ms, 99 % of them at most {alone['ms']['p99']:.2f} ms"
        )
    return text + "."


def _growth(row: dict[str, Any]) -> list[str]:
    costs = [f"{value:.1f}" for value in row["ms_at_step"].values()]
    return [*costs, f"{row['over_ours_at_last']:.0f}", f"{row['distance']:.3f}"]


def _batch_time(result: dict[str, Any]) -> str:
    cpu, wall = result["cpu_s"], result["wall_s"]
    return (
        f"### Batch, 30 s recording ({result['recordings']} recordings)\n\n"
        f"CPU {cpu['median']:.2f} s (at most {cpu['max']:.2f} s), "
        f"wall clock {wall['median']:.2f} s (at most {wall['max']:.2f} s)."
    )


def _excitation(result: dict[str, Any]) -> str:
    lines = []
    for name, found in result["methods"].items():
        gain = f"{result['gain'][name]:.1f}" if name in result["gain"] else "1.0"
        lines.append(
            [
                name,
                f"{result['expected_distance'][name]:.3f}",
                f"{found['distance']:.3f}",
                f"{found['com_mm']:.3f}",
                f"{result['largest_grip_usage'][name]:.2f}",
                gain,
            ]
        )
    header = ["motion", "expected distance", "distance", "CoM, mm", "friction cone used", "gain"]
    return (
        f"### Excitation, {result['duration_s']} s, medians of {result['seeds']} objects\n\n"
        "The designer knows the inertia to about 30 %; all motions keep the same limits of arm and "
        "grip. The demo moves by such a design (`tactile-dynamics excite --object NAME`).\n\n"
        + _table(header, lines)
    )


def _wrist(result: dict[str, Any]) -> str:
    return (
        f"### Boxes on a wrist force/torque sensor, 30 s (medians of {result['seeds']}; paper: its "
        "Table II, C, No G)\n\n" + _box_table(result["rows"], ("paper", "ours"))
    )


def _in_hand(result: dict[str, Any]) -> str:
    return (
        f"### Boxes in the simulated hand, whole chain (medians of {result['seeds']}, live of "
        f"{result['live_seeds']}; paper: its Table IV, C, No G; the same method on one of our "
        "recordings)\n\n"
        + _box_table(result["rows"], ("paper", "paper's method here", "ours", "live"))
        + _single_runs(result)
        + _by_vision(result)
    )


def _hand_intervals(result: dict[str, Any]) -> str:
    kinds = ("live", "offline", "shaped_live", "shaped_offline")
    rows = [
        [motion, str(row["runs"])]
        + [f"{100 * row[k]['coverage']:.0f} %, {row[k]['largest']:.1f}" for k in kinds]
        + [f"{100 * row[f'alike_{k}']:.0f} %" for k in ("motion", "shape")]
        for motion, row in result.items()
    ]
    header = ["motion", "runs", *(kind.replace("shaped_", "with the shape, ") for kind in kinds)]
    return (
        "### Intervals of 90 % in the simulated hand that hold, and the largest error in standard "
        "deviations; standard deviations that are within 20 % of each other live and offline\n\n"
        + _table([*header, "alike", "alike with the shape"], rows)
    )


def _by_vision(result: dict[str, Any]) -> str:
    if "vision_rows" not in result:
        return ""
    return (
        "\n\nThe same grasps with the poses of vision alone (paper: its Table III):\n\n"
        + _box_table(result["vision_rows"], ("paper", "paper's method here", "ours", "live"))
    )


def _single_runs(result: dict[str, Any]) -> str:
    shares = [
        f"{row['object']} {100 * row[WITHIN]:.0f} %" for row in result["rows"] if WITHIN in row
    ]
    return f"\n\nSingle runs within 3 % and 3 mm: {', '.join(shares)}." if shares else ""


def _box_table(rows: list[dict[str, Any]], kinds: Sequence[str]) -> str:
    lines = []
    for row in rows:
        for kind in kinds:
            found = row[kind]
            if not found:
                continue
            values = (
                f"{found['trace_error']:.2f}",
                f"{found['distance']:.2f}",
                f"{found['mass_percent']:.2f}",
                f"{found['com_mm']:.2f}",
                f"{1e5 * found['inertia']:.1f}",
            )
            held = row["coverage"].get(kind)
            share = f"{100 * held:.0f} %" if held else ""
            lines.append([row["object"], kind, *values, share])
    header = ["object", "method", "Eq. 34", "distance", "mass, %", "CoM, mm"]
    return _table([*header, "inertia, 1e-5 kg m^2", "90 % intervals that hold"], lines)
