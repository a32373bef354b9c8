"""A mapping for tables of somebody else: what each column seems to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.bag_tables import is_bag
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.bags import bag_mapping
from tactile_dynamics_ros.recording.importers.guess.fingers import find_fingers, held_mapping
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.importers.guess.wrist import WristGuess

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
