"""Recordings of several robots: which stand out, and which robot's numbers drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.report.page import Link, Picture, Section
from tactile_dynamics_ros.report.style import BLUE, ORANGE, RED, house_style, new_figure

FALSE_ALARMS = 0.05
"""Probability that a page names anything though no robot has changed: shared by all that is tested
on the page (Bonferroni). At 0.01 an outlier among 1,000 has to be 0.4 std farther out."""
_MAD_EFFICIENCY = 0.37
"""Precision of a median absolute deviation beside that of a standard deviation, Gaussian values
(Hampel 1974): n of them count as 0.37 n degrees of freedom. Not tuned."""
_PANELS = 12
"""Most panels of the figure, so that it stays readable; the tables have all."""


@dataclass(frozen=True, eq=False)
class Track:
    """One quantity over a robot's recordings.

    Attributes:
        robot: name.
        quantity: name with unit, as the table's column.
        recordings: their links, in order.
        values: (N,) of them, all finite.
    """

    robot: str
    quantity: str
    recordings: tuple[str | Link, ...]
    values: Array

    @cached_property
    def trend_p_value(self) -> float:
        """Probability of such an order without a drift: Kendall's tau of value and order."""
        if len(self.values) < 3 or np.ptp(self.values) == 0.0:
            return 1.0
        return float(stats.kendalltau(np.arange(len(self.values)), self.values).pvalue)

    @cached_property
    def slope(self) -> tuple[float, float, float]:
        """Change from one recording to the next and its 95 % interval (Theil 1950, Sen 1968)."""
        found = stats.theilslopes(self.values)
        return float(found[0]), float(found[2]), float(found[3])

    def line(self, limit: float) -> Array:
        """Return what is expected of each recording, (N,): the median, or the line of a drift."""
        if self.trend_p_value >= limit:
            return np.full(len(self.values), np.median(self.values))
        line = self.slope[0] * np.arange(len(self.values))
        return np.asarray(line + np.median(self.values - line))


def outlier_p_values(values: Array) -> Array:
    """Return the probability of each value, given the scatter of all.

    t = (x_i - median) / s, s being the median absolute deviation scaled to a std; Student's t of
    0.37 (n - 1) degrees of freedom. Gaussian values fall below a level at most as often as it says:
    0.9 times as often for 50 values, 0.7 times for 20, never for six.

    Args:
        values: (N,); if half of them are the same, all probabilities are 1.

    Returns:
        (N,) two-sided probabilities.
    """
    spread = stats.median_abs_deviation(values, scale="normal") if len(values) > 1 else 0.0
    if not spread > 0.0:
        return np.ones(len(values))
    t = np.abs(values - np.median(values)) / spread
    return np.asarray(2.0 * stats.t.sf(t, _MAD_EFFICIENCY * (len(values) - 1)))


@dataclass(frozen=True)
class Fleet:
    """What stands out among the recordings of several robots.

    Attributes:
        tracks: one for each robot and quantity.
    """

    tracks: Sequence[Track]

    @cached_property
    def quantities(self) -> list[str]:
        """Names of what the tracks have, each once."""
        return list(dict.fromkeys(track.quantity for track in self.tracks))

    @cached_property
    def drift_limit(self) -> float:
        """p-value below which a track drifts: half of the false alarms are for drifts."""
        return 0.5 * FALSE_ALARMS / max(len(self.tracks), 1)

    @cached_property
    def drifting(self) -> list[Track]:
        """Tracks that drift, the surest first."""
        found = [track for track in self.tracks if track.trend_p_value < self.drift_limit]
        return sorted(found, key=lambda track: track.trend_p_value)

    @cached_property
    def outliers(self) -> list[tuple[Track, int, float]]:
        """Track, index of the recording in it and p-value, the surest first."""
        tested = sum(len(track.values) for track in self.tracks)
        found = []
        for track in self.tracks:
            p_values = outlier_p_values(track.values - track.line(self.drift_limit))
            for k in np.flatnonzero(p_values < 0.5 * FALSE_ALARMS / tested):
                found.append((track, int(k), float(p_values[k])))
        return sorted(found, key=lambda one: one[2])

    def sentence(self) -> str:
        """Return how much stands out."""
        robots = {track.robot for track in self.drifting}
        apart = {track.recordings[k] for track, k, _ in self.outliers}
        drifts = f"{len(robots)} of {len({track.robot for track in self.tracks})} robots drift"
        return f"{drifts}; recordings that stand out: {len(apart)}."

    def sections(self) -> list[Section]:
        """Return tables of drifts, outliers and robots, and a figure of what was found."""
        found = [*self.drifting, *(track for track, _, _ in self.outliers)]
        named = list(dict.fromkeys(found))[:_PANELS]
        pictures = [_picture(self._draw(named), len(named))] if named else []
        return [
            Section(
                "Drift and outliers",
                sentences=[self.sentence(), _HOW],
                pictures=pictures,
                header=("robot or recording", "quantity", "what", "p-value"),
                rows=[*map(_drift_row, self.drifting), *(_outlier_row(*o) for o in self.outliers)],
            ),
            Section(
                "Robots",
                sentences=["Medians over the recordings of each robot."],
                header=("robot", "recordings", *self.quantities),
                rows=self._robot_rows(),
            ),
        ]

    def _robot_rows(self) -> list[list[str]]:
        found = {(track.robot, track.quantity): track.values for track in self.tracks}
        rows = []
        for robot in dict.fromkeys(track.robot for track in self.tracks):
            values = [found.get((robot, quantity), np.zeros(0)) for quantity in self.quantities]
            medians = [f"{np.median(one):.4g}" if len(one) else "" for one in values]
            rows.append([robot, str(max(map(len, values))), *medians])
        return rows

    def _draw(self, tracks: Sequence[Track]) -> Figure:
        """Draw tracks over the order of their recordings, what stands out in red."""
        with house_style():
            rows = (len(tracks) + 2) // 3
            figure = new_figure(1.9 * rows)
            panels = figure.subplots(rows, 3, squeeze=False)
            for axes in panels.flat[len(tracks) :]:
                axes.set_axis_off()
            for axes, track in zip(panels.flat, tracks, strict=False):
                order = np.arange(1, len(track.values) + 1)
                apart = [k for found, k, _ in self.outliers if found is track]
                axes.plot(order, track.values, ".", color=BLUE, markersize=4)
                axes.plot(order, track.line(self.drift_limit), color=ORANGE)
                axes.plot(order[apart], track.values[apart], "o", color=RED, markersize=5)
                axes.set_title(f"{track.robot}: {track.quantity}")
        return figure


_HOW = (
    "A drift is a trend over the recordings of a robot in the order of their names; a recording "
    "stands out if it is farther from the median (or the trend) of its robot than the scatter of "
    f"the others allows. Where nothing has changed, {100 * FALSE_ALARMS:.0f} % of such pages name "
    "something. What has changed may be the robot or what it carries."
)


def _picture(figure: Figure, count: int) -> Picture:
    return Picture(
        "fleet",
        figure,
        f"{count} panels, each a quantity of one robot over its recordings",
        "Dots are recordings in order; the line is what is expected, red what stands out.",
    )


def _drift_row(track: Track) -> tuple[str | Link, ...]:
    slope, low, high = track.slope
    what = f"drifts by {slope:.3g} per recording (95 %: {low:.3g} to {high:.3g})"
    return track.robot, track.quantity, what, f"{track.trend_p_value:.1g}"


def _outlier_row(track: Track, k: int, p_value: float) -> tuple[str | Link, ...]:
    what = f"{track.values[k]:.4g}; median of the robot {np.median(track.values):.4g}"
    return track.recordings[k], track.quantity, what, f"{p_value:.1g}"
