"""Any tables of numbers, mapped to a recording by a small yaml file."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_yaml
from tactile_dynamics_ros.recording.importers.bag_tables import TF, is_bag, read_frame, read_topic
from tactile_dynamics_ros.recording.importers.fields import (
    constant_rotation,
    named_columns,
    read_field,
    read_stream,
)
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.importers.joint_angles import KEYS, read_link
from tactile_dynamics_ros.recording.importers.tables import Table, read_any_table
from tactile_dynamics_ros.recording.importers.worlds import WORLD_KEYS, World, read_world
from tactile_dynamics_ros.recording.pushed import PushedRecording, Support
from tactile_dynamics_ros.recording.recording import Recording

SECTIONS = WORLD_KEYS | frozenset(
    ["object_pose", "object_imu", "contacts", "contact_frame", "static_poses", "link_2_pose"]
    + ["support"]
)
PLACE = ("file", "topic", "frame", "base", "field", "stamps")
"""Keys that say where the table of a section is."""


class CsvMappingImporter(Importer):
    """A yaml file names the tables, the columns, their units and their signs."""

    name = "csv"
    summary = "your own CSV tables, by a yaml file that names columns, units and signs"
    source_help = "the yaml file (docs/recordings.md explains it); tables lie beside it"

    def read(self, source: Path, options: Namespace) -> Recording | PushedRecording:
        """Read the tables that the yaml file names."""
        mapping = load_yaml(source)
        try:
            return read_mapping(mapping, source.parent, str(source))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            reason = str(error).splitlines()[:1] or [type(error).__name__]
            raise BadInputError(
                f"{source}: an entry is of another kind than expected ({reason[0]}); compare with "
                "docs/recordings.md"
            ) from error


def read_mapping(
    mapping: Mapping[str, Any], folder: Path, source: str
) -> Recording | PushedRecording:
    """Read the tables that a mapping names; with an outline they are those of a pushed object.

    Args:
        mapping: sections of the yaml file.
        folder: where the tables lie.
        source: of the mapping, for messages to the user.

    Raises:
        BadInputError: the mapping is malformed, or a table is not as it says.
    """
    unknown = sorted(set(mapping) - SECTIONS)
    if unknown:
        raise BadInputError(
            f"{source}: unknown key '{unknown[0]}'; expected {', '.join(sorted(SECTIONS))}"
        )
    tables = _Tables(folder)
    world = read_world(source, mapping)
    if "static_poses" in mapping:
        held = _static(source, mapping, tables, world)
        return replace(held, source=source, problems=tables.problems() | held.problems)
    if "footprint" in (mapping.get("object_pose") or {}):
        pushed = _pushes(mapping, source, tables, world)
        return replace(pushed, problems=tables.problems() | pushed.problems)
    held = _streams(mapping, source, tables, world)
    return replace(held, problems=tables.problems() | held.problems)


class _Tables:
    """Tables of files and of topics, each read once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read: dict[tuple[str, ...], Table] = {}

    def of(self, where: str, section: Any) -> Table:
        """Return the table of a section.

        Raises:
            BadInputError: the section names none.
        """
        if not isinstance(section, Mapping) or "file" not in section:
            raise BadInputError(f"{where}: expected a mapping with 'file' and fields")
        place = [str(section.get(part, "")) for part in PLACE]
        columns = sorted(named_columns(section))
        key = (*place, *columns)
        if key not in self._read:
            path = self.folder / place[0]
            self._read[key] = (
                self._topic(where, *place) if is_bag(path) else read_any_table(path, columns)
            )
        return self._read[key]

    def _topic(
        self, where: str, file: str, topic: str, frame: str, base: str, field: str, stamps: str
    ) -> Table:
        """Read a topic or a part of its messages, or a frame of /tf."""
        path = self.folder / file
        if not topic:
            raise BadInputError(f"{where}: {file} is a recording; expected its topic too")
        if topic == TF:
            return read_frame(path, frame, base or None, stamps or "header")
        return read_topic(path, topic, field, stamps or "header")

    def stream(
        self, where: str, section: Any, extra: frozenset[str] = frozenset()
    ) -> dict[str, Any]:
        """Return the arrays of a section; joint angles become a pose."""
        table = self.of(where, section)
        own = frozenset([*PLACE, "sensor_pose"]) | KEYS | extra
        arrays = read_stream(where, section, table, own)
        if "urdf" in section:
            arrays |= read_link(where, section, table, self.folder)
        if "sensor_pose" in section:
            arrays |= _carried(f"{where}.sensor_pose", section["sensor_pose"], arrays)
        return arrays

    def problems(self) -> dict[str, int]:
        """Rows that could not be read, one line each."""
        return {
            f"{table.label or Path(table.source).name}, {line}": 1
            for table in self._read.values()
            for line in table.problems
        }


def _streams(mapping: Mapping[str, Any], source: str, tables: _Tables, world: World) -> Recording:
    """Return the recording of streams with stamps."""
    frame, contacts = _contacts(mapping, source, tables, world)
    pose, imu = (
        world.turned(tables.stream(f"{source}: {key}", mapping[key])) if mapping.get(key) else None
        for key in ("object_pose", "object_imu")
    )
    return Recording.from_arrays(contacts, pose, imu, contact_frame=frame, source=source)


def _contacts(
    mapping: Mapping[str, Any], source: str, tables: _Tables, world: World
) -> tuple[str, dict[str, dict[str, Any]]]:
    """Return the frame of the contacts and their arrays."""
    frame = str(mapping.get("contact_frame", "world"))
    contacts = {}
    sections = mapping.get("contacts") or {}
    if not isinstance(sections, Mapping):
        raise BadInputError(f"{source}: contacts: expected names with their sections")
    for name, section in sections.items():
        where = f"{source}: contacts.{name}"
        arrays = tables.stream(where, section, frozenset(["pose"]))
        if "pose" in section:
            arrays |= _place(f"{where}.pose", section["pose"], tables)
        contacts[str(name)] = world.turned(arrays) if frame == "world" else arrays
    return frame, contacts


def _pushes(
    mapping: Mapping[str, Any], source: str, tables: _Tables, world: World
) -> PushedRecording:
    """Return the recording of an object on a support."""
    frame, contacts = _contacts(mapping, source, tables, world)
    for arrays in contacts.values():
        if "height" in arrays:
            lifted = np.zeros((len(arrays["position"]), 3))
            lifted[:, 2] = arrays.pop("height")
            arrays["position"] = arrays["position"] + lifted
        if "position_std" in arrays:
            arrays["point_std"] = arrays.pop("position_std")
    links = [
        world.turned(tables.stream(f"{source}: {key}", mapping[key]))
        for key in ("object_pose", "link_2_pose")
        if mapping.get(key)
    ]
    return PushedRecording.from_arrays(
        contacts, links, contact_frame=frame, support=_support(mapping, source), source=source
    )


def _carried(where: str, entry: Any, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return position and rotation of what sits on the body whose pose was recorded.

    Raises:
        BadInputError: the entry is no pose, or none was recorded.
    """
    if not isinstance(entry, Mapping) or not {"position", "rotation"} <= set(arrays):
        raise BadInputError(f"{where}: expected position and orientation beside those of the body")
    turn = {key: value for key, value in entry.items() if key != "position"}
    place = np.asarray(entry.get("position", (0.0, 0.0, 0.0)), dtype=np.float64)
    rotation = arrays["rotation"]
    return {
        "position": arrays["position"] + rotation @ place,
        "rotation": rotation @ constant_rotation(where, turn),
    }


def _support(mapping: Mapping[str, Any], source: str) -> Support:
    """Return the axes of the support, as {position: [..], euler: [..], ...}, in the world."""
    section = dict(mapping.get("support") or {})
    place = np.zeros(3)
    if "position" in section:
        entry = section.pop("position")
        table = Table(source, (), np.zeros((1, 0)))
        place = np.asarray(read_field(f"{source}: support.position", "position", entry, table))
    if place.shape != (3,):
        raise BadInputError(f"{source}: support.position; expected three numbers")
    turn = constant_rotation(f"{source}: support", section) if section else np.eye(3)
    return Support(place, turn)


def _place(where: str, section: Any, tables: _Tables) -> dict[str, Any]:
    """Return the arrays of where a contact is, with stamps and perhaps a table of their own."""
    arrays = tables.stream(where, section)
    if "time" in arrays:
        arrays["pose_time"] = arrays.pop("time")
    return arrays


def _static(source: str, mapping: Mapping[str, Any], tables: _Tables, world: World) -> Recording:
    """Return the recording of a table of static poses."""
    where, section = f"{source}: static_poses", mapping["static_poses"]
    unused = sorted(set(mapping) - {"static_poses", "contact_frame"} - WORLD_KEYS)
    if unused:
        raise BadInputError(f"{source}: '{unused[0]}' beside static_poses, which are all there is")
    arrays = tables.stream(where, section, frozenset(["contact"]))
    missing = [key for key in ("force", "rotation") if key not in arrays]
    if missing:
        raise BadInputError(f"{where}: no {missing[0]}; expected force and an orientation")
    known = {"force", "torque", "rotation", "force_std", "torque_std"}
    if extra := sorted(set(arrays) - known):
        raise BadInputError(f"{where}.{extra[0]}: rows at rest have none; leave it out")
    stds = {
        key: float(np.mean(arrays[key])) for key in ("force_std", "torque_std") if key in arrays
    }
    frame = str(mapping.get("contact_frame", "object"))
    own = {"rotation"} if frame == "object" else set(arrays)
    arrays |= world.turned({key: arrays[key] for key in own})
    return Recording.from_static_poses(
        arrays["force"],
        arrays.get("torque"),
        rotation=arrays["rotation"],
        contact=str(section.get("contact", "wrist")),
        contact_frame=frame,
        **stds,
    )


def load_yaml(path: Path) -> dict[str, Any]:
    """Return the content of a yaml file that holds a mapping.

    Raises:
        BadInputError: it cannot be read, or holds something else.
    """
    content = read_yaml(path, "a mapping of tables in yaml")
    if not isinstance(content, dict):
        raise BadInputError(f"{path}: expected a mapping with {', '.join(sorted(SECTIONS))}")
    return content
