"""Light objects probed while the hand holds them in the air."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.friction.subjects import SUBJECTS
from benchmarks.friction.trials import Case, holds_truth, run_cases

LIGHT = tuple(s for s in SUBJECTS if s.name in ("3D printed", "lego duplo"))
"""Those that this hand can lift (115 and 280 g)."""
FIRST_HAND = 1700


def run_lifted(hands: int, processes: int, cache: Path) -> list[dict[str, Any]]:
    """Probe both objects in the air with several hands, calibrated by presses but not on blocks."""
    cases = [Case(subject, FIRST_HAND + k, in_air=True) for k in range(hands) for subject in LIGHT]
    return run_cases(cases, processes, cache)


def summarise_lifted(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Errors, intervals that hold, drops, and how far the object was from where it began."""
    done = [row for row in rows if "estimate" in row]
    errors = [row["true_static"] - row["estimate"]["static"] for row in done]
    inside = [holds_truth(row) for row in done]
    return {
        "probes": len(rows),
        "with_estimate": len(done),
        "median_abs_error": float(np.median(np.abs(errors))) if done else None,
        "errors": errors,
        "interval_coverage": float(np.mean(inside)) if done else None,
        "drops": sum(row.get("dropped", False) for row in rows),
        "moved_mm": [row["moved_mm"] for row in rows if "moved_mm" in row],
        "ended_early": [row["outcome"] for row in rows if row["outcome"]],
    }
