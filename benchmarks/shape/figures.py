"""Cloud, surfaces and entropy after each look, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.shape.trial import Array, run_trial
from tactile_dynamics_ros.core.shape.superquadric.scene import Scene

SHOWN = 600
"""Points drawn of a cloud; more hide the surface."""


def draw(numbers: Sequence[int], path: Path) -> None:
    """Draw objects (a row each, a column per look): points, and the surface by its entropy."""
    rows: list[list[tuple[Array, Scene]]] = []
    for number in numbers:
        looks: list[tuple[Array, Scene]] = []
        run_trial(number, watch=lambda points, scene, looks=looks: looks.append((points, scene)))
        rows.append(looks)
    columns = max(len(looks) for looks in rows)
    figure = plt.figure(figsize=(3.2 * columns, 3.0 * len(rows)))
    for k, (number, looks) in enumerate(zip(numbers, rows, strict=True)):
        for j, (points, scene) in enumerate(looks):
            axes = figure.add_subplot(len(rows), columns, k * columns + j + 1, projection="3d")
            dots = show(axes, points, scene)
            mean = scene.entropies[0].mean
            axes.set_title(f"object {number}, look {j + 1}: entropy {mean:.2f}", fontsize=9)
    bar = figure.add_axes((0.35, 0.04, 0.3, 0.015))
    figure.colorbar(dots, cax=bar, orientation="horizontal", label="entropy of the surface (bits)")
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)


def show(axes: plt.Axes, points: Array, scene: Scene) -> matplotlib.collections.PathCollection:
    """Draw one scene, in mm about the middle of its surface; return the coloured dots."""
    entropy = scene.entropies[0]
    middle = entropy.points.mean(axis=0)
    reach = 1e3 * float(np.abs(entropy.points - middle).max())
    chosen = points[np.linspace(0, len(points) - 1, SHOWN).astype(int)]
    near = chosen[np.all(np.abs(chosen - middle) < 1e-3 * reach, axis=1)]
    axes.scatter(*(1e3 * (near - middle)).T, s=1.0, c="0.4")
    surface = 1e3 * (entropy.points - middle)
    dots = axes.scatter(*surface.T, s=4.0, c=entropy.entropy, cmap="viridis", vmin=0.0, vmax=1.0)
    for limit in (axes.set_xlim, axes.set_ylim, axes.set_zlim):
        limit(-reach, reach)
    axes.tick_params(labelsize=6)
    return dots
