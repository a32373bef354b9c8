"""The text of a file, or of a member of a tar archive, in whatever encoding it was written."""

from __future__ import annotations

import codecs
import tarfile
import zlib
from lzma import LZMAError
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import require_file

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Marks at the beginning of a file and the encoding they stand for; 32 bits before 16, since one
mark begins with the other."""
_FREE, _MOST_EXPANSION = 8 << 20, 200
"""Bytes to which a table in an archive may expand in any case, and for each byte of the archive
beyond: numbers as text shrink to a third, columns of one number to a hundredth."""
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
        content = _read_member(path) if inside else require_file(path, "a table").read_bytes()
    except (OSError, EOFError, tarfile.TarError, zlib.error, LZMAError) as error:
        reason = getattr(error, "strerror", None) or error or "no archive"
        raise BadInputError(f"{path} cannot be read: {reason}") from error
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
                if content is None:
                    return b""
                allowed = _FREE + _MOST_EXPANSION * path.parent.stat().st_size
                found = content.read(allowed + 1)
                if len(found) > allowed:
                    raise BadInputError(
                        f"{path} expands to more than {allowed >> 20} MB, {_MOST_EXPANSION} times "
                        "the size of its archive and more"
                    )
                return found
    raise BadInputError(f"{path.parent} holds no {path.name}")
