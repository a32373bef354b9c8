"""Figure of an object on a table: points and the surface through them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.report.style import BLUE, ORANGE, new_figure, thinning


def draw_shape(points: Array, surfaces: Sequence[tuple[Array, NDArray[np.intp]]]) -> Figure:
    """Draw points and triangulated surfaces in one frame, in mm.

    Args:
        points: (N, 3) m.
        surfaces: vertices (V, 3) m and faces (F, 3) of each part.
    """
    figure = new_figure(4.3, 5.5)
    axes = figure.add_subplot(projection="3d")
    shown = 1e3 * points[thinning(len(points))]
    axes.scatter(*shown.T, s=3, color=ORANGE, depthshade=False, label="points")
    for vertices, faces in surfaces:
        x, y, z = 1e3 * vertices.T
        axes.plot_trisurf(x, y, z, triangles=faces, color=BLUE, alpha=0.25, linewidth=0)
    axes.set_xlabel("x, mm")
    axes.set_ylabel("y, mm")
    axes.set_zlabel("z, mm")
    axes.set_aspect("equal")
    return figure
