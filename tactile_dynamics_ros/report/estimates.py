"""Figures of an estimate: how it settles, and what it leaves unexplained."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    describe_parameter,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)
from tactile_dynamics_ros.report.style import (
    AXIS_COLOURS,
    BLUE,
    GREY,
    INK,
    QUIET,
    RED,
    label_lines,
    new_figure,
    thinning,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
    from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate


PARAMETERS = 10


@dataclass(frozen=True)
class EstimateHistory:
    """Estimates after more and more data.

    Attributes:
        time: (K,) s.
        value: (K, 10) [mass kg, com m, inertia about the centre of mass kg m^2].
        std: (K, 10) standard deviations.
    """

    time: Array
    value: Array
    std: Array

    def of_last_model(self) -> EstimateHistory:
        """Without estimates that a later one for the same or an earlier instant replaces.

        An estimator whose model is changed goes back to the data that it keeps.
        """
        ahead = np.minimum.accumulate(np.append(self.time, np.inf)[::-1])[::-1][1:]
        kept = self.time < ahead
        return EstimateHistory(self.time[kept], self.value[kept], self.std[kept])


def settle(model: FittedModel, points: int = 80) -> EstimateHistory:
    """Return what the data up to each of several instants say, linearised at the final fit.

    xi_k = xi - (J_k' J_k + P)^-1 (J_k' r_k - J' r) with the white residual r, its Jacobian J by the
    log-Cholesky coordinates xi and effect parameters, the first rows J_k, r_k and the prior's
    information P.

    Args:
        model: fitted to the whole recording.
        points: number of instants.
    """
    time = np.concatenate([samples.time for samples in model.samples])
    jacobian = model.white_jacobian.copy()
    jacobian[:, :PARAMETERS] = jacobian[:, :PARAMETERS] @ log_cholesky_jacobian(model.xi)
    residual = model.white_residual
    _, prior = model.coordinate_information
    ends = np.unique(np.linspace(len(time) / points, len(time), points).astype(int))
    pieces = np.split(np.arange(len(residual)), 6 * ends[:-1])
    information = np.cumsum([jacobian[p].T @ jacobian[p] for p in pieces], axis=0)
    gradient = np.cumsum([jacobian[p].T @ residual[p] for p in pieces], axis=0)
    covariance = np.asarray(np.linalg.inv(information + prior))
    step = -np.einsum("kij,kj->ki", covariance, gradient - gradient[-1])
    return _physical(model, time[ends - 1], step[:, :PARAMETERS], covariance)


def _physical(model: FittedModel, time: Array, step: Array, covariance: Array) -> EstimateHistory:
    """Return the history in mass, centre of mass and inertia; bands end at the final deviation."""
    values, stds = [], []
    for move, spread in zip(step, covariance[:, :PARAMETERS, :PARAMETERS], strict=True):
        xi = model.xi + np.clip(move, -3.0, 3.0)
        phi = dynamic_parameters_from_log_cholesky(xi)
        body = InertialParameters.from_dynamic_parameters(phi)
        upper = body.inertia_com[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        values.append(np.concatenate([[body.mass], body.com, upper]))
        mapped = com_inertia_jacobian(phi) @ log_cholesky_jacobian(xi)
        stds.append(np.sqrt(np.diag(mapped @ spread @ mapped.T)))
    std = np.array(stds) * (model.to_estimate().parameter_std / stds[-1])
    return EstimateHistory(time, np.array(values), std)


PANELS = (
    ("mass", "g", 1e3, (0,)),
    ("centre of mass", "mm", 1e3, (1, 2, 3)),
    ("moments of inertia", "kg mm²", 1e6, (4, 6, 9)),
    ("products of inertia", "kg mm²", 1e6, (5, 7, 8)),
)
SHOWN_PARAMETERS = tuple(
    (describe_parameter(name), *{"m": (1e3, "g"), "c": (1e3, "mm"), "i": (1e6, "kg mm²")}[name[0]])
    for name in PARAMETER_NAMES
)
"""Of each of PARAMETER_NAMES in a table: words, factor to its unit, unit."""
LABELS = ("mass", "x", "y", "z", "xx", "xy", "yy", "xz", "yz", "zz")
LINE_COLOURS = (INK, *AXIS_COLOURS.values())
_SETTLED_SHARE = 0.2
_VIEW_STDS = 10.0
_SMOOTHING = 0.5


def draw_convergence(
    history: EstimateHistory,
    truth: InertialParameters | None = None,
    not_excited: Collection[str] = (),
    final: InertialEstimate | None = None,
) -> Figure:
    """Draw estimates with bands of ± one standard deviation; dashed lines are the truth.

    Args:
        history: estimates after more and more data.
        truth: true parameters where they are known.
        not_excited: parameters (of PARAMETER_NAMES) that the motion did not determine; left out.
        final: estimate from the whole recording; a bar of ± one standard deviation at the end.
    """
    figure = new_figure(4.6)
    end = 1.02 * float(history.time[-1] - history.time[0])
    true_values = None if truth is None else _values_of(truth)
    for axes, (title, unit, scale, rows) in zip(figure.subplots(2, 2).flat, PANELS, strict=True):
        axes.set_title(title)
        shown = [row for row in rows if PARAMETER_NAMES[row] not in not_excited]
        if not shown:
            _leave_out(axes)
            continue
        for row in shown:
            colour = LINE_COLOURS[0] if len(rows) == 1 else LINE_COLOURS[1 + rows.index(row)]
            _draw_band(axes, history, row, scale, colour)
            if final is not None:
                value, std = _values_of(final.inertia)[row], final.parameter_std[row]
                bar = {"color": colour, "fmt": "o", "markersize": 3, "capsize": 2}
                axes.errorbar(end, scale * value, scale * std, **bar)
            if true_values is not None:
                axes.axhline(scale * true_values[row], color=colour, linestyle=(0, (4, 3)))
        axes.set_ylim(settled_view(history, shown, scale, true_values))
        axes.set_ylabel(unit)
        axes.set_xlabel("seconds since the first estimate")
        axes.margins(x=0.01)
        if len(rows) > 1:
            label_lines(axes, [LABELS[row] for row in shown])
    return figure


def _leave_out(axes: Axes) -> None:
    """Say in an empty panel that its parameters are not determined."""
    axes.set_axis_off()
    text = "not determined by this motion"
    axes.text(0.0, 0.9, text, transform=axes.transAxes, color=QUIET)


def _values_of(body: InertialParameters) -> Array:
    """Return the ten parameters in the order of a history."""
    upper = body.inertia_com[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.concatenate([[body.mass], body.com, upper])


def _draw_band(axes: Axes, history: EstimateHistory, row: int, scale: float, colour: str) -> None:
    """Draw one parameter with its band."""
    value, std = scale * history.value[:, row], scale * history.std[:, row]
    seconds = history.time - history.time[0]
    low, high = value - std, value + std
    axes.fill_between(seconds, low, high, color=colour, alpha=0.16, linewidth=0)
    axes.plot(seconds, value, color=colour, label=LABELS[row], linewidth=1.5)


def settled_view(
    history: EstimateHistory, rows: list[int], scale: float, true_values: Array | None
) -> tuple[float, float]:
    """Return limits that show how the values settle rather than the wild first moments."""
    late = history.time >= history.time[0] + _SETTLED_SHARE * np.ptp(history.time)
    value, std = history.value[:, rows], history.std[:, rows]
    usual = 2.0 * np.median(std[late], axis=0)
    edges = [value[late] - usual, value[late] + usual]
    edges += [value[-1:] - _VIEW_STDS * std[-1:], value[-1:] + _VIEW_STDS * std[-1:]]
    if true_values is not None:
        edges.append(true_values[None, rows])
    every = scale * np.concatenate(edges)
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 1.0)
    return low, high if high > low else low + 1.0


def draw_residuals(time: Array, residual: Array, white_residual: Array) -> Figure:
    """Draw what the model leaves unexplained, and whether it looks like the stated noise.

    Args:
        time: (N,) s.
        residual: (N, 6) measured minus predicted [torque N m, force N], body frame.
        white_residual: (M,) the same, whitened: standard normal where only noise remains.
    """
    figure = new_figure(2.6)
    force, torque, bell = figure.subplots(1, 3, width_ratios=(1.3, 1.3, 1))
    draw_vector(force, time, residual[:, 3:])
    draw_vector(torque, time, residual[:, :3])
    for axes, title, unit in ((force, "force residual", "N"), (torque, "torque residual", "N m")):
        axes.set_title(title)
        axes.set_ylabel(unit)
        axes.set_xlabel("time in s")
    label_lines(torque, list(AXIS_COLOURS))
    _draw_bell(bell, white_residual)
    return figure


def draw_vector(
    axes: Axes, time: Array, values: Array, colours: Mapping[str, str] = AXIS_COLOURS
) -> None:
    """Draw noisy components faintly, and their mean over half a second on top.

    Args:
        axes: where.
        time: (N,) s.
        values: (N, D).
        colours: of the components by their names.
    """
    thin = thinning(len(time))
    smooth = running_mean(time, values)
    for k, colour in enumerate(colours.values()):
        axes.plot(time[thin], values[thin, k], color=colour, linewidth=0.4, alpha=0.3)
    for k, (axis, colour) in enumerate(colours.items()):
        axes.plot(time[thin], smooth[thin, k], color=colour, label=axis, linewidth=1.3)
    axes.margins(x=0.01)


def running_mean(time: Array, values: Array) -> Array:
    """Return the mean over half a second around each sample."""
    first = np.searchsorted(time, time - 0.5 * _SMOOTHING)
    last = np.searchsorted(time, time + 0.5 * _SMOOTHING, side="right")
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])


def _draw_bell(axes: Axes, white_residual: Array) -> None:
    """Draw the distribution of the white residual over the standard normal."""
    edge = float(np.clip(np.quantile(np.abs(white_residual), 0.999), 4.0, 12.0))
    bins = np.linspace(-edge, edge, 61).tolist()
    axes.hist(np.clip(white_residual, -edge, edge), bins=bins, density=True, color=BLUE, alpha=0.35)
    x = np.linspace(-edge, edge, 200)
    axes.plot(x, np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi), color=INK, linewidth=1.2)
    axes.set_title("in units of the noise")
    axes.set_yticks([])
    axes.set_xlabel("bars: residual, line: noise alone")


def draw_comparison_with_truth(history: EstimateHistory, truth: InertialParameters) -> Figure:
    """Draw the final error of each parameter in its own standard deviations."""
    figure = new_figure(2.2)
    axes = figure.subplots()
    score = (history.value[-1] - _values_of(truth)) / history.std[-1]
    axes.axvspan(-2, 2, color=GREY, alpha=0.15, linewidth=0)
    axes.axvline(0, color=QUIET, linewidth=0.8)
    places = np.arange(len(score))[::-1]
    axes.scatter(score, places, color=np.where(np.abs(score) <= 2, BLUE, RED), zorder=3)
    axes.set_yticks(places, LABELS)
    axes.set_xlabel("error in standard deviations (19 of 20 should lie in the band)")
    return figure
