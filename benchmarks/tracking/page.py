"""The results as Markdown tables."""

from __future__ import annotations

from statistics import fmean, median, stdev
from typing import Any

LABELS = {
    "fused": "fused",
    "vision_only": "vision only",
    "kinematic_only": "kinematic only",
    "plain_icp": "plain frame-to-model ICP",
    "true_pose": "true poses",
}
SCORES = ("mass_percent", "com_mm", "trace_error", "distance")


def render(results: dict[str, Any]) -> str:
    """Return all sections as Markdown."""
    parts = []
    if "trackers" in results:
        parts += [_trackers(results), _objects(results), _timing(results["timing"])]
    if results.get("search"):
        parts.append(_search(results["search"]))
    if results.get("recovery"):
        parts.append(_recovery(results["recovery"]))
    if results.get("inertia"):
        parts.append(_inertia(results["inertia"]))
    if "inertia_fused" in results:
        parts.append(_fused(results["inertia_fused"], len(results["inertia"])))
    return "\n\n".join(parts)


def _trackers(results: dict[str, Any]) -> str:
    rows = [
        "| tracker | position, mm RMS | rotation, deg RMS | NEES | 95 % band |",
        "|---" * 5 + "|",
    ]
    for label, row in results["trackers"].items():
        low, high = row["nees_band_95"]
        nees = "-" if row["nees"] is None else f"{row['nees']:.1f}"
        rows.append(
            f"| {LABELS[label]} | {row['position_rms_mm']:.2f} | {row['rotation_rms_deg']:.2f} "
            f"| {nees} | {low:.1f} - {high:.1f} |"
        )
    return "\n".join(rows)


def _objects(results: dict[str, Any]) -> str:
    found = results["per_object"]
    rows = ["| object | fused, mm / deg / NEES | vision only | kinematic only |", "|---" * 4 + "|"]
    for k, name in enumerate(results["objects"]):
        cells = [
            f"{run['position_rms_mm']:.2f} / {run['rotation_rms_deg']:.2f} / {run['nees']:.1f}"
            for run in (found[label][k] for label in ("fused", "vision_only", "kinematic_only"))
        ]
        rows.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def _timing(timing: dict[str, float]) -> str:
    return (
        f"Processor time per image: median {timing['image_ms_median']:.0f} ms, 95 % "
        f"{timing['image_ms_95']:.0f} ms, longest (a search) {timing['image_ms_longest']:.0f} ms; "
        f"per kinematic update {timing['kinematic_ms_median']:.2f} ms."
    )


def _search(found: list[dict[str, Any]]) -> str:
    rows = [
        "| object | searches | not found in 3 s | wrong | median error, mm | largest, mm |",
        "|---" * 6 + "|",
    ]
    for run in found:
        rows.append(
            f"| {run['object']} | {run['searches']} | {run['failed']} | {run['wrong']} "
            f"| {_millimetres(run['median_mm'])} | {_millimetres(run['largest_mm'])} |"
        )
    return "\n".join(rows)


def _millimetres(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _recovery(found: list[dict[str, Any]]) -> str:
    rows = [
        "| disturbance | object | good again after, s | largest error, mm / deg | wrong, s "
        "| flagged, s | wrong and confident, s |",
        "|---" * 7 + "|",
    ]
    for run in found:
        rows.append(
            f"| {run['kind'].replace('_', ' ')} | {run['object']} | {run['recovery_s']:.2f} "
            f"| {run['largest_position_mm']:.1f} / {run['largest_rotation_deg']:.1f} "
            f"| {run['wrong_s']:.2f} | {run['flagged_s']:.2f} "
            f"| {run['confident_and_wrong_s']:.2f} |"
        )
    return "\n".join(rows)


def _inertia(found: list[dict[str, Any]]) -> str:
    """Medians over the runs of each object."""
    rows = [
        "| object | runs | poses from | mass, % | centre of mass, mm | Eq. 34 | distance |",
        "|---" * 7 + "|",
    ]
    for name in dict.fromkeys(run["object"] for run in found):
        runs = [run for run in found if run["object"] == name]
        for label in (key for key in runs[0] if key != "object"):
            scores = [run[label] for run in runs if "error" not in run[label]]
            cells = ["-"] * len(SCORES)
            if scores:
                cells = [f"{median(score[key] for score in scores):.2f}" for key in SCORES]
            rows.append(f"| {name} | {len(scores)} | {LABELS[label]} | " + " | ".join(cells) + " |")
    paired = [_paired(found, other) for other in ("kinematic_only", "true_pose")]
    return "\n\n".join(["\n".join(rows), *filter(None, paired)])


def _fused(summary: dict[str, Any], runs: int) -> str:
    low, high = summary["nees_band_95"]
    return (
        f"Fused poses of these {runs} runs: {summary['position_rms_mm']:.2f} mm and "
        f"{summary['rotation_rms_deg']:.2f} deg RMS, NEES {summary['nees']:.1f} "
        f"(95 % band {low:.1f} - {high:.1f})."
    )


def _paired(found: list[dict[str, Any]], other: str) -> str:
    """By how much errors with fused poses exceed those with others, over runs that have both."""
    both = ("fused", other)
    runs = [run for run in found if all("error" not in run.get(k, {"error": ""}) for k in both)]
    if len(runs) < 2:
        return ""
    terms = []
    for key, name in zip(
        SCORES, ("mass, %", "centre of mass, mm", "Eq. 34", "distance"), strict=True
    ):
        excess = [run["fused"][key] - run[other][key] for run in runs]
        spread = stdev(excess) / len(excess) ** 0.5
        terms.append(f"{name} {fmean(excess):+.2f} ± {spread:.2f}")
    return f"Fused over {LABELS[other]}, mean of {len(runs)} runs: " + ", ".join(terms) + "."
