"""Names of columns in parts: what is measured, which component, in which unit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

_UNITS = {
    "s": ("time", "s"),
    "sec": ("time", "s"),
    "secs": ("time", "s"),
    "seconds": ("time", "s"),
    "second": ("time", "s"),
    "ms": ("time", "ms"),
    "msec": ("time", "ms"),
    "milliseconds": ("time", "ms"),
    "us": ("time", "us"),
    "µs": ("time", "us"),
    "usec": ("time", "us"),
    "microseconds": ("time", "us"),
    "ns": ("time", "ns"),
    "nsec": ("time", "ns"),
    "nanoseconds": ("time", "ns"),
    "m": ("length", "m"),
    "meters": ("length", "m"),
    "metres": ("length", "m"),
    "cm": ("length", "cm"),
    "mm": ("length", "mm"),
    "millimeters": ("length", "mm"),
    "n": ("force", "N"),
    "newton": ("force", "N"),
    "kn": ("force", "kN"),
    "mn": ("force", "mN"),
    "kgf": ("force", "kgf"),
    "lbf": ("force", "lbf"),
    "lb": ("force", "lbf"),
    "nm": ("torque", "N m"),
    "nmm": ("torque", "N mm"),
    "mnm": ("torque", "mN m"),
    "ncm": ("torque", "N cm"),
    "lbfin": ("torque", "lbf in"),
    "lbin": ("torque", "lbf in"),
    "rad": ("angle", "rad"),
    "radians": ("angle", "rad"),
    "deg": ("angle", "deg"),
    "degrees": ("angle", "deg"),
    "°": ("angle", "deg"),
}
"""Units as people write them, blanks and signs left out: quantity and the name in mappings."""
_TRAILING = frozenset(
    ["ms", "us", "ns", "mm", "cm", "deg", "rad", "nm", "nmm", "mnm", "kgf", "lbf"]
)
"""Units that may follow a name behind an underscore and are no component themselves."""
_SHORT = frozenset(["m", "s", "n"])
"""Units of one letter, which stand behind an underscore only after a component or a time."""
_STUCK = re.compile(
    r"(f|t|m|n|tau|p|r|q|a|w|g|o|v|acc|gyr|gyro|pos|force|torque|moment|quat|rot|mom|trq)([xyzw])"
)
"""A quantity and its component in one word, as fx, qw, posx."""
_CASED = re.compile(r"(.+[^A-Za-z])(mN|mNm|kN|Nm|Nmm|Ncm|mm|cm)_?")
"""A unit at the end whose letters would be parted as if they were words."""
_PARTS = frozenset(["x", "y", "z", "w", "roll", "pitch", "yaw"])
"""Words that are components."""


@dataclass(frozen=True)
class ColumnName:
    """Name of one column.

    Attributes:
        column: as the file has it.
        stem: what is measured, in words, small letters.
        part: component: x, y, z, w, roll, pitch, yaw, a number; "" if it is none.
        quantity: of the unit, such as "length"; "" if no unit is written.
        unit: in the words of mappings; "" if none is written.
    """

    column: str
    stem: tuple[str, ...]
    part: str
    quantity: str = ""
    unit: str = ""


def read_name(column: str, written_unit: str = "") -> ColumnName:
    """Take the name of a column apart.

    Args:
        column: the name.
        written_unit: from a row of units, if there is one.
    """
    bracketed = re.search(
        r"[\[(<{]([^\])>}]*[A-Za-z°µ][^\])>}]*)[\])>}]|/\s*(N|Nm|mm|m|s|rad)$", column
    )
    text, unit = column, written_unit
    if bracketed and _known(bracketed[1] or bracketed[2]):
        text = column[: bracketed.start()] + column[bracketed.end() :]
        unit = unit or bracketed[1] or bracketed[2]
    cased = _CASED.fullmatch(text)
    if cased and not unit:
        text, unit = cased[1], cased[2]
    words = _words(text)
    if len(words) > 1 and not unit and _may_be_unit(words):
        unit = words.pop()
    if len(words) == 1 and not unit and _UNITS.get(words[0], ("", ""))[0] == "time":
        words, unit = ["time"], words[0]
    quantity, name = _UNITS.get(_bare(unit), ("", ""))
    stem, part = _component(words)
    return ColumnName(column, tuple(stem), part, quantity, name)


def read_names(columns: Sequence[str], units: Mapping[str, str]) -> list[ColumnName]:
    """Take all names apart."""
    return [read_name(column, units.get(column, "")) for column in columns]


def _known(text: str) -> bool:
    return _bare(text) in _UNITS


def _bare(text: str) -> str:
    return re.sub(r"[\s*·.\-]", "", text).lower()


def _words(text: str) -> list[str]:
    """Parts of a name: CamelCase, signs and digits part them."""
    text = re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1_\2", text)
    text = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", text)
    text = re.sub(r"([A-Za-z])(\d)", r"\1_\2", text)
    return [word.lower() for word in re.split(r"[^A-Za-z0-9]+", text) if word]


def _may_be_unit(words: Sequence[str]) -> bool:
    last, before = words[-1], words[-2]
    if last in _TRAILING:
        return True
    component = before in _PARTS or _STUCK.fullmatch(before) or before in ("t", "time", "stamp")
    return last in _SHORT and bool(component)


def _component(words: list[str]) -> tuple[list[str], str]:
    """Part the component from what is measured."""
    if not words:
        return [], ""
    last = words[-1]
    if len(words) > 2 and last.isdigit() and words[-2].isdigit() and len(last + words[-2]) == 2:
        return words[:-2], words[-2] + last
    if last in _PARTS or last.isdigit():
        return words[:-1], last
    for k in reversed(range(len(words))):
        stuck = _STUCK.fullmatch(words[k])
        if stuck:
            return [*words[:k], stuck[1], *words[k + 1 :]], stuck[2]
        if words[k] in ("x", "y", "z") and len(words) > 1:
            return [*words[:k], *words[k + 1 :]], words[k]
    return words, ""
