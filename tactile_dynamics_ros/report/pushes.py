"""The report of an estimate of a pushed object: pushes from above, forces, numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import placed
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.report.page import Page, Picture, Section, write_page
from tactile_dynamics_ros.report.style import (
    BLUE,
    GREEN,
    MOST_POINTS,
    ORANGE,
    SERIES,
    house_style,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Number = tuple[float, float]
Centre = tuple[Number, Number]
"""Value and standard deviation of each coordinate of the centre of mass in the link's frame, m."""

_OUTLINES = 8
"""Outlines along the way of each part: more run into each other."""
_ARROWS = 16
"""Forces that are drawn of each contact, for the same reason."""
_LONGEST = 0.05
"""Length of the largest force in the picture, m: about half an object, so that all are seen."""


def write_pushes(
    streams: PushedStreams,
    centre: Centre | None,
    page: tuple[str, bool, str, str],
    sentences: Sequence[str],
    rows: Sequence[tuple[str, ...]],
    folder: Path,
) -> Path:
    """Write report.html of an estimate.

    Args:
        streams: what was measured.
        centre: of mass of a single part; None of two.
        page: verdict, whether it is good, source, and how to make the page again.
        sentences: the estimate for people.
        rows: head and numbers.
        folder: where it goes.
    """
    verdict, good, source, command = page
    with house_style():
        pictures = [
            Picture(
                "pushes",
                draw_pushes(streams, centre),
                "outlines along the way, forces of the contacts, centre of mass",
                "Outlines from the first to the last (strong); arrows are forces on the object. "
                "The ellipse is the centre of mass at the end, ± one standard deviation.",
            ),
            Picture("forces", draw_push_forces(streams), "force of each contact over time"),
        ]
        head, *body = rows
        sections = [
            Section("The numbers", ["A star marks what this recording does not determine."], (),
                    head, body),
            Section("The pushes", (), pictures),
        ]  # fmt: skip
        return write_page(
            Page("What was pushed", verdict, good, source, command, sentences, sections), folder
        )


def draw_pushes(streams: PushedStreams, centre: Centre | None = None) -> Figure:
    """Draw outlines, forces and the centre of mass from above."""
    figure = new_figure(4.5, 6.0)
    axes = figure.add_subplot()
    for link, colour in zip(streams.links, SERIES, strict=False):
        _draw_link(axes, link, colour)
    largest = max((float(np.abs(c.force).max()) for c in streams.contacts.values()), default=1.0)
    for contact in streams.contacts.values():
        _draw_contact(axes, contact, _LONGEST / max(largest, 1e-9))
    if centre is not None:
        _draw_centre(axes, streams.links[0].pose[-1], centre)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    return figure


def draw_push_forces(streams: PushedStreams) -> Figure:
    """Draw the horizontal force of each contact over time."""
    figure = new_figure(2.6)
    axes = figure.add_subplot()
    for (name, contact), colour in zip(streams.contacts.items(), SERIES, strict=False):
        step = max(1, len(contact.time) // MOST_POINTS)
        size = np.linalg.norm(contact.force[::step, :2], axis=1)
        axes.plot(contact.time[::step], size, ".", markersize=2.0, color=colour, label=name)
    axes.set_xlabel("time, s")
    axes.set_ylabel("horizontal force, N")
    axes.legend()
    return figure


def _draw_link(axes: Axes, link: LinkStream, colour: str) -> None:
    """Draw the way of a part."""
    chosen = np.linspace(0, len(link.time) - 1, _OUTLINES).astype(int)
    for k in chosen:
        strong = bool(k == chosen[-1])
        outline = closed(np.asarray(link.footprint), link.pose[k])
        axes.plot(*outline.T, color=colour, alpha=1.0 if strong else 0.3, linewidth=1.0 + strong)
    axes.plot(link.pose[:, 0], link.pose[:, 1], color=colour, linewidth=0.8, alpha=0.6)


def _draw_contact(axes: Axes, contact: PushContact, scale: float) -> None:
    """Draw forces where they act, at moments of touch spread evenly over the recording."""
    size = np.linalg.norm(contact.force[:, :2], axis=1)
    if not len(size) or not len(contact.pose_time):
        return
    touched = np.flatnonzero(size > 0.1 * size.max())
    chosen = touched[np.linspace(0, len(touched) - 1, min(_ARROWS, len(touched))).astype(int)]
    at = np.clip(
        np.searchsorted(contact.pose_time, contact.time[chosen]), 0, len(contact.pose_time) - 1
    )
    heads = contact.point[at, :2]
    tails = heads - scale * contact.force[chosen, :2]
    for head, tail in zip(heads, tails, strict=True):
        axes.annotate("", head, tail, arrowprops={"arrowstyle": "->", "color": ORANGE})
    axes.update_datalim(tails)
    axes.autoscale_view()


def _draw_centre(axes: Axes, pose: Array, centre: Centre) -> None:
    """Draw the centre of mass with its uncertainty."""
    (x, x_std), (y, y_std) = centre
    place = placed(np.array([[x, y]]), pose)[0]
    width, height = 2.0 * x_std, 2.0 * y_std
    turn = float(np.degrees(pose[2]))
    axes.add_patch(Ellipse((place[0], place[1]), width, height, angle=turn, color=GREEN, alpha=0.4))
    axes.plot(*place, "+", color=BLUE)


def closed(outline: Array, pose: Array) -> Array:
    """Corners (V + 1, 2) of an outline on the support, the first once more to close it."""
    return placed(np.vstack([outline, outline[:1]]), pose)
