"""Pushed objects: friction, mass and centre of mass, on real and simulated pushes."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.page_section import run_sections
from benchmarks.pushed import (
    conventions,
    diagnoses,
    linked,
    live,
    live_effect,
    manners,
    real,
    simulated,
    stiffness,
)

SECTIONS = {
    "conventions": conventions,
    "diagnoses": diagnoses,
    "linked": linked,
    "live_effect": live_effect,
    "live": live,
    "manners": manners,
    "real": real,
    "simulated": simulated,
    "stiffness": stiffness,
}
"""What measures each section and what makes a table of it; add a line to add one."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sections and print them; 1 if one had to be skipped."""
    found = run_sections("pushed", __doc__, SECTIONS, arguments)
    return int(any("skipped" in section for section in found.values()))
