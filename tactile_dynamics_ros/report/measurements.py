"""Figures of what was measured, and one picture of a run."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    is_feasible,
)
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, Streams
from tactile_dynamics_ros.report.estimates import EstimateHistory, settled_view
from tactile_dynamics_ros.report.style import (
    AXIS_COLOURS,
    BLUE,
    FAINT,
    GREY,
    INK,
    QUIET,
    RED,
    colour_of,
    label_lines,
    new_figure,
    thinning,
)

MILLI = 1e3
_PANEL_HEIGHT = 1.25
_SCENE_POINTS = 60
_AT_ORIGIN_MM = 5.0
_LEGEND_SHARE = 0.15
"""Lowest part of the scene's height, two lines of text, kept free for the legend (loc "outside ..."
needs matplotlib 3.7; Ubuntu 24.04 has 3.6)."""


def draw_forces(streams: Streams) -> Figure:
    """Draw the force of every contact, and the torque of those that measure it."""
    panels = [(contact, False) for contact in streams.contacts.values()]
    panels += [(contact, True) for contact, _ in panels if contact.carries_torque]
    figure = new_figure(0.5 + _PANEL_HEIGHT * max(1, len(panels)))
    grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (contact, is_torque) in zip(grid, panels, strict=True):
        _draw_wrench_part(axes, contact, is_torque)
    label_lines(grid[0], list(AXIS_COLOURS))
    grid[-1].set_xlabel("time in s")
    return figure


def _draw_wrench_part(axes: Axes, contact: ContactStream, is_torque: bool) -> None:
    """Draw three components of the force or torque of one contact."""
    values = contact.torque if is_torque else contact.force
    thin = thinning(len(values))
    time = _with_breaks(contact.time)
    for k, (axis, colour) in enumerate(AXIS_COLOURS.items()):
        axes.plot(time[thin], values[thin, k], color=colour, label=axis, linewidth=0.9)
    axes.set_title(f"{contact.name} (torque)" if is_torque else contact.name)
    axes.set_ylabel("N m" if is_torque else "N")
    axes.margins(x=0.01)


def _with_breaks(time: Array) -> Array:
    """Return the times with NaN at the last sample before a silence, so that lines break there."""
    broken = np.array(time)
    steps = np.diff(time)
    if len(steps):
        broken[:-1][steps > max(0.1, 5.0 * float(np.median(steps)))] = np.nan
    return broken


def draw_motion(streams: Streams) -> Figure:
    """Draw how far the object moved and turned since the recording began."""
    panels = _motion_panels(streams)
    figure = new_figure(2.2)
    grid = figure.subplots(1, len(panels), sharex=True, squeeze=False)[0]
    for axes, (title, unit, time, values) in zip(grid, panels, strict=True):
        thin = thinning(len(time))
        for k, (axis, colour) in enumerate(AXIS_COLOURS.items()):
            axes.plot(_with_breaks(time)[thin], values[thin, k], color=colour, label=axis)
        axes.set_title(title)
        axes.set_ylabel(unit)
        axes.set_xlabel("time in s")
        axes.margins(x=0.01)
    label_lines(grid[-1], list(AXIS_COLOURS))
    return figure


def _motion_panels(streams: Streams) -> list[tuple[str, str, Array, Array]]:
    """Return title, unit, times and (N, 3) values of what was recorded of the motion."""
    panels = []
    pose, imu = streams.pose, streams.imu
    if pose is not None:
        moved = MILLI * (pose.position - pose.position[0])
        panels.append(("position", "mm", pose.time, moved))
    if imu is not None:
        panels.append(("specific force (IMU)", "m/s²", imu.time, imu.specific_force))
    for source in (pose, imu):
        if source is not None and source.rotation is not None:
            turned = log_so3(source.rotation @ source.rotation[0].T)
            panels.append(("rotation", "deg", source.time, np.degrees(_unwrap(turned))))
            break
    return panels


def _unwrap(rotation_vector: Array) -> Array:
    """Add whole turns so that rotation vectors (N, 3) follow each other without jumps."""
    angle = np.linalg.norm(rotation_vector, axis=1, keepdims=True)
    axis = np.divide(rotation_vector, angle, where=angle > 0.0, out=np.zeros_like(rotation_vector))
    signed = angle[:, 0].copy()
    for k in range(1, len(signed)):
        if axis[k] @ axis[k - 1] < 0.0:
            axis[k], signed[k] = -axis[k], -signed[k]
    return np.asarray(axis * np.unwrap(signed)[:, None])


def draw_scene(
    samples: WrenchSamples,
    body: InertialParameters,
    truth: InertialParameters | None = None,
    covariance: Array | None = None,
) -> Figure:
    """Draw contacts with their mean forces, the centre of mass and the body of equal inertia.

    Args:
        samples: contacts in the body frame.
        body: estimate.
        truth: true parameters where they are known.
        covariance: (10, 10) of the estimate's dynamic parameters; bodies that are as likely are
            drawn too.
    """
    others = [] if covariance is None else _likely_bodies(body, covariance)
    figure = new_figure(4.3)
    for place, azimuth in ((1, -60.0), (2, 30.0)):
        axes: Axes3D = figure.add_subplot(1, 2, place, projection="3d", azim=azimuth, elev=22.0)
        reach = _draw_ellipsoid(axes, body)
        for other in others:
            _draw_outline(axes, other)
        _draw_contacts(axes, samples, reach)
        com, origin = MILLI * body.com, np.zeros(3)
        axes.scatter(*com, color=INK, s=40, label="centre of mass", depthshade=False)
        if truth is not None:
            axes.scatter(*(MILLI * truth.com), marker="x", color=RED, s=50, label="its true place")
        axes.scatter(*origin, marker="+", color=QUIET, s=50, label="origin", depthshade=False)
        _equalise(axes)
    figure.set_layout_engine("constrained", rect=(0.0, _LEGEND_SHARE, 1.0, 1.0 - _LEGEND_SHARE))
    figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=4)
    return figure


def _likely_bodies(body: InertialParameters, covariance: Array) -> list[InertialParameters]:
    """Bodies that can exist, drawn from an estimate's interval."""
    phi, scale = body.dynamic_parameters, np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = phi + np.random.default_rng(1).normal(size=(_TRIED, 10)) @ root.T
    feasible = [one for one in drawn if is_feasible(one)][:_LIKELY]
    return [InertialParameters.from_dynamic_parameters(one) for one in feasible]


def _ellipsoid(body: InertialParameters, steps: int) -> Array:
    """Surface (2 n + 1, n + 1, 3), mm, of even density with the same mass and inertia."""
    radii, vectors = body.even_ellipsoid
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * steps + 1), np.linspace(0, np.pi, steps + 1))
    unit = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    return np.asarray(MILLI * ((unit * radii) @ vectors.T + body.com))


def _draw_ellipsoid(axes: Axes3D, body: InertialParameters) -> float:
    """Draw the solid ellipsoid of even density with the same mass and inertia; return its reach."""
    surface = _ellipsoid(body, 16)
    axes.plot_surface(*np.moveaxis(surface, -1, 0), color=GREY, alpha=0.18, linewidth=0)
    axes.plot_wireframe(
        *np.moveaxis(surface[::4, ::4], -1, 0), color=GREY, alpha=0.35, linewidth=0.5
    )
    return float(np.abs(surface).max())


def _draw_outline(axes: Axes3D, body: InertialParameters) -> None:
    """Draw the ellipsoid of a body that is as likely, faintly, with its centre of mass."""
    surface = np.moveaxis(_ellipsoid(body, 6), -1, 0)
    axes.plot_wireframe(*surface, color=BLUE, alpha=0.12, linewidth=0.5)
    axes.scatter(*(MILLI * body.com), color=INK, s=4, alpha=0.4, depthshade=False)


def _draw_contacts(axes: Axes3D, samples: WrenchSamples, reach: float) -> None:
    """Draw where each contact touched and its mean force."""
    touching = samples.in_contact
    largest = max(1e-9, float(np.linalg.norm(_mean_forces(samples), axis=1).max(initial=0.0)))
    furthest = MILLI * float(np.abs(samples.contact_point[touching]).max(initial=0.0))
    spread = min(reach, 4.0 * furthest) if furthest > _AT_ORIGIN_MM else 0.5 * reach
    longest = 0.8 * max(10.0, furthest, spread)
    for k, name in enumerate(samples.contact_names):
        points = MILLI * samples.contact_point[touching[:, k], k]
        if not len(points):
            continue
        few = points[:: max(1, len(points) // _SCENE_POINTS)]
        axes.scatter(*few.T, s=7, color=colour_of(k), alpha=0.5, depthshade=False)
        force = _mean_forces(samples)[k]
        arrow = longest * force / largest
        tail = points.mean(axis=0) - arrow
        label = f"{name} ({np.linalg.norm(force):.1f} N)"
        axes.quiver(
            *tail, *arrow, color=colour_of(k), linewidth=2.2, arrow_length_ratio=0.25, label=label
        )


def _mean_forces(samples: WrenchSamples) -> Array:
    """Return (C, 3) mean forces in the body frame while in contact."""
    counts = np.maximum(samples.in_contact.sum(axis=0), 1)
    return np.asarray(samples.contact_force.sum(axis=0) / counts[:, None])


def _equalise(axes: Axes3D) -> None:
    """Give the three axes one scale and quiet panes."""
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    middle, half = limits.mean(axis=1), 0.5 * float(np.ptp(limits, axis=1).max())
    for setter, centre in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
        setter(centre - half, centre + half)
    axes.set_box_aspect((1, 1, 1), zoom=1.05)
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_pane_color((1, 1, 1, 0))
        axis.line.set_color(FAINT)
        axis.set_label_text(f"{name} in mm")
        axis.set_major_locator(MaxNLocator(5))
        axis._axinfo["grid"].update(color=FAINT, linewidth=0.6)


_LIKELY, _TRIED = 8, 400
"""Bodies that are drawn beside an estimate, and draws from its interval until there are as many
that can exist. More hide the body, fewer show no spread; near the edge of what can exist one draw
of twenty does."""
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
