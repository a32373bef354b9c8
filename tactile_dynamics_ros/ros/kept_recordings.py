"""Recordings with their diagnoses in a folder that holds a limited number of them."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError

_NAME = re.compile(r"\d{8}T\d{6}\.\d{3}Z")
_BAG, _DIAGNOSIS = "recording.mcap", "diagnosis.json"


def keep_and_diagnose(
    write: Callable[[Path], Any], diagnose: Callable[[], dict[str, Any]], folder: str, most: int
) -> dict[str, Any]:
    """Write a new recording in a folder, diagnose it, and drop the oldest recordings.

    Args:
        write: what was measured, to a path.
        diagnose: the same.
        folder: where recordings are kept; nothing is kept if empty.
        most: recordings that may be there.

    Returns:
        The diagnosis, with the path as "kept"; a sentence alone where there is none.

    Raises:
        BadInputError: the folder cannot be written.
    """
    place = _new_place(Path(folder)) if folder else None
    if place is not None:
        write(place / _BAG)
    try:
        document = diagnose()
    except TactileDynamicsError as error:
        if place is None:
            raise
        document = {"sentence": f"no diagnosis: {error}", "verdict": None}
    if place is None:
        return document
    document["kept"] = str(place)
    (place / _DIAGNOSIS).write_text(json.dumps(document) + "\n")
    drop_oldest(place.parent, most)
    return document


def drop_oldest(folder: Path, most: int) -> None:
    """Remove the oldest recordings beyond a number; what else is in the folder stays."""
    kept = sorted(path for path in folder.iterdir() if _NAME.fullmatch(path.name))
    for path in kept[: max(len(kept) - most, 0)]:
        if {each.name for each in path.iterdir()} <= {_BAG, _DIAGNOSIS}:
            shutil.rmtree(path)


def _new_place(folder: Path) -> Path:
    """Make a folder named after the time of the wall clock.

    Raises:
        BadInputError: it cannot be made.
    """
    now = datetime.now(UTC)
    place = folder / f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z"
    try:
        place.mkdir(parents=True)
    except OSError as error:
        raise BadInputError(f"{place} cannot be made: {error.strerror}") from error
    return place
