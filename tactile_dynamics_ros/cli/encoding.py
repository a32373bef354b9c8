"""Text for terminals whose encoding lacks a sign: ± is then written +-."""

from __future__ import annotations

import codecs
import io
import sys

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
