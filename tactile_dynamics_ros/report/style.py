"""One look for all figures: sizes, colours, light axes, and PNG bytes."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os.path import commonprefix
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, QUIET, FAINT = "#22303c", "#6b7a86", "#dfe5ea"
BLUE, ORANGE, GREEN, RED = "#2f6db3", "#d9822b", "#2e9e77", "#c8423b"
PURPLE, GOLD, TEAL, GREY = "#7a5ea8", "#b59a1d", "#3aa6b9", "#9aa7b1"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, TEAL, GOLD, RED, GREY)
AXIS_COLOURS = {"x": RED, "y": GREEN, "z": BLUE}

WIDTH = 9.0
DPI = 130
MOST_POINTS = 1500
_FEW_LABELS = 4
"""Names in a legend that are written out; of more that begin alike only the first is."""

_PARAMETERS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": GREY,
    "axes.labelcolor": QUIET,
    "axes.titlecolor": INK,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 7.0,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.7,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.size": 0.0,
    "ytick.major.size": 0.0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@contextmanager
def house_style() -> Iterator[None]:
    """Apply the look to figures that are made and saved inside."""
    with mpl.rc_context(_PARAMETERS):
        yield


class NotebookFigure(Figure):
    """A figure that notebooks show without pyplot."""

    def _repr_png_(self) -> bytes:
        return to_png(self)


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """Return an empty figure that lays itself out; sizes in inches."""
    return NotebookFigure(figsize=(width, height), dpi=DPI, layout="constrained")


def to_png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def thinning(count: int) -> slice:
    """Return a slice that leaves no more points of a line than a figure can show."""
    return slice(None, None, max(1, count // MOST_POINTS))


def label_lines(axes: Axes, labels: Sequence[str], **options: Any) -> None:
    """Add a legend in one row above the right end of the axes; many names of one kind are cut."""
    handles, _ = axes.get_legend_handles_labels()
    same = len(commonprefix(labels)) if len(labels) > _FEW_LABELS else 0
    axes.legend(
        handles[: len(labels)],
        [labels[0], *(label[same:] or label for label in labels[1:])],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(labels),
        borderaxespad=0.2,
        handlelength=1.4,
        columnspacing=1.2,
        **options,
    )


def colour_of(index: int) -> str:
    """Return the colour of the n-th series."""
    return SERIES[index % len(SERIES)]
