"""The box plots of the study: estimates with the truth, and errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from benchmarks.friction.subjects import SUBJECTS


def draw_study(rows: list[dict[str, Any]], path: Path) -> Path:
    """Draw estimated coefficients and their errors per object.

    Coefficients are drawn anew for every hand, so the upper plot shows each estimate joined with
    its truth instead of one red cross per object.

    Source: paper A, Fig. 6 (layout).
    """
    figure, (above, below) = plt.subplots(2, 1, figsize=(8.0, 5.6), sharex=True)
    errors = []
    for place, subject in enumerate(SUBJECTS):
        own = [r for r in rows if r["subject"] == subject.name and "estimate" in r]
        for k, row in enumerate(own):
            at = place + 0.06 * (k - 0.5 * (len(own) - 1))
            low, high = row["estimate"]["interval"]
            above.plot([at, at], [low, high], color="0.6", linewidth=1.0)
            above.plot(at, row["estimate"]["static"], "o", color="tab:blue", markersize=3)
            above.plot(at, row["true_static"], "x", color="tab:red", markersize=5)
        errors.append([r["true_static"] - r["estimate"]["static"] for r in own] or [float("nan")])
    above.set_ylabel("coefficient of friction")
    below.axhline(0.0, color="0.8", linewidth=1.0)
    below.boxplot(errors, positions=range(len(SUBJECTS)), widths=0.5)
    below.set_ylabel("truth - estimate")
    below.set_xticks(range(len(SUBJECTS)), [s.name for s in SUBJECTS], rotation=35, ha="right")
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return path
