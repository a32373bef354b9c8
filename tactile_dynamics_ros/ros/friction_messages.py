"""Estimates of friction as messages."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.core.friction.estimate import FrictionEstimate
from tactile_dynamics_ros.ros.diagnostics import status_message, status_values


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


def friction_range(message: DiagnosticStatus) -> tuple[float, float] | None:
    """Return the least and the largest coefficient that a final estimate allows, or None.

    They are the ends of all regions' intervals: which region a finger touches is not known.
    """
    values = status_values(message)
    ends = [float(v) for key, v in values.items() if key.endswith((".low", ".high"))]
    return (min(ends), max(ends)) if values.get("final") == "True" and ends else None
