"""Fields of a mapping: columns of a table or constants, in SI units, signs and axes turned."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.clock import seconds_of_words
from tactile_dynamics_ros.recording.importers.tables import Table

_LBF = 4.4482216152605
"""Newtons of a pound of force."""
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "lbf": _LBF},
    "torque": {"N m": 1.0, "N mm": 1e-3, "mN m": 1e-3, "N cm": 1e-2, "lbf in": _LBF * 0.0254},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
    "angular velocity": {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    "acceleration": {"m/s^2": 1.0, "g": 9.80665},
    "number": {"": 1.0},
}
FIELDS = {
    "time": ("time", 1),
    "pose_time": ("time", 1),
    "position": ("length", 3),
    "height": ("length", 1),
    "footprint": ("length", 2),
    "position_std": ("length", 3),
    "rotation_std": ("angle", 3),
    "quaternion": ("number", 4),
    "rotation": ("number", 9),
    "rotation_vector": ("angle", 3),
    "euler": ("angle", 3),
    "yaw": ("angle", 1),
    "normal": ("number", 3),
    "force": ("force", 3),
    "force_std": ("force", 3),
    "torque": ("torque", 3),
    "torque_std": ("torque", 1),
    "specific_force": ("acceleration", 3),
    "specific_force_std": ("acceleration", 1),
    "angular_velocity": ("angular velocity", 3),
}
"""Quantity and number of columns of each field."""
ORIENTATIONS = ("quaternion", "rotation", "rotation_vector", "euler", "yaw")
"""Fields of which a stream has one, and which become its `rotation`."""
TURNED = ("force", "torque", "specific_force", "angular_velocity", "normal")
"""Vectors in the sensor's axes, which `sensor_rotation` turns."""
EULER_ORDERS = frozenset(a + b + c for a in "xyz" for b in "xyz" for c in "xyz" if a != b != c)
"""Orders of axes: small letters about axes that stay, capitals about those that turn along."""
_OPTIONS = frozenset(["columns", "constant", "unit", "scale"])
"""Options of every field. A misspelt one is refused, and so is one that a field has no use for."""
_PLANE, _INVERSE = frozenset(["plane"]), frozenset(["inverse"])


def read_stream(
    where: str, section: Mapping[str, Any], table: Table, extra: frozenset[str] = frozenset()
) -> dict[str, Any]:
    """Return the arrays of one stream by name, orientation as `rotation`, vectors turned.

    Args:
        where: file and section, for messages to the user.
        section: fields by name, `delay` and `sensor_rotation`.
        table: whose columns are meant.
        extra: keys that are read elsewhere.

    Raises:
        BadInputError: a field is unknown, malformed or not in the table.
    """
    known = {"file", "delay", "sensor_rotation", *extra}
    arrays: dict[str, Any] = {}
    for key, entry in section.items():
        if key in known:
            continue
        name = "rotation" if key in ORIENTATIONS else key
        if name in arrays:
            raise BadInputError(f"{where}.{key}: the orientation is given twice")
        arrays[name] = read_field(f"{where}.{key}", key, entry, table)
    _turn_position(where, section, arrays)
    delay = _number(f"{where}.delay", section.get("delay", 0.0))
    for key in ("time", "pose_time"):
        if key in arrays:
            arrays[key] = arrays[key] - delay
    if "sensor_rotation" in section:
        turn = constant_rotation(f"{where}.sensor_rotation", section["sensor_rotation"])
        for key in TURNED:
            if key in arrays:
                arrays[key] = arrays[key] @ turn.T
    return arrays


def _turn_position(where: str, section: Mapping[str, Any], arrays: dict[str, Any]) -> None:
    """Put a position that was written in the body's axes, as that of the world's origin, right.

    Raises:
        BadInputError: no orientation stands beside it.
    """
    entry = section.get("position")
    if not isinstance(entry, Mapping) or not entry.get("inverse", False):
        return
    if "rotation" not in arrays:
        raise BadInputError(f"{where}.position.inverse: expected an orientation beside it")
    arrays["position"] = -(arrays["rotation"] @ arrays["position"][..., None])[..., 0]


def named_columns(part: Any) -> set[str]:
    """Return the columns that a part of a mapping names, but for sections of other tables."""
    if not isinstance(part, Mapping):
        return set()
    if "columns" in part:
        names = part["columns"]
        names = list(names.values()) if isinstance(names, Mapping) else names
        return set(map(str, names)) if isinstance(names, list) else {str(names)}
    return {name for key, one in part.items() if key != "pose" for name in named_columns(one)}


def read_field(where: str, key: str, entry: Any, table: Table) -> Any:
    """Return one field: columns of the table, or a constant."""
    if key not in FIELDS:
        raise BadInputError(f"{where}: unknown field; expected {', '.join(FIELDS)}")
    quantity, width = FIELDS[key]
    entry = entry if isinstance(entry, Mapping) else {"constant": entry}
    if set(entry) == {"rate_hz"} and quantity == "time":
        return np.arange(len(table.values)) / _number(f"{where}.rate_hz", entry["rate_hz"])
    allowed = _OPTIONS - {"scale"} if quantity == "time" else _OPTIONS | _own_options(key)
    if unknown := sorted(set(entry) - allowed):
        raise BadInputError(f"{where}.{unknown[0]}: expected {', '.join(sorted(allowed))}")
    if ("columns" in entry) == ("constant" in entry):
        raise BadInputError(f"{where}: expected columns: [...] or a constant, with unit and scale")
    values = _values(where, key, entry, table, (quantity, width))
    if key in ORIENTATIONS:
        return _rotations(where, key, entry, values)
    return values[:, 0] if width == 1 and values.ndim == 2 else values


def _own_options(key: str) -> frozenset[str]:
    """Options that a field has besides those of every field."""
    if key in ORIENTATIONS:
        return _INVERSE | {"order"} if key in ("quaternion", "rotation", "euler") else _INVERSE
    flat = _PLANE if FIELDS[key][1] == 3 else frozenset()
    return flat | _INVERSE if key == "position" else flat


def _values(
    where: str, key: str, entry: Mapping[str, Any], table: Table, kind: tuple[str, int]
) -> Array:
    """Return (N, width) columns or a constant, scaled to SI."""
    quantity, width = kind
    if quantity == "time" and "columns" in entry:
        return _time(where, entry, table)[:, None]
    factor = _unit(where, quantity, entry) * _scale(where, entry.get("scale", 1.0), width)
    if "constant" in entry:
        return np.asarray(factor * _constant(where, entry["constant"]))
    names = _names(entry)
    flat = bool(entry.get("plane", False)) and width == 3
    if len(names) not in (width - flat, 1 if key.endswith("_std") else width - flat):
        plane = ", or plane: true where x and y of a support are all" if len(names) == 2 else ""
        raise BadInputError(f"{where}: {len(names)} columns; expected {width - flat}{plane}")
    values = table.columns(*names)
    if flat and len(names) == 2:
        values = np.column_stack([values, np.zeros(len(values))])
    values = factor * values
    return np.asarray(np.broadcast_to(values, (len(values), width)))


def _names(entry: Mapping[str, Any]) -> list[str]:
    names = entry["columns"]
    return [str(names)] if isinstance(names, str | int) else [str(name) for name in names]


def _time(where: str, entry: Mapping[str, Any], table: Table) -> Array:
    """Seconds (N,) of one column, of seconds and nanoseconds, or of times of day in words."""
    names = _names(entry)
    if len(names) == 2:
        whole, part = (table.column(name) for name in names)
        return whole - np.floor(np.nanmin(whole)) + 1e-9 * part
    if len(names) != 1:
        raise BadInputError(f"{where}: {len(names)} columns; expected one, or sec and nanosec")
    if names[0] in table.texts:
        return seconds_of_words(f"{where}: column '{names[0]}'", table.texts[names[0]])
    return np.asarray(_unit(where, "time", entry) * table.column(names[0]))


def _rotations(where: str, key: str, entry: Mapping[str, Any], values: Array) -> Array:
    """Return rotations (N, 3, 3), or (3, 3) of a constant; NaN where a row has none."""
    from scipy.spatial.transform import Rotation

    flat = np.atleast_2d(values)
    flat = flat.reshape(-1, FIELDS[key][1])
    known = np.isfinite(flat).all(axis=1)
    order = str(entry.get("order", ""))
    matrices = np.full((len(flat), 3, 3), np.nan)
    rows = flat[known]
    if key == "quaternion":
        if order not in ("", "xyzw", "wxyz"):
            raise BadInputError(f"{where}.order: '{order}'; expected xyzw or wxyz")
        rows = np.roll(rows, -1, axis=1) if order == "wxyz" else rows
        lasting = np.linalg.norm(rows, axis=1) > 0.0
        known[known] = lasting
        matrices[known] = Rotation.from_quat(rows[lasting]).as_matrix()
    elif key == "rotation_vector":
        matrices[known] = Rotation.from_rotvec(rows).as_matrix()
    elif key == "yaw":
        matrices[known] = Rotation.from_euler("z", rows).as_matrix()
    elif key == "euler":
        if order.lower() not in EULER_ORDERS or order not in (order.lower(), order.upper()):
            raise BadInputError(
                f"{where}.order: '{order}'; expected like xyz (about axes that stay) or ZYX (about "
                "axes that turn along), in the order of the columns"
            )
        matrices[known] = Rotation.from_euler(order, rows).as_matrix()
    else:
        matrices = flat.reshape(-1, 3, 3)
        if order == "columns":
            matrices = np.swapaxes(matrices, 1, 2)
        elif order not in ("", "rows"):
            raise BadInputError(f"{where}.order: '{order}'; expected rows or columns")
    if entry.get("inverse", False):
        matrices = np.swapaxes(matrices, 1, 2)
    return matrices[0] if "constant" in entry else matrices


def constant_rotation(where: str, entry: Any) -> Array:
    """Return one rotation (3, 3), given as {euler: [..], order, unit}, {quaternion: ..} or so.

    Raises:
        BadInputError: it is none.
    """
    keys = [key for key in ORIENTATIONS if isinstance(entry, Mapping) and key in entry]
    if len(keys) != 1:
        raise BadInputError(f"{where}: expected one of {', '.join(ORIENTATIONS)} with numbers")
    options = {key: value for key, value in entry.items() if key not in keys}
    table = Table(where, (), np.zeros((1, 0)))
    turn = np.asarray(
        read_field(where, keys[0], {"constant": entry[keys[0]], **options}, table), dtype=float
    )
    if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3):
        raise BadInputError(f"{where} = {entry[keys[0]]}; expected a rotation")
    return turn


def _unit(where: str, quantity: str, entry: Mapping[str, Any]) -> float:
    """Return the factor from a field's unit to SI."""
    known = UNITS[quantity]
    unit = str(entry.get("unit", next(iter(known))))
    if unit not in known:
        raise BadInputError(f"{where}: unit '{unit}'; expected one of {', '.join(known)}")
    return known[unit]


def _scale(where: str, value: Any, width: int) -> Any:
    """Return one factor, or one per axis."""
    if isinstance(value, list | tuple):
        if len(value) != width:
            raise BadInputError(f"{where}.scale: {len(value)} factors; expected {width}")
        return np.array([_number(f"{where}.scale", part) for part in value])
    return _number(f"{where}.scale", value)


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
