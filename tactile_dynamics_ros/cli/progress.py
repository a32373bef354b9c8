"""Text on the terminal: signs that it can show, a line on what long work does."""

from __future__ import annotations

import codecs
import io
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tactile_dynamics_ros.core.progress import told_to

_PLAIN = {"±": "+-", "²": "^2", "³": "^3", "µ": "u", "°": " deg", "→": "->"}
"""Signs that texts have beside ASCII, as ASCII writes them; any other becomes a question mark."""


def write_plain_where_needed() -> None:
    """Let stdout and stderr replace what they cannot encode instead of raising."""
    codecs.register_error("plain", _replace)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plain")


def _replace(error: UnicodeError) -> tuple[str, int]:
    """Return the signs that could not be encoded in ASCII, and where to go on."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    return "".join(_PLAIN.get(sign, "?") for sign in signs), error.end


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
