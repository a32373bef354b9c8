"""Pictures of what a filter on the mechanics believes while objects are pushed and pulled.

`python -m benchmarks.planar.pictures --images docs/figures`: one object of each family and action
over all its pushes, and errors of several after each push, as paper B's Fig. 11 to 14 and 22 to 26.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.planar.__main__ import Kept, process_of, ranges_of
from benchmarks.planar.scores import scored
from benchmarks.planar.trial import (
    GRAVITY,
    INSIDE,
    Population,
    begun,
    described,
    follow,
    simulated,
    truth_of,
)
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.dual import DualConfig
from tactile_dynamics_ros.report.style import (
    BLUE,
    FAINT,
    ORANGE,
    SERIES,
    house_style,
    new_figure,
    to_png,
)
from tactile_dynamics_ros.synthetic.pushed.sensed import SensedStep, sensed_steps
from tactile_dynamics_ros.synthetic.pushed.transitions import true_parameters

CASES = tuple(
    (family, action)
    for action in ("push", "pull")
    for family in ("single", "rigid_pair", "jointed")
)
"""Families and actions of paper B's tables."""
NAMED = {"single": "one part", "rigid_pair": "rigid pair", "jointed": "parts on a joint"}
"""Families in the words of the documentation."""
_SHOWN = {"q1": "friction force of link 1", "com1": "centre of link 1", "q2": "force of link 2"}
"""Quantities whose errors are drawn after each interaction."""
_STEP = 1.0 / 15.0
"""s, of the filter: paper B's rate."""
_COLOURS = (BLUE, ORANGE)
"""Of the first and the second part."""


@dataclass(frozen=True, eq=False)
class Trace:
    """What a filter believed of one object after each touched step.

    Attributes:
        mean, std: (N, 4 L) of ln product, ln mass and centre (m) of each part.
        truth: (4 L,) of the same.
        error, error_std: (N, 3 L) of the poses, m and rad.
        ends: (K,) steps with which pushes end. values: quantities after each push.
    """

    mean: Array
    std: Array
    truth: Array
    error: Array
    error_std: Array
    ends: NDArray[np.intp]
    values: list[dict[str, float]]


def traced(one: Any, population: Population, seed: int) -> Trace:
    """Let the filter on the mechanics follow one recording at 15 Hz."""
    process, steps = process_of("patch", one, "slow"), sensed_steps(one, _STEP, seed)
    belief = begun(process, population.prior(process), steps, DualConfig(seed=seed))
    size, count = 4 * process.links, 0
    rows: list[tuple[Array, Array, Array]] = []
    values: list[dict[str, float]] = []
    ends: list[int] = []

    samples = np.cumsum([len(action.path) for action in one.scene.actions])
    last = set(np.minimum(one.motion.time[samples - 1] // _STEP, len(steps)).astype(int))

    def watch(step: SensedStep) -> None:
        nonlocal count
        count += 1
        if step.motion is not None:
            mean, covariance = belief.parameters
            spread = np.sqrt(np.diag(belief.state[1])).reshape(-1, 6)[:, :3].ravel()
            rows.append((mean[:size], np.sqrt(np.diag(covariance))[:size], spread))
        if count in last:
            ends.append(len(rows))
            values.append(described(*belief.parameters, process, one.scene)["values"])

    after = follow(belief, steps, "patch", watch=watch)
    mean, std, spread = (np.array(part) for part in zip(*rows, strict=True))
    error = np.array([each.error for each in after])
    truth = true_parameters(one.scene)[:size]
    return Trace(mean, std, truth, error, spread, np.array(ends), values)


def draw_beliefs(traces: dict[tuple[str, str], Trace]) -> Figure:
    """Products, centres and errors of the poses with their 90 % bands, a column for each case.

    Blue is the first part, orange the second; x is a full line, y a dotted one, truth dashed.
    """
    figure = new_figure(7.2, 2.1 * len(traces) + 1.0)
    panels = figure.subplots(4, len(traces), sharey="row", squeeze=False)
    for column, (case, trace) in zip(panels.T, traces.items(), strict=True):
        x = np.arange(len(trace.mean)) * _STEP
        for k, colour in zip(range(len(trace.truth) // 4), _COLOURS, strict=False):
            product = GRAVITY * np.exp(trace.truth[4 * k])
            _band(column[0], x, trace.mean[:, 4 * k], trace.std[:, 4 * k], colour, np.exp, GRAVITY)
            column[0].axhline(product, color=colour, linestyle="--", linewidth=0.8)
            for axis, style in ((2, "-"), (3, ":")):
                own, to_mm = 4 * k + axis, 1e3
                off = to_mm * (trace.mean[:, own] - trace.truth[own])
                _band(column[1], x, off, to_mm * trace.std[:, own], colour, style=style)
            place, turn = 3 * k, 3 * k + 2
            for axis, style in ((place, "-"), (place + 1, ":")):
                off, std = 1e3 * trace.error[:, axis], 1e3 * trace.error_std[:, axis]
                _band(column[2], x, off, std, colour, style=style)
            off, std = np.rad2deg(trace.error[:, turn]), np.rad2deg(trace.error_std[:, turn])
            _band(column[3], x, off, std, colour)
        for axes in column:
            for end in trace.ends[:-1]:
                axes.axvline(end * _STEP, color=FAINT, linewidth=1.0)
        column[0].set_title(f"{NAMED[case[0]]}, {case[1]}ed", fontsize=8)
        column[-1].set_xlabel("touched for, s")
    names = ("friction force, N", "centre less truth, mm", "place less truth, mm", "yaw, deg")
    for axes, name in zip(panels[:, 0], names, strict=True):
        axes.set_ylabel(name)
    panels[0, 0].set_yscale("log")
    return figure


def _band(
    axes: Axes,
    x: Array,
    mean: Array,
    std: Array,
    colour: str,
    shown: Callable[[Array], Array] = lambda v: v,
    size: float = 1.0,
    style: str = "-",
) -> None:
    """A line with its 90 % band."""
    low, high = (size * shown(mean + sign * INSIDE * std) for sign in (-1.0, 1.0))
    axes.plot(x, size * shown(mean), style, color=colour, linewidth=1.0)
    axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)


def draw_errors(errors: dict[tuple[str, str], list[dict[str, float]]]) -> Figure:
    """Errors of products and centres over the range of the set, before and after each push."""
    figure = new_figure(2.6)
    panels = figure.subplots(1, len(_SHOWN), sharey=True)
    for axes, (key, name) in zip(panels, _SHOWN.items(), strict=True):
        for colour, (case, rows) in zip(SERIES, errors.items(), strict=False):
            told = [row[key]["mean"] for row in rows if key in row]
            if told:
                label = f"{NAMED[case[0]]}, {case[1]}ed"
                axes.plot(range(len(told)), told, "o-", color=colour, markersize=3, label=label)
        axes.set(title=name, xlabel="interactions")
    panels[0].set_ylabel("NRMSE")
    panels[0].set_ylim(bottom=0.0)
    named = panels[0].get_legend_handles_labels()
    figure.legend(*named, loc="outside upper center", ncols=3, fontsize=7)
    return figure


def errors_of(
    family: str, population: Population, ones: Sequence[Any], traces: Sequence[Trace]
) -> list[dict[str, Any]]:
    """NRMSE of each quantity before any push and after each that all recordings have."""
    truths, ranges = [truth_of(one.scene) for one in ones], ranges_of(family)
    first = [population.means()] * len(ones)
    told = [first, *zip(*[trace.values for trace in traces], strict=False)]
    return [scored(list(values), truths, ranges) for values in told]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write both pictures, and errors as numbers on stdout."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=Path, required=True, metavar="DIR")
    parser.add_argument("--first", type=int, default=331, help="number of the first object")
    parser.add_argument("--objects", type=int, default=6, help="of each family and action")
    parser.add_argument("--keep", type=Path, help="folder from which an interrupted run goes on")
    options = parser.parse_args(arguments)
    options.images.mkdir(parents=True, exist_ok=True)
    shown, errors = {}, {}
    for family, action in CASES:
        seeds = range(options.first, options.first + options.objects)
        keep = Kept(options.keep, f"{family}_slow_{action}_{seeds.start}_{seeds.stop}")
        ones = keep.of("pushes", partial(simulated, seeds, family, "slow", action))
        population = Population.of(family)
        traces = [
            keep.of(f"trace_{k}", partial(traced, one, population, k)) for k, one in enumerate(ones)
        ]
        shown[family, action] = traces[0]
        errors[family, action] = errors_of(family, population, ones, traces)
        for key in _SHOWN:
            said = [f"{row[key]['mean']:.3f}" for row in errors[family, action] if key in row]
            print(f"{family}, {action}, {key}: {' '.join(said)}", flush=True)
    with house_style():
        (options.images / "pushing_beliefs.png").write_bytes(to_png(draw_beliefs(shown)))
        (options.images / "pushing_errors.png").write_bytes(to_png(draw_errors(errors)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
