"""Which of the models a recording is for, by its topics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from tactile_dynamics_ros.recording.joints import TABLES, is_of_joints
from tactile_dynamics_ros.recording.pushed import recorded_model


def recorded_kind(path: str | Path, remap: Mapping[str, str | Sequence[str]] | None = None) -> str:
    """Return "joints" for torques of joints and no forces, else "pushed" or "held".

    Args:
        path: of the recording.
        remap: recorded topic names and the name, or names, that they stand for.

    Raises:
        BadInputError: there is no recording at the path.
    """
    if (not remap or Path(path).suffix in TABLES) and is_of_joints(Path(path)):
        return "joints"
    return recorded_model(path, remap)
