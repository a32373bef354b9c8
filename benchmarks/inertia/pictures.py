"""Pictures of forces in the hand and of errors per box, as paper A shows them.

`python -m benchmarks.inertia.pictures --images docs/figures`: a minute of the simulated hand with
box_0, and the same motion without it; errors are those of results.json.
"""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.inertia.page import RESULTS
from benchmarks.wrist import FIRST_SEED, record
from tactile_dynamics_ros.core.streams.streams import ContactStream
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.report.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    house_style,
    new_figure,
    to_png,
)

_DRAWN = {"mass_percent": "mass, %", "com_mm": "centre of mass, mm"}
"""Errors that are drawn, by their key in the results."""
_SHOWN_S = 12.0
"""Seconds that are shown: single motions are seen, and breaks of contact."""


def draw_forces(fingers: Recording, wrist: Recording, empty: Recording) -> Figure:
    """Each fingertip's force with its band; their sum beside what the wrist feels of the object.

    What the wrist feels of the object is its wrench less that of the same motion without object.
    """
    figure = new_figure(4.6)
    above, below = figure.subplots(2, 1, sharex=True)
    contacts = fingers.streams.contacts
    middle = float(np.mean(next(iter(contacts.values())).time))
    for (name, contact), colour in zip(contacts.items(), (BLUE, GREEN, ORANGE, RED), strict=False):
        _draw_band(above, name, contact, colour)
    above.set(ylabel="force, N")
    above.legend(fontsize=7, ncols=4, loc="upper right")
    _shade_breaks(below, list(contacts.values()))
    time = wrist.streams.contacts["wrist"].time + wrist.epoch_ns * 1e-9
    lifted = [part.streams.contacts["wrist"].force[:, 2] for part in (wrist, empty)]
    below.plot(time, lifted[0] - lifted[1], color=GREY, linewidth=0.6, label="wrist, of the object")
    first = next(iter(contacts.values())).time
    total = sum(np.interp(first, c.time, c.force[:, 2]) for c in contacts.values())
    below.plot(first, total, color=BLUE, linewidth=1.0, label="sum of the fingertips")
    below.set(xlabel="time, s", ylabel="upward force, N")
    below.set_xlim(middle - 0.5 * _SHOWN_S, middle + 0.5 * _SHOWN_S)
    below.legend(fontsize=7, loc="upper right")
    return figure


def _draw_band(axes: Axes, name: str, contact: ContactStream, colour: str) -> None:
    size = np.linalg.norm(contact.force, axis=1)
    axes.plot(contact.time, size, color=colour, linewidth=1.0, label=name)
    if contact.force_std is not None:
        along = contact.force / np.maximum(size, 1e-9)[:, None]
        band = 1.96 * np.sqrt(np.sum((along * contact.force_std) ** 2, axis=1))
        axes.fill_between(contact.time, size - band, size + band, color=colour, alpha=0.25, lw=0)


def _shade_breaks(axes: Axes, contacts: Sequence[ContactStream]) -> None:
    """Shade where a fingertip does not touch, or says nothing for a tenth of a second."""
    for contact in contacts:
        touching = contact.time[np.any(contact.force != 0.0, axis=1)]
        for k in np.flatnonzero(np.diff(touching) > 0.1):
            axes.axvspan(touching[k], touching[k + 1], color=GREY, alpha=0.25, lw=0)


def draw_boxes(results: dict[str, Any]) -> Figure:
    """Errors per box beside paper A's rows: on a wrist sensor, and in the hand by either pose.

    Ours as box plots (quartiles, 5 and 95 %) where every run was kept, else as medians.
    """
    figure = new_figure(4.6)
    tables = [
        ("wrist sensor (Table II)", results["wrist_ft"]["rows"]),
        ("in the hand, poses of vision (Table III)", results["in_hand"].get("vision_rows")),
        ("in the hand, published poses (Table IV)", results["in_hand"]["rows"]),
    ]
    columns = [(title, rows) for title, rows in tables if rows]
    panels = figure.subplots(2, len(columns), sharex=True, sharey="row")
    for column, (title, rows) in enumerate(columns):
        for axes, key in zip(panels[:, column], _DRAWN, strict=True):
            _draw_rows(axes, rows, key)
        panels[0, column].set_title(f"{title}, n = {rows[0]['runs']}", fontsize=8)
    for axes, name in zip(panels[:, 0], _DRAWN.values(), strict=True):
        axes.set(yscale="log", ylabel=f"error of {name}")
    named = panels[0, -1].get_legend_handles_labels()
    figure.legend(*named, loc="outside upper center", ncols=3, fontsize=7)
    return figure


def _draw_rows(axes: Axes, rows: Sequence[dict[str, Any]], key: str) -> None:
    """Ours of every run, beside what the paper has and what its method finds here."""
    places = np.arange(len(rows))
    if all("each" in r for r in rows):
        _draw_runs(axes, places, [r["each"][key] for r in rows], BLUE)
    else:
        axes.plot(places, [r["ours"][key] for r in rows], "o", color=BLUE, markersize=4)
    axes.bar([], [], color=BLUE, label="ours")
    for kind, name, mark, colour in (
        ("paper", "paper A", "s", RED),
        ("paper's method here", "its method on one of our recordings", "D", ORANGE),
    ):
        errors = [r[kind].get(key, np.nan) for r in rows]
        axes.plot(places, errors, mark, color=colour, markersize=4, label=name)
    axes.set_xticks(places, [r["object"] for r in rows])


def _draw_runs(
    axes: Axes, places: np.ndarray, runs: Sequence[Sequence[float]], colour: str
) -> None:
    axes.boxplot(
        runs, positions=places, widths=0.5, whis=(5, 95), showfliers=False, patch_artist=True,
        manage_ticks=False, boxprops={"facecolor": colour, "linewidth": 0.6},
        medianprops={"color": "white"}, whiskerprops={"linewidth": 0.6},
        capprops={"linewidth": 0.6},
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Write both pictures."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=Path, required=True, metavar="DIR")
    parser.add_argument("--box", default="box_0")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    options = parser.parse_args(arguments)
    options.images.mkdir(parents=True, exist_ok=True)
    with house_style():
        boxes = draw_boxes(json.loads(RESULTS.read_text()))
        (options.images / "in_hand_boxes.png").write_bytes(to_png(boxes))
        fingers, wrist, empty, _ = record(options.box, options.seed)
        forces = draw_forces(fingers, wrist, empty)
        (options.images / "in_hand_forces.png").write_bytes(to_png(forces))
    return 0


if __name__ == "__main__":
    sys.exit(main())
