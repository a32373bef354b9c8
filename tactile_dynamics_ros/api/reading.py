"""Recordings and effects by name, as the command and Python read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_dynamics_ros.core.errors import BadInputError

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect
    from tactile_dynamics_ros.recording import Recording


def read_recording(
    path: str | Path,
    *,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    any_unit: bool = False,
) -> Recording:
    """Read one recording with contacts that push; see `Recording.from_bag`.

    Raises:
        BadInputError: it cannot be read, or no contact pushes.
    """
    from tactile_dynamics_ros.recording import Recording

    recording = Recording.from_bag(
        path, remap=remap, namespace=namespace, world_frame=world_frame, any_unit=any_unit
    )
    if not recording.streams.contacts:
        lines = recording.problem_lines()
        known = next((f", as in {line}" for line in lines if "force" in line), "")
        raise BadInputError(
            f"{recording.source}: no contact has a usable force{known}; expected at least one "
            "/contact/<name>/force that pushes"
        )
    return recording


def effects_of(named: str | Sequence[str | Effect]) -> list[Effect]:
    """Return effects given as "a,b", by their names, or as they are.

    Raises:
        BadInputError: a name is unknown or given twice.
    """
    from tactile_dynamics_ros.core.effects import create_effect

    if isinstance(named, str):
        named = [name.strip() for name in named.split(",") if name.strip()]
    names = [one for one in named if isinstance(one, str)]
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise BadInputError(f"effects {', '.join(names)}: '{min(repeated)}' is named twice")
    return [create_effect(one) if isinstance(one, str) else one for one in named]
