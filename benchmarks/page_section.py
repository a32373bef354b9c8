"""Sections of a Markdown page that programs write, each between two comments."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

Outcome = TypeVar("Outcome")
"""What a benchmark finds in one recording."""


def replace_section(page: str, section: str) -> str:
    """Return a page with a section replaced, or appended.

    Args:
        page: Markdown; a new page of benchmarks if empty.
        section: its first and last lines are the comments that mark it.
    """
    lines = section.strip("\n").splitlines()
    begin, end = lines[0], lines[-1]
    if begin in page:
        before, _, rest = page.partition(begin)
        return before + section.rstrip("\n") + rest.partition(end)[2]
    return (page.rstrip("\n") or "# Benchmarks") + "\n\n" + section


def write_section_to(page: Path, section: str) -> None:
    """Put a section into a page, which is made if it is not there."""
    page.write_text(replace_section(page.read_text() if page.exists() else "", section))


def compose_section(name: str, text: Sequence[str], command: str, lines: Sequence[str]) -> str:
    """Return a section between its two comments.

    Args:
        name: in the comments.
        text: heading, empty line and prose.
        command: that makes the figures.
        lines: the table, and what follows.
    """
    fenced = ["", "```bash", command, "```", ""]
    marks = [f"<!-- {name}: {end} -->" for end in ("begin", "end")]
    return "\n".join([marks[0], *text, *fenced, *lines, marks[1], ""])


def section_parser(text: str | None, start: int) -> ArgumentParser:
    """Return a parser of what benchmarks with a section of their own take.

    Args:
        text: what the benchmark asks.
        start: first seed, unless another is given.
    """
    parser = ArgumentParser(description=text)
    parser.add_argument("--start", type=int, default=start, help="first seed")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="page that gets the section")
    return parser


def run_sections(
    name: str, text: str | None, sections: Mapping[str, Any], arguments: Sequence[str] | None
) -> dict[str, Any]:
    """Measure the sections that are asked for and print their tables, or JSON alone.

    Args:
        name: of the benchmark.
        text: what it asks.
        sections: modules with `add_arguments`, `measure` and `table`.
        arguments: of the command; those of the process if None.

    Returns:
        What each section found.
    """
    parser = ArgumentParser(prog=f"bench {name}", description=text)
    parser.add_argument("--only", nargs="+", choices=sorted(sections), default=sorted(sections))
    parser.add_argument("--quick", action="store_true", help="few cases of each section")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    for section in sections.values():
        section.add_arguments(parser)
    options = parser.parse_args(arguments)
    found = {}
    for one in options.only:
        found[one] = sections[one].measure(options)
        if not options.json:
            print(f"## {one}\n\n{sections[one].table(found[one])}\n", flush=True)
    if options.json:
        print(json.dumps(found))
    return found


def show(
    outcomes: Iterable[Outcome],
    table: Callable[[Sequence[Outcome]], Sequence[str]],
    section: Callable[[Sequence[Outcome]], str],
    page: Path | None,
) -> int:
    """Print outcomes as they come and their table, write their section if a page is given.

    Returns:
        Exit code of the benchmark.
    """
    found = []
    for outcome in outcomes:
        found.append(outcome)
        print(outcome, file=sys.stderr, flush=True)
    print("\n".join(table(found)))
    if page:
        write_section_to(page, section(found))
    return 0
