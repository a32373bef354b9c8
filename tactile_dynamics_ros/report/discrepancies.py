"""Figures of model error: how it falls, where it sits, which effect would explain it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.report.estimates import draw_vector, running_mean
from tactile_dynamics_ros.report.style import (
    AXIS_COLOURS,
    BLUE,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    QUIET,
    RED,
    SERIES,
    label_lines,
    new_figure,
    thinning,
)

_MOST_CANDIDATES = 10
"""Candidates in the figure, best first: the others are far from the best."""
_MOST_PLACES = 8
"""Conditions in the figure, as many as `compare` prints."""
_BAR = 0.62
"""Width of bars as a share of their distance."""
_BINS = 10
"""Bins of a condition, equally filled: of 30 s at 100 Hz each has 300 samples, of the slips of a
probe five to seven."""


@dataclass(frozen=True)
class Channels:
    """Channels of a residual that are drawn together.

    Attributes:
        name: of what they are the components of, or of the one channel.
        unit: SI.
        columns: their places in the residual.
        colours: their colours by what they are called in a figure.
    """

    name: str
    unit: str
    columns: list[int]
    colours: dict[str, str]


def group_channels(channels: Sequence[str], units: Sequence[str]) -> list[Channels]:
    """Put components x, y and z of the same name together; those of the shortest unit first."""
    groups: dict[str, Channels] = {}
    for column, (channel, unit) in enumerate(zip(channels, units, strict=True)):
        stem, _, axis = channel.rpartition("_")
        name = stem if axis in AXIS_COLOURS else channel
        group = groups.setdefault(name, Channels(name, unit, [], {}))
        group.columns.append(column)
        label = axis if axis in AXIS_COLOURS else channel
        group.colours[label] = AXIS_COLOURS.get(axis, SERIES[(len(groups) - 1) % len(SERIES)])
    return sorted(groups.values(), key=lambda group: len(group.unit))


def draw_error_steps(
    steps: Sequence[Mapping[str, Any]], noise_floor: float = 1.0, alone: str = "rigid body"
) -> Figure:
    """Draw how the error falls while effects are added.

    Args:
        steps: ``{"added": effect or None, "error": whitened RMS}`` in order.
        noise_floor: whitened RMS where only noise remains.
        alone: what the model without effects is called.
    """
    figure = new_figure(2.7, min(9.0, 3.0 + 1.5 * len(steps)))
    axes = figure.subplots()
    errors = np.array([float(step["error"]) for step in steps])
    places = np.arange(len(errors))
    last = len(errors) - 1
    axes.bar(places, errors, _BAR, color=[BLUE if k == last else GREY for k in places])
    for place, error in zip(places, errors, strict=True):
        axes.annotate(
            f"{error:.2f}", (place, error), (0, 3), textcoords="offset points", ha="center"
        )
    names = [f"+ {step['added']}" if step.get("added") else alone for step in steps]
    axes.set_xticks(places, names)
    axes.tick_params(axis="x", labelsize=9, labelcolor=INK)
    axes.set_ylim(0.0, 1.18 * errors.max())
    axes.set_xlim(-0.6, len(errors) - 0.1)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel("error in units of the noise")
    _mark_floor(axes, noise_floor)
    return figure


def _mark_floor(axes: Axes, noise_floor: float) -> None:
    """Draw the level that only noise would leave, named at the right end."""
    axes.axhline(noise_floor, color=RED, linestyle=(0, (4, 3)), linewidth=1.0)
    axes.annotate(
        "noise",
        (1.0, noise_floor),
        (-2, 3),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        ha="right",
        color=RED,
        fontsize=8,
    )


def draw_before_after(
    time: Array,
    before: Array,
    after: Array | None,
    groups: Sequence[Channels],
    titles: tuple[str, str],
    regimes: Sequence[tuple[float, float]] = (),
) -> Figure:
    """Draw the residual before and after effects are added, on the same scales.

    Args:
        time: (N,) s.
        before: (N, D) measured minus predicted.
        after: the same with the effects, or None.
        groups: the channels.
        titles: of both.
        regimes: starts and ends in s of spans in which an added effect acts, to shade.
    """
    shown = [(title, v) for title, v in zip(titles, (before, after), strict=True) if v is not None]
    figure = new_figure(0.3 + 1.8 * len(groups))
    grid = figure.subplots(len(groups), len(shown), sharex=True, sharey="row", squeeze=False)
    for row, group in enumerate(groups):
        for axes, (title, values) in zip(grid[row], shown, strict=True):
            _shade(axes, regimes)
            draw_vector(axes, time, values[:, group.columns], group.colours)
            axes.set_title(title if row == 0 else "")
        grid[row, 0].set_ylabel(f"{group.name} in {group.unit}")
        grid[row, 0].set_ylim(_robust_limits(before[:, group.columns]))
    for axes in grid[-1]:
        axes.set_xlabel("time in s")
    if len(groups[0].columns) > 1:
        label_lines(grid[0, -1], list(groups[0].colours))
    return figure


def _shade(axes: Axes, spans: Sequence[tuple[float, float]]) -> None:
    for start, stop in spans:
        axes.axvspan(start, stop, color=ORANGE, alpha=0.15, linewidth=0)


def _robust_limits(values: Array) -> tuple[float, float]:
    """Return symmetric limits that a few spikes do not widen."""
    reach = 1.3 * float(np.quantile(np.abs(values), 0.998))
    return -max(reach, 1e-9), max(reach, 1e-9)


def draw_candidates(
    candidates: Sequence[Mapping[str, Any]],
    error: float,
    noise_floor: float = 1.0,
    chosen: Sequence[str] = (),
) -> Figure:
    """Draw how far each candidate effect would lower the error.

    Args:
        candidates: ``{"name", "predicted_whitened_rms", ...}``, best first.
        error: whitened RMS without any of them.
        noise_floor: whitened RMS where only noise remains.
        chosen: names that the verdict names.
    """
    shown = list(candidates)[:_MOST_CANDIDATES]
    figure = new_figure(0.8 + 0.29 * len(shown), 7.4)
    axes = figure.subplots()
    places = np.arange(len(shown))[::-1]
    for place, candidate in zip(places, shown, strict=True):
        after = float(candidate["predicted_whitened_rms"])
        colour = ORANGE if candidate["name"] in chosen else GREY
        axes.plot([error, after], [place, place], color=colour, linewidth=3.0, alpha=0.5)
        axes.plot(after, place, "o", color=colour, markersize=6.5)
        axes.annotate(
            f"{after:.2f}", (after, place), (-7, 0), textcoords="offset points",
            ha="right", va="center", fontsize=8, color=INK,
        )  # fmt: skip
    axes.axvline(error, color=QUIET, linewidth=1.0)
    axes.axvline(noise_floor, color=RED, linestyle=(0, (4, 3)), linewidth=1.0)
    for level, text, colour in ((error, "now", QUIET), (noise_floor, "noise", RED)):
        axes.annotate(
            text, (level, 1.0), (0, 2), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", color=colour, fontsize=8,
        )  # fmt: skip
    axes.set_yticks(places, [str(candidate["name"]) for candidate in shown])
    axes.tick_params(axis="y", labelsize=9, labelcolor=INK)
    axes.set_ylim(-0.6, len(shown) - 0.4)
    axes.grid(axis="y", visible=False)
    span = max(error - noise_floor, 0.1)
    axes.set_xlim(min(noise_floor, error) - 0.2 * span, error + 0.06 * span)
    axes.set_xlabel("expected error after adding it, in units of the noise")
    return figure


def draw_fails_where(places: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the conditions under which the model is most wrong.

    Args:
        places: ``{"channel", "condition", "share_of_error"}``, worst first.
    """
    shown = list(places)[:_MOST_PLACES]
    figure = new_figure(0.8 + 0.29 * len(shown), 7.4)
    axes = figure.subplots()
    rows = np.arange(len(shown))[::-1]
    shares = [100.0 * float(place["share_of_error"]) for place in shown]
    axes.barh(rows, shares, _BAR, color=BLUE, alpha=0.85)
    for row, share in zip(rows, shares, strict=True):
        axes.annotate(
            f"{share:.0f} %", (share, row), (4, 0), textcoords="offset points",
            va="center", fontsize=8, color=INK,
        )  # fmt: skip
    axes.set_yticks(rows, [f"{place['channel']}, {place['condition']}" for place in shown])
    axes.tick_params(axis="y", labelsize=9, labelcolor=INK)
    axes.set_xlim(0.0, 1.15 * max([*shares, 1.0]))
    axes.set_ylim(-0.6, len(shown) - 0.4)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("share of the error in %")
    return figure


def draw_error_over_time(
    time: Array,
    white: Array,
    groups: Sequence[Channels],
    intervals: Sequence[tuple[float, float]] = (),
) -> Figure:
    """Draw when the model is wrong: RMS over half a second, in units of the noise.

    Args:
        time: (N,) s.
        white: (N, D) whitened residual.
        groups: the channels.
        intervals: starts and ends in s of spans to shade.
    """
    figure = new_figure(2.2)
    axes = figure.subplots()
    _shade(axes, intervals)
    for group, colour in zip(groups, _colours(groups), strict=True):
        square = np.mean(white[:, group.columns] ** 2, axis=1, keepdims=True)
        rms, thin = np.sqrt(running_mean(time, square)[:, 0]), thinning(len(time))
        axes.plot(time[thin], rms[thin], color=colour, label=group.name)
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.01)
    axes.set_xlabel("time in s")
    axes.set_ylabel("error in units of the noise")
    _mark_floor(axes, 1.0)
    label_lines(axes, [group.name for group in groups])
    return figure


def _colours(groups: Sequence[Channels]) -> list[str]:
    """Return a colour for each group as a whole."""
    order = (BLUE, PURPLE, *(colour for colour in SERIES if colour not in (BLUE, PURPLE)))
    return [order[k % len(order)] for k in range(len(groups))]


def draw_error_by_condition(
    white: Array, groups: Sequence[Channels], conditions: Mapping[str, Array]
) -> Figure:
    """Draw how the error depends on what was going on: RMS in ten equally filled bins.

    Args:
        white: (N, D) whitened residual.
        groups: the channels.
        conditions: (N,) values by label, such as "speed in m/s".
    """
    columns = min(3, len(conditions))
    rows = -(-len(conditions) // columns)
    figure = new_figure(0.3 + 1.8 * rows)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False).flat
    highest = 1.0
    for axes, (label, values) in zip(grid, conditions.items(), strict=False):
        order = np.argsort(values)
        for group, colour in zip(groups, _colours(groups), strict=True):
            bins = np.array_split(order, min(_BINS, len(order)))
            middle = [float(np.median(values[rows])) for rows in bins]
            rms = [float(np.sqrt(np.mean(white[rows][:, group.columns] ** 2))) for rows in bins]
            axes.plot(middle, rms, "o-", color=colour, label=group.name, markersize=3.5)
            highest = max(highest, *rms)
        axes.axhline(1.0, color=RED, linestyle=(0, (4, 3)), linewidth=1.0)
        axes.set_xlabel(label)
    figure.axes[0].set_ylim(0.0, 1.12 * highest)
    for axes in list(figure.axes)[len(conditions) :]:
        axes.set_visible(False)
    for axes in list(figure.axes)[::columns]:
        axes.set_ylabel("error / noise")
    label_lines(figure.axes[columns - 1], [group.name for group in groups])
    return figure


def draw_channels(error_by_channel: Mapping[str, float]) -> Figure:
    """Draw the whitened RMS of each channel; 1 is the noise.

    Args:
        error_by_channel: whitened RMS by channel name.
    """
    figure = new_figure(2.2, 6.0)
    axes = figure.subplots()
    names, errors = list(error_by_channel), [float(e) for e in error_by_channel.values()]
    axes.bar(np.arange(len(names)), errors, _BAR, color=BLUE, alpha=0.85)
    axes.set_xticks(np.arange(len(names)), names)
    axes.tick_params(axis="x", labelcolor=INK)
    axes.set_ylim(0.0, 1.15 * max([*errors, 1.0]))
    axes.set_xlim(-0.6, len(names) - 0.1)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel("error in units of the noise")
    _mark_floor(axes, 1.0)
    return figure


def draw_spectrum(
    frequency: Array, power: Mapping[str, Array], peak_hz: float | None = None
) -> Figure:
    """Draw the spectrum of what no effect of the catalogue explains.

    Args:
        frequency: (K,) Hz.
        power: (K,) spectral density of each channel.
        peak_hz: frequency to point at.
    """
    figure = new_figure(2.6)
    axes = figure.subplots()
    for k, (name, values) in enumerate(power.items()):
        axes.plot(frequency, values, label=name, color=list(AXIS_COLOURS.values())[k % 3])
    if peak_hz is not None:
        axes.axvline(peak_hz, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.annotate(
            f"{peak_hz:.2f} Hz", (peak_hz, 1.0), (3, -10), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=8.5,
        )  # fmt: skip
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel("power of the residual")
    axes.margins(x=0.01)
    label_lines(axes, list(power))
    return figure
