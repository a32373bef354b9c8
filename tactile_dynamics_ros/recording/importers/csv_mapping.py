"""Any tables of numbers, mapped to a recording by a small yaml file."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.importers.tables import Table, read_table
from tactile_dynamics_ros.recording.recording import Recording

Array = NDArray[np.float64]

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "force": {"N": 1.0, "mN": 1e-3, "kgf": 9.80665},
    "torque": {"N m": 1.0, "N mm": 1e-3, "mN m": 1e-3},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
    "angular velocity": {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    "acceleration": {"m/s^2": 1.0, "g": 9.80665},
    "number": {"": 1.0},
}
FIELDS = {
    "time": ("time", 1),
    "pose_time": ("time", 1),
    "position": ("length", 3),
    "position_std": ("length", 3),
    "rotation_std": ("angle", 3),
    "quaternion": ("number", 4),
    "rotation": ("number", 9),
    "normal": ("number", 3),
    "force": ("force", 3),
    "force_std": ("force", 3),
    "torque": ("torque", 3),
    "specific_force": ("acceleration", 3),
    "specific_force_std": ("acceleration", 1),
    "angular_velocity": ("angular velocity", 3),
}
SECTIONS = frozenset(["object_pose", "object_imu", "contacts", "contact_frame"])


class CsvMappingImporter(Importer):
    """A yaml file names the tables, the columns, their units and their signs."""

    name = "csv"
    summary = "your own CSV tables, by a yaml file that names columns, units and signs"
    source_help = "the yaml file (docs/recordings.md explains it); tables lie beside it"

    def read(self, source: Path, options: Namespace) -> Recording:
        """Read the tables that the yaml file names."""
        mapping = _load_yaml(source)
        unknown = sorted(set(mapping) - SECTIONS)
        if unknown:
            raise BadInputError(
                f"{source}: unknown key '{unknown[0]}'; expected {', '.join(sorted(SECTIONS))}"
            )
        contacts = {
            str(name): _stream(f"{source}: contacts.{name}", section, source.parent)
            for name, section in dict(mapping.get("contacts") or {}).items()
        }
        pose, imu = (
            _stream(f"{source}: {key}", mapping[key], source.parent) if mapping.get(key) else None
            for key in ("object_pose", "object_imu")
        )
        frame = str(mapping.get("contact_frame", "world"))
        return Recording.from_arrays(contacts, pose, imu, contact_frame=frame, source=str(source))


def _load_yaml(path: Path) -> dict[str, Any]:
    """Return the content of a yaml file that holds a mapping."""
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise BadInputError(f"{path} cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path} is not yaml: {str(error).splitlines()[0]}") from error
    if not isinstance(content, dict):
        raise BadInputError(f"{path}: expected a mapping with {', '.join(sorted(SECTIONS))}")
    return content


def _stream(where: str, section: Any, folder: Path) -> dict[str, Any]:
    """Return the arrays of one stream by name."""
    if not isinstance(section, Mapping) or "file" not in section:
        raise BadInputError(f"{where}: expected a mapping with 'file' and fields")
    table = read_table(folder / str(section["file"]))
    arrays = {
        key: _field(f"{where}.{key}", key, entry, table)
        for key, entry in section.items()
        if key not in ("file", "delay")
    }
    delay = _number(f"{where}.delay", section.get("delay", 0.0))
    for key in ("time", "pose_time"):
        if key in arrays:
            arrays[key] = arrays[key] - delay
    return arrays


def _field(where: str, key: str, entry: Any, table: Table) -> Array:
    """Return one field: columns of the table, or a constant."""
    if key not in FIELDS:
        raise BadInputError(f"{where}: unknown field; expected {', '.join(FIELDS)}")
    quantity, width = FIELDS[key]
    entry = entry if isinstance(entry, Mapping) else {"constant": entry}
    unknown = sorted(set(entry) - {"columns", "constant", "unit", "scale"})
    if unknown or ("columns" in entry) == ("constant" in entry):
        raise BadInputError(f"{where}: expected columns: [...] or a constant, with unit and scale")
    factor = _unit(where, quantity, entry) * _number(f"{where}.scale", entry.get("scale", 1.0))
    if "constant" in entry:
        return factor * _constant(where, entry["constant"])
    names = entry["columns"]
    names = [names] if isinstance(names, str) else list(names)
    if len(names) not in (width, 1 if key.endswith("_std") else width):
        raise BadInputError(f"{where}: {len(names)} columns; expected {width}")
    values = factor * table.columns(*map(str, names))
    if key == "rotation":
        return np.asarray(values.reshape(-1, 3, 3))
    return np.asarray(values[:, 0] if width == 1 else np.broadcast_to(values, (len(values), width)))


def _unit(where: str, quantity: str, entry: Mapping[str, Any]) -> float:
    """Return the factor from a field's unit to SI."""
    known = UNITS[quantity]
    unit = str(entry.get("unit", next(iter(known))))
    if unit not in known:
        raise BadInputError(f"{where}: unit '{unit}'; expected one of {', '.join(known)}")
    return known[unit]


def _constant(where: str, value: Any) -> Array:
    """Return a constant as an array."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"{where} = {value!r}; expected numbers") from error


def _number(where: str, value: Any) -> float:
    """Return one finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"{where} = {value!r}; expected a number") from error
    if not math.isfinite(number):
        raise BadInputError(f"{where} = {value!r}; expected a finite number")
    return number
