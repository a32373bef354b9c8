"""Sections of a Markdown page that programs write, each between two comments."""

from __future__ import annotations


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
