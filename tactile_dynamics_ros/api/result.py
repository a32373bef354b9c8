"""What all results have in common: a document, lines, a figure, a page."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def align_rows(rows: Sequence[Sequence[str]], indent: int = 2) -> str:
    """Return rows of cells as lines with aligned columns; the first column to the left."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    lines = []
    for first, *others in rows:
        cells = [first.ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
        lines.append((" " * indent + "  ".join(cells)).rstrip())
    return "\n".join(lines)


Rows = list[tuple[str, ...]]
"""A table; the first row has the names of its columns."""
_MOST_LINES = 14
"""Lines that a Python shell shows of a result: they fit beside the call on a small terminal, and no
estimate of a body without effects is longer. More is left to `print`."""


class Result(ABC):
    """What a verb found. `print(result)` shows what the command prints.

    Attributes:
        notes: sentences on what was not taken as it is recorded.
    """

    notes: tuple[str, ...] = ()

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """Return the document that the command prints with `--json`."""

    @abstractmethod
    def lines(self) -> list[str]:
        """Return what the command prints, line by line."""

    @abstractmethod
    def headline(self) -> str:
        """Return the result in one sentence."""

    @abstractmethod
    def rows(self) -> Rows:
        """Return the result as a table; empty if there is nothing to tabulate."""

    @abstractmethod
    def draw(self) -> Figure:
        """Return the figure of `plot`, without the look of all figures."""

    def plot(self) -> Figure:
        """Draw the result; a notebook shows the figure, `savefig` writes it."""
        from tactile_dynamics_ros.report.style import house_style

        with house_style():
            return self.draw()

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        """Return what `print` shows, cut to what fits a screen."""
        lines = str(self).splitlines()
        if len(lines) <= _MOST_LINES:
            return "\n".join(lines)
        shown = [self.headline(), *lines[: _MOST_LINES - 2]]
        return "\n".join([*shown, f"... {len(lines)} lines: print(result) shows all"])

    def _repr_html_(self) -> str:
        """Return the headline, the notes and the table for a notebook."""
        paragraphs = [f"<p><b>{escape(self.headline())}</b></p>"]
        paragraphs += [f"<p>note: {escape(note)}</p>" for note in self.notes]
        return "\n".join(paragraphs) + html_table(self.rows())


class ReportedResult(Result):
    """A result with a page of its own."""

    @abstractmethod
    def report(self, folder: Path, command: str = "") -> Path:
        """Write folder/report.html with all figures and return its path."""


def html_table(rows: Rows) -> str:
    """Return a table as HTML; nothing if there are no rows below its head."""
    if len(rows) < 2:
        return ""
    head, *body = rows
    cells = [_row("th", head), *(_row("td", row) for row in body)]
    return "\n<table>\n" + "\n".join(cells) + "\n</table>"


def _row(tag: str, cells: tuple[str, ...]) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"
