"""The report of an estimate of an arm by its joint torques."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Residuals
from tactile_dynamics_ros.report.page import Page, Picture, Section, write_page
from tactile_dynamics_ros.report.style import BLUE, MOST_POINTS, ORANGE, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_torques(residuals: Residuals, measured: Array) -> Figure:
    """Draw the measured torque of each joint, and what the model leaves of it.

    Args:
        residuals: of the model.
        measured: (K, n) torques, N m.
    """
    count = len(residuals.channels)
    figure = new_figure(1.1 * count + 0.6)
    rows = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    step = max(1, len(residuals.time) // MOST_POINTS)
    for k, axes in enumerate(rows):
        time = residuals.time[::step]
        axes.plot(time, measured[::step, k], color=BLUE, linewidth=0.8, label="measured")
        axes.plot(time, residuals.physical[::step, k], color=ORANGE, linewidth=0.8, label="error")
        axes.set_title(f"{residuals.channels[k]}, {residuals.units[k]}", fontsize="small")
    rows[0].legend(loc="upper right")
    rows[-1].set_xlabel("time, s")
    return figure


def write_joints(
    figure: Figure,
    page: tuple[str, bool, str, str],
    sentences: Sequence[str],
    rows: Sequence[tuple[str, ...]],
    folder: Path,
) -> Path:
    """Write report.html of an estimate.

    Args:
        figure: of the torques.
        page: verdict, whether it is good, source, and how to make the page again.
        sentences: the estimate for people.
        rows: head and numbers.
        folder: where it goes.
    """
    verdict, good, source, command = page
    head, *body = rows
    with house_style():
        pictures = [Picture("torques", figure, "torque of each joint, and the error of the model")]
        sections = [
            Section("The numbers", ["A star marks what this recording does not tell."], (),
                    head, body),
            Section("The torques", (), pictures),
        ]  # fmt: skip
        return write_page(
            Page("An arm by its torques", verdict, good, source, command, sentences, sections),
            folder,
        )
