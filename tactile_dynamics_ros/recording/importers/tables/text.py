"""The text of a file, or of a member of a tar archive, in whatever encoding it was written."""

from __future__ import annotations

import codecs
import tarfile
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Marks at the beginning of a file and the encoding they stand for; 32 bits before 16, since one
mark begins with the other."""
_LOOKED_AT = 4096
"""Bytes at the beginning in which zero bytes are counted."""
_ZEROS = 0.3
"""Share of zero bytes from which a text without a mark is UTF-16: half of all bytes of ASCII text
in it, none in others."""


def read_text(path: Path) -> str:
    """Return the text of a file, or of a member of a tar archive below which the path leads.

    Raises:
        BadInputError: it cannot be read, or is no text.
    """
    try:
        inside = path.parent.is_file() and tarfile.is_tarfile(path.parent)
        content = _read_member(path) if inside else path.read_bytes()
    except OSError as error:
        raise BadInputError(f"{path} cannot be read: {error.strerror or 'no archive'}") from error
    return decode_text(content, str(path))


def decode_text(content: bytes, source: str) -> str:
    """Return the text behind bytes; UTF-8 and UTF-16 are told apart, else it is Latin-1.

    Raises:
        BadInputError: there are bytes that no text has.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return content.decode(encoding, errors="replace")
    head = content[:_LOOKED_AT]
    if head and head.count(0) > _ZEROS * len(head):
        odd = sum(byte == 0 for byte in head[1::2])
        little = 2 * odd > head.count(0)
        return content.decode("utf-16-le" if little else "utf-16-be", errors="replace")
    if 0 in head:
        raise BadInputError(f"{source} cannot be read: not a text file")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _read_member(path: Path) -> bytes:
    """Return the archive member with the path's name."""
    with tarfile.open(path.parent) as archive:
        for member in archive:
            if Path(member.name).name == path.name:
                content = archive.extractfile(member)
                return content.read() if content else b""
    raise BadInputError(f"{path.parent} holds no {path.name}")
