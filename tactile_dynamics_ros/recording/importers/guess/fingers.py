"""A mapping for tables of somebody else: what each column seems to be; several fingers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.bag_tables import is_bag
from tactile_dynamics_ros.recording.importers.fields import UNITS
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.bags import bag_mapping
from tactile_dynamics_ros.recording.importers.guess.groups import Group
from tactile_dynamics_ros.recording.importers.guess.orientations import (
    Reading,
    choose_reading,
    readings_of,
)
from tactile_dynamics_ros.recording.importers.guess.sources import Source, choose_group
from tactile_dynamics_ros.recording.importers.guess.weight import Measured
from tactile_dynamics_ros.recording.importers.guess.wrist import WristGuess

_CLEARLY_STEADIER = 3.0
"""Scatter of contact points in one frame over that in the other from which they are in the other:
fingers hold an object at places that stay."""


@dataclass(frozen=True)
class Finger:
    """Columns of one finger."""

    name: str
    force: Group
    position: Group
    normal: Group | None


def find_fingers(source: Source) -> list[Finger]:
    """Return the fingers of a table: bodies with a force and a position of their own."""
    found = []
    for force in source.groups.force:
        body = [word for word in force.stem if word in force.body]
        places = [g for g in source.groups.position if body and g.body == force.body]
        if len(places) == 1:
            normals = [g for g in source.groups.normal if set(body) <= set(g.stem)]
            found.append(Finger("_".join(body), force, places[0], normals[0] if normals else None))
    return found if len(found) > 1 else []


def held_mapping(
    source: Source,
    fingers: Sequence[Finger],
    answers: Answers,
    note: Callable[[str, str], None],
) -> dict[str, Any]:
    """Return the mapping of a table of an object and fingers.

    Raises:
        Question: neither names nor numbers tell something.
    """
    if source.time is None:
        raise Question("no column is a time; name it with --say time=COLUMN")
    if len(source.time.units) > 1:
        answers.choose("time_unit", source.time.units, f"unit of '{source.time.columns[0]}'")
    own = {finger.position for finger in fingers}
    places = [group for group in source.groups.position if group not in own]
    if not places:
        raise Question("no three columns are the object's position besides those of the fingers")
    turn = source.turn(answers)
    place = places[0] if len(places) == 1 else choose_group(places, "pose", "positions", answers)
    unit = source.length_unit(place, answers)
    position = UNITS["length"][unit] * source.table.columns(*place.columns)
    total = np.sum([source.table.columns(*finger.force.columns) for finger in fingers], axis=0)

    def measured_under(reading: Reading, rotation: Array) -> Measured:
        stamps = source.time.values if source.time else None
        return Measured(total, stamps, rotation, stamps, position)

    readings = [r for r in readings_of(turn, source.table) if not r.inside]
    what = "all fingers together"
    judged = choose_reading(readings, source.table, measured_under, answers, what, False)
    frame = "object" if judged.weighing.axes == "sensor" else "world"
    _require_places(source, fingers, position, judged.rotation, frame)
    sign = 1.0 if judged.weighing.mass > 0.0 else -1.0
    reads = "act on the object" if sign > 0.0 else "are those on the fingers, sign turned"
    columns = judged.reading.entry["columns"]
    note("time", source.describe_time())
    note("position", f"{place.label} in {unit}")
    note("orientation", f"{columns[0]} .. {columns[-1]}: {judged.reading.label}")
    note(
        "forces", f"of {', '.join(f.name for f in fingers)} in N, axes of the {frame}; they {reads}"
    )
    pose = {
        **source.place,
        "time": source.time.entry,
        "position": {"columns": list(place.columns), "unit": unit},
        judged.reading.key: judged.reading.entry,
    }
    contacts = {f.name: _contact(source, f, sign, answers) for f in fingers}
    return {"contact_frame": frame, "object_pose": pose, "contacts": contacts}


def _contact(source: Source, finger: Finger, sign: float, answers: Answers) -> dict[str, Any]:
    """Return the section of one finger."""
    assert source.time is not None
    unit = source.length_unit(finger.position, answers)
    section: dict[str, Any] = {
        **source.place,
        "time": dict(source.time.entry),
        "force": {
            "columns": list(finger.force.columns),
            "unit": finger.force.unit or "N",
            "scale": sign,
        },
        "position": {"columns": list(finger.position.columns), "unit": unit},
    }
    if finger.normal is not None:
        section["normal"] = {"columns": list(finger.normal.columns)}
    return section


def _require_places(
    source: Source, fingers: Sequence[Finger], position: Array, rotation: Array, frame: str
) -> None:
    """Check that the places of the fingers are in the frame of their forces.

    Raises:
        Question: they are steady in the other one.
    """
    scatter = np.zeros(2)
    for finger in fingers:
        factor = UNITS["length"][finger.position.unit or "m"]
        point = factor * source.table.columns(*finger.position.columns)
        inside = np.einsum("nji,nj->ni", rotation, point - position)
        scatter += [np.nanstd(point, axis=0).max(), np.nanstd(inside, axis=0).max()]
    fixed, carried = scatter
    contradicts = (frame == "object" and carried * _CLEARLY_STEADIER < fixed) or (
        frame == "world" and fixed * _CLEARLY_STEADIER < carried
    )
    if contradicts:
        other = "world" if frame == "object" else "object"
        raise Question(
            f"the forces fit in axes of the {frame}, the points of the fingers in those of the "
            f"{other}: turn one of them before importing"
        )


_ORIENTATION = "an orientation (joint angles with the URDF of an arm make one)"
"""What a question calls an orientation."""


@dataclass(frozen=True)
class Guess:
    """What tables seem to say.

    Attributes:
        mapping: content of the yaml file; empty if something has to be asked.
        question: one line; "" if all is clear.
        understood: what each column was taken for, pairs of label and text.
    """

    mapping: dict[str, Any]
    question: str
    understood: list[tuple[str, str]] = field(default_factory=list)


def guess_tables(paths: Sequence[Path], answers: Answers | None = None) -> Guess:
    """Guess the mapping of one table, or of some that share a clock.

    Args:
        paths: of the tables; they lie in one folder.
        answers: to questions.

    Raises:
        BadInputError: a table cannot be read.
    """
    if len({path.parent.resolve() for path in paths}) > 1:
        raise BadInputError("tables of one recording must lie in one folder")
    understood: list[tuple[str, str]] = []
    answers = answers or Answers()
    try:
        mapping = _mapping(paths, answers, understood)
    except Question as question:
        return Guess({}, " ".join(str(question).split()), understood)
    return Guess(mapping, "", understood)


def _mapping(
    paths: Sequence[Path], answers: Answers, understood: list[tuple[str, str]]
) -> dict[str, Any]:
    """Return the mapping, and what was understood on the way.

    Raises:
        Question: neither names nor numbers tell something.
    """

    def note(label: str, text: str) -> None:
        understood.append((label, text))

    if any(is_bag(path) for path in paths):
        if len(paths) > 1:
            raise Question("one recording at a time; tables and recordings do not mix")
        return bag_mapping(paths[0], answers, note)
    alone = len(paths) == 1
    sources = [source for path in paths for source in Source.read(path, answers, alone)]
    for source in sources:
        note(source.label, f"{len(source.table.values)} rows; {source.table.layout}")
        for problem in source.table.problems:
            note("note", problem)
    _require_columns(sources)
    for source in sources:
        fingers = find_fingers(source)
        if fingers and source.groups.turn:
            return held_mapping(source, fingers, answers, note)
    poses = next(s for s in sources if s.groups.turn)
    forces = poses if poses.groups.force else next(s for s in sources if s.groups.force)
    mapping = WristGuess(poses, forces, answers, note).mapping()
    used = {word for source in sources for word in _used(source, mapping)}
    unused = [n for s in sources for n in s.table.names if n not in used]
    if unused:
        shown = ", ".join(unused[:8]) + (f" and {len(unused) - 8} more" if len(unused) > 8 else "")
        note("not used", shown)
    return mapping


def _require_columns(sources: Sequence[Source]) -> None:
    columns = ", ".join(name for s in sources for name in s.table.names[:12])
    for kind, text in (("force", "a force (fx, fy, fz or so)"), ("turn", _ORIENTATION)):
        if not any(getattr(s.groups, kind) for s in sources):
            raise Question(
                f"no columns look like {text}; there are {columns}: name them in a yaml file "
                "(docs/recordings.md)"
            )


def _used(source: Source, part: Any) -> set[str]:
    """Columns that a part of a mapping names."""
    if isinstance(part, dict):
        if "columns" in part:
            names = part["columns"]
            return {names} if isinstance(names, str) else set(names)
        return {name for value in part.values() for name in _used(source, value)}
    return set()
