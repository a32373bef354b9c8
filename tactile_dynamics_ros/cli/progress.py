"""A line on the terminal that says what long work is doing."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tactile_dynamics_ros.core.progress import told_to

_LETTERS = 72
"""Letters of a step that are shown: with the time in front the line fits a terminal of 80, where a
longer one would wrap and stay."""
_AT_ONCE = "\r\033[K"
"""Back to the beginning of the line, and it is empty: what every terminal since VT100 does."""


@contextmanager
def shown_progress(quiet: bool = False) -> Iterator[None]:
    """Show each step of what is done inside on stderr, if that is a terminal.

    Args:
        quiet: show nothing, as where a program reads the answer.
    """
    if quiet or not sys.stderr.isatty():
        yield
        return
    begin = time.monotonic()

    def show(step: str) -> None:
        passed = f"{time.monotonic() - begin:4.0f} s"
        print(f"{_AT_ONCE}{passed}  {step[:_LETTERS]}", end="", file=sys.stderr, flush=True)

    try:
        with told_to(show):
            yield
    finally:
        print(_AT_ONCE, end="", file=sys.stderr, flush=True)
