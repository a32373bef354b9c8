"""One picture of a run: the hand with the object, and the estimates as they settle."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.report.estimates import settled_view
from tactile_dynamics_ros.report.history import EstimateHistory
from tactile_dynamics_ros.report.style import AXIS_COLOURS, INK, label_lines, new_figure

MILLI = 1e3
SETTLED_SHARE = 0.1


def draw_summary(
    portrait: NDArray[np.uint8], history: EstimateHistory, truth: InertialParameters
) -> Figure:
    """Draw hand and object beside mass and centre of mass over time; dashed lines are the truth.

    Args:
        portrait: (H, W, 3) picture of the hand.
        history: estimates as they came.
        truth: true parameters.
    """
    figure = new_figure(3.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.1, 1.0))
    picture = figure.add_subplot(grid[:, 0])
    picture.imshow(portrait)
    picture.set_axis_off()
    mass, centre = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    _draw(mass, history, 0, INK, truth.mass, "mass")
    mass.set_title("mass")
    mass.set_ylabel("g")
    for k, (axis, colour) in enumerate(AXIS_COLOURS.items()):
        _draw(centre, history, 1 + k, colour, float(truth.com[k]), axis)
    values = np.concatenate([[truth.mass], truth.com])
    mass.set_ylim(settled_view(history, [0], MILLI, values))
    centre.set_ylim(settled_view(history, [1, 2, 3], MILLI, values))
    centre.set_title("centre of mass")
    centre.set_ylabel("mm")
    centre.set_xlabel("seconds")
    label_lines(centre, list(AXIS_COLOURS))
    return figure


def _draw(
    axes: Axes, history: EstimateHistory, row: int, colour: str, truth: float, label: str
) -> None:
    """Draw one parameter with a band of ± one standard deviation, without its wild beginning."""
    late = history.time >= history.time[0] + SETTLED_SHARE * np.ptp(history.time)
    time = history.time[late] - history.time[0]
    value, std = MILLI * history.value[late, row], MILLI * history.std[late, row]
    axes.fill_between(time, value - std, value + std, color=colour, alpha=0.16, lw=0)
    axes.plot(time, value, color=colour, label=label, linewidth=1.5)
    axes.axhline(MILLI * truth, color=colour, linestyle=(0, (4, 3)))
    axes.margins(x=0.01)
