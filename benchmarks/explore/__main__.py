"""Exploring and pushing to goals on the simulated table, beside simpler ways."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.explore import actions, changes, detection, estimates, goals, quiet
from benchmarks.page_section import run_sections

SECTIONS = {
    "actions": actions,
    "estimates": estimates,
    "goals": goals,
    "changes": changes,
    "quiet": quiet,
    "detection": detection,
}
"""What measures each section and what makes a table of it; add a line to add one."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sections and print them."""
    run_sections("explore", __doc__, SECTIONS, arguments)
    return 0
