"""Seeded mutations of files: bytes, words of a text, and values of a yaml document."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

VALUES: tuple[Any, ...] = (
    None,
    True,
    5,
    -1,
    0,
    1e300,
    -1e-300,
    float("nan"),
    float("inf"),
    "abc",
    "",
    [],
    {},
    [[]],
    [1, 2],
    {"a": 1},
    "c" * 5000,
    10**30,
)
"""What is put in place of a value of yaml."""
WORDS = (
    "nan",
    "inf",
    "-1",
    "0",
    "1e400",
    "-1e-400",
    "9^9^9^9",
    "1/0",
    "\0",
    "(" * 300,
    "-" * 300,
    "[" * 300,
    "&a [*a, *a]",
    "*a",
    "!!int x",
    "9" * 5000,
    "1:" * 2000,
    "<!ENTITY a 'b'>",
    "é\u202e",
    ",,,,",
    "\n\n",
    "exp(exp(99))",
    "sqrt(-1)",
    "max(c, d)",
    "2001-99-99",
    "#",
)
"""What is put into a text, or in place of one of its words."""
_MOST = 4
"""Mutations of one file at most: more leave nothing that is read beyond its first lines."""

Change = Callable[[bytes, np.random.Generator], bytes]


def mutated(path: Path, is_text: bool, rng: np.random.Generator) -> bytes:
    """Return the content of a file after one to four mutations.

    Args:
        path: of the good file.
        is_text: whether its words and values may be changed too.
        rng: draws the mutations.
    """
    content = path.read_bytes()
    if path.suffix in (".yaml", ".yml") and rng.random() < 0.6:
        return _other_values(content, rng)
    changes: tuple[Change, ...] = (_flipped, _cut, _doubled, _truncated, _overwritten)
    if is_text:
        changes = (_word_replaced, _word_replaced, _word_put_in, _lines_swapped, *changes)
    for _ in range(rng.integers(1, _MOST + 1)):
        content = changes[rng.integers(len(changes))](content, rng) if content else content
    return content


def _place(content: bytes, rng: np.random.Generator, most: int = 64) -> tuple[int, int]:
    """Return where a piece of a content begins and ends."""
    start = int(rng.integers(len(content)))
    return start, min(len(content), start + int(rng.integers(1, most + 1)))


def _flipped(content: bytes, rng: np.random.Generator) -> bytes:
    data = bytearray(content)
    for index in rng.integers(len(data), size=rng.integers(1, 9)):
        data[index] ^= 1 << int(rng.integers(8))
    return bytes(data)


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = _place(content, rng)
    return content[:start] + content[end:]


def _doubled(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = _place(content, rng)
    return content[:end] + content[start:end] * int(rng.integers(1, 20)) + content[end:]


def _truncated(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _overwritten(content: bytes, rng: np.random.Generator) -> bytes:
    """Write a number that lengths and counts of binary files do not have."""
    start, _ = _place(content, rng)
    odd = (0, 1, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1)[rng.integers(6)]
    piece = odd.to_bytes(8, "little")[: int(rng.choice([1, 2, 4, 8]))]
    return content[:start] + piece + content[start + len(piece) :]


def _word(rng: np.random.Generator) -> bytes:
    return WORDS[rng.integers(len(WORDS))].encode()


def _word_put_in(content: bytes, rng: np.random.Generator) -> bytes:
    start, _ = _place(content, rng)
    return content[:start] + _word(rng) + content[start:]


def _word_replaced(content: bytes, rng: np.random.Generator) -> bytes:
    """Put a word in place of what stands between two blanks, commas or brackets."""
    start, _ = _place(content, rng)
    ends = [content.find(mark, start + 1) for mark in (b" ", b",", b"\n", b")", b'"', b">")]
    end = min((one for one in ends if one > 0), default=len(content))
    marks = (b" ", b",", b"\n", b"(", b'"', b"<")
    begin = max(content.rfind(mark, 0, start + 1) for mark in marks) + 1
    return content[:begin] + _word(rng) + content[end:]


def _lines_swapped(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    i, j = rng.integers(len(lines), size=2)
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _other_values(content: bytes, rng: np.random.Generator) -> bytes:
    """Replace, add or take away values anywhere in a yaml document."""
    document = yaml.safe_load(content)
    for _ in range(rng.integers(1, _MOST)):
        places = list(_places(document))
        if not places:
            break
        holder, key = places[rng.integers(len(places))]
        if rng.random() < 0.2:
            del holder[key]
        else:
            holder[key] = VALUES[rng.integers(len(VALUES))]
    return yaml.safe_dump(document, sort_keys=False).encode()


def _places(node: Any) -> list[tuple[Any, Any]]:
    """Return every value of a document as what holds it and the key there."""
    keys = list(node) if isinstance(node, dict) else range(len(node))
    found = [(node, key) for key in keys]
    for key in keys:
        if isinstance(node[key], dict | list):
            found += _places(node[key])
    return found
