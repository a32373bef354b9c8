"""Columns that belong together, by the parts of their names."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

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


FORCE = frozenset(["f", "force", "forces", "kraft"])
"""Words for a force."""
TORQUE = frozenset(["t", "m", "n", "tau", "torque", "torques", "moment", "moments", "mom", "trq"])
"""Words for a torque, or for a translation ("t")."""
WRENCH = frozenset(["wrench", "ft", "fts", "force", "forces", "ext", "load"])
"""Words for six numbers of a wrench."""
POSITION = frozenset(
    ["p", "pos", "position", "translation", "trans", "xyz", "location", "loc", "point", "tvec"]
    + ["coord", "coords", "origin", "cart"]
)
"""Words for a position; so are x, y and z alone."""
TURN = frozenset(
    ["q", "quat", "quaternion", "orientation", "ori", "o", "r", "rot", "rotation", "rotvec", "rv"]
    + ["angle", "angles", "euler", "rpy", "axis", "theta", "wpr"]
    + ["rvec", "eul", "ypr", "attitude", "att", "rotation", "winkel", "deg"]
)
"""Words for an orientation."""
POSE = frozenset(["pose", "tcp", "cartesian", "transform", "tool", "ee", "flange"])
"""Words for a pose of six, seven or sixteen numbers."""
OTHER = frozenset(
    ["target", "desired", "des", "cmd", "command", "setpoint", "ref", "reference", "std", "cov"]
    + ["covariance", "speed", "vel", "velocity", "twist", "qd", "qdd", "dq", "ddq", "error", "bias"]
    + ["acc", "accel", "acceleration", "gyro", "gyr", "current", "a", "w", "g", "v", "d", "joint"]
    + ["joints", "temperature", "elbow", "dtau", "nullspace"]
)
"""Words of what is wanted, derived or measured elsewhere."""
ACCELERATION = frozenset(["acc", "accel", "acceleration", "a"])
"""Words for what an accelerometer reads."""
PLAIN = frozenset(["actual", "measured", "field", "data", "value", "raw", "tcp", "tool", "pose"])
"""Words that say nothing of which body or sensor is meant."""
_LONE = (
    ("abc", ("a", "b", "c")),
    ("abc", ("o", "a", "t")),
    ("euler", ("phi", "theta", "psi")),
    ("turn3", ("alpha", "beta", "gamma")),
)
"""Angles that some makers write without any word of what they are."""
_EULER = ("roll", "pitch", "yaw")
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Group:
    """Columns of one quantity, in order.

    Attributes:
        kind: force, torque, position, acceleration, normal, quaternion, quad (a quaternion in
            unknown order), euler, abc, turn3 (three numbers of an orientation), matrix9, matrix12,
            matrix16.
        columns: their names.
        stem: words that they share.
        unit: in the words of mappings; "" if none is written.
    """

    kind: str
    columns: tuple[str, ...]
    stem: tuple[str, ...]
    unit: str = ""

    @property
    def label(self) -> str:
        """Name for people."""
        return f"{self.columns[0]} .. {self.columns[-1]}"

    @property
    def body(self) -> frozenset[str]:
        """Words that say which body or sensor is meant."""
        common = FORCE | TORQUE | POSITION | TURN | WRENCH | PLAIN | {"linear", "angular"}
        return frozenset(self.stem) - common


@dataclass
class Groups:
    """All groups of a table by what they may be."""

    force: list[Group] = field(default_factory=list)
    torque: list[Group] = field(default_factory=list)
    position: list[Group] = field(default_factory=list)
    turn: list[Group] = field(default_factory=list)
    normal: list[Group] = field(default_factory=list)
    acceleration: list[Group] = field(default_factory=list)

    def add(self, group: Group) -> None:
        """Sort a group in."""
        getattr(self, group.kind if hasattr(self, group.kind) else "turn").append(group)


def find_groups(names: Sequence[ColumnName]) -> Groups:
    """Return the groups that names tell."""
    found = Groups()
    by_stem: dict[tuple[str, ...], dict[str, ColumnName]] = defaultdict(dict)
    for name in names:
        if name.part:
            by_stem[name.stem].setdefault(name.part, name)
    lone = {n.stem[-1]: n for n in names if not n.part and len(n.stem) == 1}
    for kind, words in _LONE:
        if set(words) <= set(lone):
            found.add(_group(kind, [lone[word] for word in words], ()))
            break
    bare = by_stem.get((), {})
    if "w" in bare and {"p", "r"} <= set(lone):
        found.add(_group("euler", [bare.pop("w"), lone["p"], lone["r"]], ()))
    for stem, parts in by_stem.items():
        if not OTHER & set(stem) or stem[-1:] == ("r",):
            for group in _of_stem(stem, parts):
                found.add(group)
        elif stem[-1] in ACCELERATION and set(_AXES) <= set(parts):
            found.add(_group("acceleration", [parts[k] for k in _AXES], stem))
    _settle_t(found)
    return found


def _group(kind: str, names: Sequence[ColumnName], stem: tuple[str, ...]) -> Group:
    units = {name.unit for name in names}
    return Group(kind, tuple(n.column for n in names), stem, units.pop() if len(units) == 1 else "")


def _of_stem(stem: tuple[str, ...], parts: dict[str, ColumnName]) -> list[Group]:
    """Groups of the columns that share a stem."""
    words = set(stem)
    groups = []
    if set(_AXES) <= set(parts):
        axes = [parts[k] for k in _AXES]
        if "w" in parts and not words & (FORCE | {"torque", "moment"}):
            groups.append(_group("quaternion", [*axes, parts["w"]], stem))
        elif kind := _kind_of_three(stem, axes):
            groups.append(_group(kind, axes, stem))
    if set(_EULER) <= set(parts):
        groups.append(_group("euler", [parts[k] for k in _EULER], stem))
    numbers = sorted((int(part), name) for part, name in parts.items() if part.isdigit())
    return groups + _of_numbers(stem, [k for k, _ in numbers], [name for _, name in numbers])


def _kind_of_three(stem: tuple[str, ...], axes: Sequence[ColumnName]) -> str:
    """What three components are."""
    words, quantity = set(stem), axes[0].quantity
    if quantity in ("force", "torque"):
        return quantity
    if quantity == "angle":
        return "turn3"
    last = next((word for word in reversed(stem) if word not in PLAIN - POSE), "")
    if words & {"normal"} or last == "normal":
        return "normal"
    if last in TORQUE or words & {"torque", "moment"}:
        return "torque"
    if last in FORCE or words & {"force", "kraft"}:
        return "force"
    if last in TURN or words & {"orientation", "rotation", "euler", "rotvec"}:
        return "turn3"
    if quantity == "length" or not words - PLAIN or last in POSITION | POSE or words & POSITION:
        return "position"
    return "position" if "object" in words or len(stem) == 1 else ""


def _of_numbers(
    stem: tuple[str, ...], numbers: Sequence[int], names: Sequence[ColumnName]
) -> list[Group]:
    """Groups of numbered columns."""
    words = set(stem)
    for rows, columns, kind in ((4, 4, "matrix16"), (3, 4, "matrix12"), (3, 3, "matrix9")):
        for first in (0, 1):
            each = [10 * (i + first) + j + first for i in range(rows) for j in range(columns)]
            if list(numbers) == each:
                return [_group(kind, names, stem)]
    if not numbers or list(numbers) != list(range(numbers[0], numbers[0] + len(numbers))):
        return []
    count = len(numbers)
    if count == 16:
        return [_group("matrix16", names, stem)]
    if count == 9 and words & (TURN | POSE):
        return [_group("matrix9", names, stem)]
    if count == 4 and words & TURN:
        return [_group("quad", names, stem)]
    if count == 3:
        kind = _kind_of_three(stem, names)
        return [_group(kind, names, stem)] if kind and stem else []
    if count == 12 and words & (POSE | TURN):
        return [_group("matrix12", names, stem)]
    if count == 6 and words & (WRENCH | FORCE):
        return [_group("force", names[:3], stem), _group("torque", names[3:], stem)]
    if count == 6 and words & (POSE | POSITION):
        return [_group("position", names[:3], stem), _group("turn3", names[3:], stem)]
    if count == 7 and words & (POSE | POSITION):
        return [_group("position", names[:3], stem), _group("quad", names[3:], stem)]
    return []


def _settle_t(found: Groups) -> None:
    """Decide whether t means torque or translation, where no unit says it."""
    letters = [g for g in found.torque if g.stem[-1:] == ("t",)]
    for group in letters:
        if group.unit in ("m", "cm", "mm") or (not found.position and not found.force):
            found.torque.remove(group)
            found.position.append(Group("position", group.columns, group.stem, group.unit))
