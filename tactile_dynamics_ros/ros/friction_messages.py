"""Estimates of friction as messages."""

from __future__ import annotations

import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.core.friction.estimate import FrictionEstimate
from tactile_dynamics_ros.ros.diagnostics import status_message, status_values

NUMBERS = ("static", "std", "low", "high", "kinetic", "slips")
"""Keys of a region that are numbers."""


def estimate_status(
    found: dict[str, FrictionEstimate], final: bool, outcome: str
) -> DiagnosticStatus:
    """Return an estimate as message: keys `<region>.static`, `.low`, `.high`, `.kinetic` ..."""
    values: dict[str, object] = {"final": final, "regions": ",".join(found)}
    sentences = []
    for name, region in found.items():
        values |= {
            f"{name}.static": region.static,
            f"{name}.std": region.std,
            f"{name}.low": region.interval[0],
            f"{name}.high": region.interval[1],
            f"{name}.kinetic": region.kinetic,
            f"{name}.kinetic_std": region.kinetic_std,
            f"{name}.slips": region.slips,
            f"{name}.normal_moves": region.normal_moves,
        }
        low, high = region.interval
        sentence = f"{name}: {region.static:.3f} ({low:.3f} to {high:.3f})"
        sentences.append(sentence + ", its surface gives way" * region.normal_moves)
    moves = any(region.normal_moves for region in found.values())
    level = DiagnosticStatus.WARN if moves or outcome else DiagnosticStatus.OK
    text = "; ".join([*sentences, outcome] if outcome else sentences) or "no slip yet"
    return status_message("friction", values, level, text)


def estimate_document(values: dict[str, str], message: str) -> dict[str, Any]:
    """Return {"started", "message", "regions": {name: {"static", "interval", ...}}}."""
    regions = {}
    for name in [part for part in values.get("regions", "").split(",") if part]:
        number = {key: float(values[f"{name}.{key}"]) for key in NUMBERS}
        regions[name] = {
            "static": number["static"],
            "std": number["std"],
            "interval": [number["low"], number["high"]],
            "kinetic": None if number["kinetic"] != number["kinetic"] else number["kinetic"],
            "slips": int(number["slips"]),
            "normal_moves": values[f"{name}.normal_moves"] == "True",
        }
    return {"started": True, "message": message, "regions": regions}


def result_fields(regions: dict[str, Any]) -> dict[str, list[Any]]:
    """Return the arrays of the result of tactile_dynamics_msgs/Probe, one entry for each region."""
    found = list(regions.values())
    return {
        "regions": list(regions),
        "static_friction": [region["static"] for region in found],
        "std": [region["std"] for region in found],
        "low": [region["interval"][0] for region in found],
        "high": [region["interval"][1] for region in found],
        "kinetic": [math.nan if r["kinetic"] is None else r["kinetic"] for r in found],
    }


def friction_range(message: DiagnosticStatus) -> tuple[float, float] | None:
    """Return the least and the largest coefficient that a final estimate allows, or None.

    They are the ends of all regions' intervals: which region a finger touches is not known.
    """
    values = status_values(message)
    ends = [float(v) for key, v in values.items() if key.endswith((".low", ".high"))]
    return (min(ends), max(ends)) if values.get("final") == "True" and ends else None
