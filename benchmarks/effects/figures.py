"""Pictures of the benchmark: what was called what, and from which size on effects are found."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from tactile_dynamics_ros.synthetic import CATALOGUE, OUTSIDE

_VERDICTS = ("adequate", "unexplained", "ambiguous", "failed")


def draw_confusion(table: dict[str, Counter[str]], path: Path) -> Path:
    """Draw rows (what was hidden) against columns (what the product said) in per cent."""
    rows = [name for name in ("nothing", *CATALOGUE, *OUTSIDE) if table.get(name)]
    said = {label for name in rows for label in table[name]}
    columns = [*CATALOGUE, *(verdict for verdict in _VERDICTS if verdict in said)]
    counts = np.array([[table[row][column] for column in columns] for row in rows], dtype=float)
    totals = np.array([max(sum(table[row].values()), 1) for row in rows])
    shares = 100 * counts / totals[:, None]
    figure, axes = plt.subplots(figsize=(0.42 * len(columns) + 4, 0.32 * len(rows) + 3))
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=130, aspect="auto")
    for row, column in zip(*np.nonzero(counts), strict=True):
        share = shares[row, column]
        colour = "white" if share > 70 else "black"
        axes.text(column, row, f"{share:.0f}", ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(columns)), columns, rotation=55, ha="right", fontsize=9)
    labels = [f"{row} ({total})" for row, total in zip(rows, totals, strict=True)]
    axes.set_yticks(range(len(rows)), labels, fontsize=9)
    first_outside = next((k for k, row in enumerate(rows) if row in OUTSIDE), len(rows))
    for edge in (rows.count("nothing"), first_outside):
        axes.axhline(edge - 0.5, color="0.3", linewidth=1)
    axes.axvline(len(CATALOGUE) - 0.5, color="0.3", linewidth=1)
    axes.set_xlabel("the diagnosis said")
    axes.set_ylabel("hidden in the recording (number of recordings)")
    axes.set_title("Share of recordings in per cent; a named group counts as its right member")
    return _save(figure, path)


def draw_thresholds(singles: list[dict[str, Any]], found: Any, path: Path) -> Path:
    """Draw the share of right answers against the size of each effect.

    Args:
        singles: records of single effects.
        found: tells whether a record's answer is right.
        path: of the picture.
    """
    levels = sorted({record["level"] for record in singles})
    shares = np.full((len(CATALOGUE), len(levels)), np.nan)
    for row, name in enumerate(CATALOGUE):
        for column, level in enumerate(levels):
            hits = [found(r) for r in singles if r["effects"][0] == name and r["level"] == level]
            if hits:
                shares[row, column] = 100 * np.mean(hits)
    figure, axes = plt.subplots(figsize=(1.1 * len(levels) + 3, 7))
    axes.imshow(shares, cmap="RdYlGn", vmin=0, vmax=100, aspect="auto")
    for row, column in np.argwhere(np.isfinite(shares)):
        axes.text(column, row, f"{shares[row, column]:.0f}", ha="center", va="center", fontsize=9)
    axes.set_xticks(range(len(levels)), [f"{level:g}" for level in levels])
    axes.set_yticks(range(len(CATALOGUE)), CATALOGUE, fontsize=9)
    axes.set_xlabel("whitened RMS to which the effect raises the error (1 = noise)")
    axes.set_title("Right name or honest group, per cent of recordings")
    return _save(figure, path)


def _save(figure: Any, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)
    return path
