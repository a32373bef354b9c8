"""Tables of an arm's joints as loggers write them: which column is which, and in what units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.conventions import JointReading, read_currents
from tactile_dynamics_ros.core.robot.kinematic_tree import read_tree
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams
from tactile_dynamics_ros.recording.importers.tables.table import Table, read_table

Remap = Mapping[str, str | Sequence[str]]

_WORDS = {
    "time": ("time", "timestamp", "t", "times", "timesec", "stamp"),
    "position": ("position", "q", "actualq", "jointposition", "pos", ""),
    "effort": ("effort", "torque", "tau", "tauj", "jointtorque", "measuredtorque"),
    "current": ("current", "actualcurrent", "motorcurrent", "torqueactualvalue"),
    "target_current": ("targetcurrent",),
    "target_torque": ("targetmoment", "targettorque"),
}
"""Names of columns without signs between letters, as robots and their libraries write them: RTDE of
Universal Robots, libfranka, PlotJuggler, CiA 402 (0x6077, in per mille). A joint's name or number
stands before or behind them."""
_LEADS = ("", "joint", "j", "axis")
"""What may stand before the number of a joint."""
_RATED = (*_WORDS["effort"], *_WORDS["current"], "load", "motorload", "")
"""Names of what drives tell as a share of its rated value."""
_SHARE = re.compile(r"[%‰]|per_?cent|per_?mille?|pct", re.IGNORECASE)
"""Sign that a column is a share of a rated value: units of the drive, as currents are."""
_PREFIX = re.compile(r"^(/?(robot_?)?(joint_?)?states?[./_]+)")
"""Begin of names of columns that says where a logger took them from."""
_ABSURD = 1e6
"""Size of a number from which a row is damaged: no joint turns so far, no drive gives so much, no
recording lasts so long, in s, about its middle."""
_SLOW = 0.5
"""Usual step of time, s, from which stamps are in another unit: nobody records arms at 2 Hz."""


def read_joint_table(
    path: Path, urdf: str, remap: Remap | None = None
) -> tuple[JointStreams, float, dict[str, int]]:
    """Read a table with a column for each joint's position and torque or current.

    Args:
        path: of the table.
        urdf: text of the arm's URDF.
        remap: columns by name or number from 1, or ranges such as 2-7, and what they are: time,
            position, effort, current, target_current or target_torque, joints from the base on.

    Returns:
        What was measured from time zero on, the stamp of time zero in s, and problems with counts.

    Raises:
        BadInputError: it is no such table.
    """
    table = read_table(path)
    joints = [j.name for j in read_tree(urdf, "the arm's URDF") if j.axis is not None]
    columns = _chosen(table, remap) if remap else _recognised(table.names, joints)
    kind = "effort" if columns.get("effort") else "current"
    if not all(columns.get(what) for what in ("time", "position", kind)):
        raise BadInputError(_not_found(path, table, joints[0]))
    count = len(joints) if remap is None else len(columns["position"])
    if len(columns[kind]) != len(columns["position"]) or count > len(joints):
        raise BadInputError(
            f"{path}: {len(columns['position'])} columns of position and {len(columns[kind])} of "
            f"{kind}; expected one of each for the same joints of {', '.join(joints)}"
        )
    places = [k for k in range(count) if columns["position"][k] and columns[kind][k]]
    values = {
        what: table.columns(*(names[k] for k in places))
        for what, names in columns.items()
        if what != "time" and len(names) == count and all(names[k] for k in places)
    }
    time = table.column(columns["time"][0])
    sound = _sound(time, values["position"], values[kind])
    time, values = time[sound], {what: one[sound] for what, one in values.items()}
    problems = dict.fromkeys(table.problems, 1)
    if len(sound) > len(time):
        problems["rows with absurd numbers or stamps that jump back (left out)"] = int(
            len(sound) - len(time)
        )
    if len(time) < 2 or not 0.0 < float(np.median(np.diff(time))) < _SLOW:
        raise BadInputError(f"{path}: column {columns['time'][0]}: expected a time in s")
    names = tuple(joints[k] for k in places)
    streams = JointStreams(names, time - time[0], values["position"], values[kind], urdf)
    if kind == "current":
        reading = _reading(streams, values)
        streams = streams.scaled(reading.factors, reading.gain_std)
        problems[f"read as {reading.name}, {reading.change}; joints"] = len(names)
    return streams, float(time[0]), problems


def _reading(streams: JointStreams, values: Mapping[str, Array]) -> JointReading:
    """How currents are read: by what the controller wanted, where a table has it."""
    targets = [values.get(f"target_{what}") for what in ("torque", "current")]
    if targets[0] is None or targets[1] is None:
        return read_currents(streams)
    return read_currents(streams, (targets[0], targets[1]))


def _sound(time: Array, position: Array, effort: Array) -> NDArray[np.bool_]:
    """(N,) rows whose numbers can be and whose stamps go on."""
    rows = np.column_stack([time - np.nanmedian(time), position, effort])
    sound = np.asarray((np.abs(rows) < _ABSURD).all(axis=1))
    latest = np.maximum.accumulate(np.where(sound, time, -np.inf))
    return sound & np.append(True, time[1:] > latest[:-1])


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", _PREFIX.sub("", name.lower()))


def _recognised(names: Sequence[str], joints: Sequence[str]) -> dict[str, list[str]]:
    """Columns of each quantity, one for each joint; "" where a joint has none."""
    shares = {_plain(_SHARE.sub("", one)): one for one in reversed(names) if _SHARE.search(one)}
    known = {_plain(name): name for name in reversed(names) if name not in shares.values()}
    found = {"time": [known[word] for word in _WORDS["time"] if word in known][:1]}
    for what in list(_WORDS)[1:]:
        choices = _choices(known, _WORDS[what], joints)
        if what == "current":
            choices += _choices(shares, _RATED, joints)
        found[what] = max(choices, key=lambda one: sum(map(bool, one)))
    return {what: one for what, one in found.items() if any(one)}


def _choices(
    known: Mapping[str, str], words: Sequence[str], joints: Sequence[str]
) -> list[list[str]]:
    """Columns of all joints by each of some words, before or behind a joint's name or number."""
    choices = []
    for word in words:
        zero = any(f"{lead}0{word}" in known or f"{word}{lead}0" in known for lead in _LEADS)
        first = 0 if zero else 1
        numbers = [str(k + first) for k in range(len(joints))]
        numbered = [[lead + one for one in numbers] for lead in _LEADS if lead or word]
        for keys in ([_plain(joint) for joint in joints], *numbered):
            for form in ("{w}{k}", "{k}{w}"):
                choices.append([known.get(form.format(w=word, k=key), "") for key in keys])
    return choices


def _chosen(table: Table, remap: Remap) -> dict[str, list[str]]:
    """Columns that the user named, with those whose names say it themselves.

    Raises:
        BadInputError: a column or what it stands for is unknown.
    """
    found: dict[str, list[str]] = {}
    for recorded, meant in remap.items():
        what = meant if isinstance(meant, str) else meant[0]
        if what not in _WORDS:
            raise BadInputError(f"--remap {recorded}:={what}: expected {', '.join(_WORDS)}")
        span = re.fullmatch(r"(\d+)(?:-(\d+))?", recorded)
        names = [recorded]
        if recorded not in table.names and span:
            names = list(table.names[int(span[1]) - 1 : int(span[2] or span[1])])
        if not names or not set(names) <= set(table.names):
            raise BadInputError(
                f"--remap {recorded}:={what}: no such column; {table.source} has "
                f"{len(table.names)}: {', '.join(table.names[:8])} ..."
            )
        found.setdefault(what, []).extend(names)
    return found


def _not_found(path: Path, table: Table, joint: str) -> str:
    if not table.has_header:
        return (
            f"{path}: {len(table.names)} columns without names; say what they are, as --remap "
            "1:=time --remap 2-7:=position --remap 14-19:=effort (or current)"
        )
    return (
        f"{path}: columns {', '.join(table.names[:8])} ...; expected time, and for joints as "
        f"{joint} columns {joint}_position and {joint}_effort, or q_1, tau_1; others by --remap "
        "COLUMN:=time (position, effort, current)"
    )
