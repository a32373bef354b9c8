"""Pose of a link of an arm from the angles of its joints and its URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_text
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.kinematic_tree import (
    chain,
    independent,
    position_of,
    read_tree,
)
from tactile_dynamics_ros.core.robot.robot import Joint
from tactile_dynamics_ros.recording.importers.bag_reader import BagReader
from tactile_dynamics_ros.recording.importers.bag_tables import is_bag
from tactile_dynamics_ros.recording.importers.fields import UNITS
from tactile_dynamics_ros.recording.importers.tables import Table

KEYS = frozenset(["joints", "urdf", "frame", "base"])
"""Keys of a section whose pose comes from joint angles."""


def read_link(where: str, section: Mapping[str, Any], table: Table, folder: Path) -> dict[str, Any]:
    """Return position (N, 3) and rotation (N, 3, 3) of a link in the base of the arm.

    Args:
        where: for messages to the user.
        section: `urdf`: file, or topic of the recording; `frame`: link; `base`: link (the root by
            default); `joints`: columns of all joints from base to link in order, with their unit,
            or by name of the joint; left out where columns bear the names of the joints.
        table: with the columns.
        folder: of the URDF.

    Raises:
        BadInputError: a link or a column is missing, or there are more or fewer than joints.
    """
    urdf = str(section["urdf"])
    tree = read_tree(urdf_text(urdf, folder, folder / str(section["file"])) or "", urdf)
    base = str(section.get("base") or _root(tree))
    if "frame" not in section:
        raise BadInputError(f"{where}: no frame; expected the link that carries the sensor")
    joints = chain(tree, base, str(section["frame"]))
    angles = _angles(f"{where}.joints", section.get("joints"), independent(joints), table)
    position, rotation = link_pose(joints, angles)
    return {"position": position, "rotation": rotation}


def urdf_text(urdf: str, folder: Path, recording: Path, required: bool = True) -> str | None:
    """Return the text of a URDF.

    Args:
        urdf: a file, or the topic of a recording that holds it.
        folder: of the file.
        recording: with the topic; a table of another kind has none.
        required: whether a topic must be there; if not, None is returned.

    Raises:
        BadInputError: it cannot be read.
    """
    if is_bag(recording):
        with BagReader(recording) as reader:
            if reader.types.get(urdf, "").endswith("/String"):
                return next((str(message.data) for _, message in reader.messages(urdf)), None)
    return read_text(folder / urdf, "a URDF") if required else None


def link_pose(joints: Sequence[Joint], angles: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return position (N, 3) and rotation (N, 3, 3) at the end of a chain.

    X = prod_j X_j exp(axis_j q_j).

    Args:
        joints: from the base on.
        angles: (N,) rad, or m of joints that slide, by name of each that moves by itself.
    """
    count = len(next(iter(angles.values()))) if angles else 1
    position, rotation = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    for joint in joints:
        position = position + rotation @ joint.origin[:3, 3]
        rotation = rotation @ joint.origin[:3, :3]
        if joint.axis is None:
            continue
        moved = position_of(joint, angles)[:, None] * joint.axis
        if joint.slides:
            position = position + np.einsum("nij,nj->ni", rotation, moved)
        else:
            rotation = rotation @ exp_so3(moved)
    return position, rotation


def _root(tree: Sequence[Joint]) -> str:
    """Return the link that no joint carries."""
    children = {joint.child for joint in tree}
    return next(joint.parent for joint in tree if joint.parent not in children)


def _angles(where: str, given: Any, moving: Sequence[Joint], table: Table) -> dict[str, Array]:
    """Return the angles (N,) of each joint that moves by itself, in rad or m."""
    names = [joint.name for joint in moving]
    if given is None:
        missing = [name for name in names if name not in table.names]
        if missing:
            raise BadInputError(
                f"{where}: no column '{missing[0]}'; name columns for {', '.join(names)}"
            )
        return {name: table.column(name) for name in names}
    if not isinstance(given, Mapping) or "columns" not in given:
        raise BadInputError(f"{where}: expected columns: [...] in the order of {', '.join(names)}")
    columns = given["columns"]
    if isinstance(columns, Mapping):
        columns = [columns.get(name) for name in names]
    if len(columns) != len(names) or None in columns:
        raise BadInputError(
            f"{where}: {len(columns)} columns; expected one for each of {', '.join(names)}"
        )
    unit = str(given.get("unit", "rad"))
    if unit not in UNITS["angle"]:
        raise BadInputError(f"{where}: unit '{unit}'; expected one of {', '.join(UNITS['angle'])}")
    factor = UNITS["angle"][unit]
    return {
        joint.name: (1.0 if joint.slides else factor) * table.column(str(name))
        for joint, name in zip(moving, columns, strict=True)
    }
