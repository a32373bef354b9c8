"""Self-contained HTML pages: sentences first, then figures and tables, everything inside."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.report.style import WIDTH, to_png
from tactile_dynamics_ros.version import __version__

PAGE_NAME = "report.html"


@dataclass(frozen=True)
class Picture:
    """A figure with the name of its file, what it shows, and how to read it."""

    name: str
    figure: Figure
    alternative: str
    caption: str = ""


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another page."""

    text: str
    target: str


@dataclass(frozen=True)
class Section:
    """A heading with sentences, then pictures, then a table.

    Attributes:
        title: heading.
        sentences: paragraphs.
        pictures: figures in order.
        header: names of the table's columns.
        rows: the table; the first cell of a row is its name.
    """

    title: str
    sentences: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    header: Sequence[str] = ()
    rows: Sequence[Sequence[str | Link]] = ()


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: of the page.
        verdict: one plain sentence that says the most important thing.
        good: whether the verdict is good news.
        sentences: what else a reader should know first.
        sections: the rest.
        source: the recording.
        command: how to make the page again.
    """

    title: str
    verdict: str
    good: bool
    source: str
    command: str
    sentences: Sequence[str] = ()
    sections: Sequence[Section] = field(default_factory=tuple)


def write_page(page: Page, folder: Path) -> Path:
    """Write report.html with all figures inside, and each figure as a PNG beside it.

    Args:
        page: content.
        folder: made if it does not exist.

    Returns:
        The path of the HTML file.

    Raises:
        BadInputError: the folder cannot be written.
    """
    images = {p.name: to_png(p.figure) for s in page.sections for p in s.pictures}
    environment = Environment(
        loader=PackageLoader("tactile_dynamics_ros.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    encoded = {name: base64.b64encode(png).decode() for name, png in images.items()}
    html = environment.get_template(PAGE_NAME).render(
        page=page, images=encoded, version=__version__, full_width=WIDTH
    )
    files = {f"{name}.png": png for name, png in images.items()} | {PAGE_NAME: html.encode()}
    for name, content in files.items():
        with written_whole(folder / name) as part:
            part.write_bytes(content)
    return folder / PAGE_NAME
