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
    """Errors per box beside paper A's rows, on a wrist sensor and in the hand.

    Ours as box plots (quartiles, 5 and 95 %) where every run was kept, else as medians.
    """
    figure = new_figure(3.4)
    panels = figure.subplots(1, 2)
    kinds = [
        ("wrist_ft", "ours", "wrist: ours", BLUE),
        ("wrist_ft", "paper", "wrist: paper A", GREY),
        ("in_hand", "ours", "hand: ours", GREEN),
        ("in_hand", "paper's method here", "hand: its method here", ORANGE),
        ("in_hand", "paper", "hand: paper A", RED),
    ]
    for axes, (key, label) in zip(
        panels, (("mass_percent", "mass, %"), ("com_mm", "centre of mass, mm")), strict=True
    ):
        for k, (table, row, name, colour) in enumerate(kinds):
            rows = results[table]["rows"]
            places = np.arange(len(rows)) + 0.16 * (k - 2)
            if row == "ours" and all("each" in r for r in rows):
                _draw_runs(axes, places, [r["each"][key] for r in rows], colour)
                axes.bar([], [], color=colour, label=f"{name}, n = {rows[0]['runs']}")
            else:
                axes.bar(places, [r[row][key] for r in rows], 0.15, color=colour, label=name)
        axes.set(yscale="log", ylabel=f"error of {label}")
        axes.set_xticks(range(len(rows)), [r["object"] for r in rows])
    named = panels[0].get_legend_handles_labels()
    figure.legend(*named, loc="outside upper center", ncols=len(kinds), fontsize=7)
    return figure


def _draw_runs(axes: Axes, places: np.ndarray, runs: list[list[float]], colour: str) -> None:
    axes.boxplot(
        runs, positions=places, widths=0.14, whis=(5, 95), showfliers=False, patch_artist=True,
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
