"""What nodes say of a pushed object, taken into the state of the page.

Messages are read by their fields, so that those of running nodes and of recordings do alike.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactile_dynamics_ros.ros.status_reader import OK, Statuses, status_values
from tactile_dynamics_ros.view.state import Push, State

_TRIANGLE_LIST, _ADD = 11, 0
"""Constants of visualization_msgs/Marker; with others no surface would be seen."""

_KINDS = {
    "friction_force_n": ("friction force", 1.0, "N"),
    "mass": ("mass", 1e3, "g"),
    "friction": ("friction", 1.0, ""),
    "com_x": ("centre of mass x", 1e3, "mm"),
    "com_y": ("centre of mass y", 1e3, "mm"),
    "friction_radius_m": ("friction radius", 1e3, "mm"),
}
"""Quantities of a pushed object that are shown: title, factor to the unit, unit."""


def take_properties(
    state: State, time: float, values: Mapping[str, tuple[float, float]], unknown: tuple[str, ...]
) -> None:
    """Show and note what is known of a pushed object.

    Args:
        state: of the page.
        time: s.
        values: value and std by name, SI, as `property_estimator` names them.
        unknown: names among them that are undetermined.
    """
    for name, (title, factor, unit) in _KINDS.items():
        if name not in values:
            continue
        value, std = (factor * number for number in values[name])
        digits = int(np.clip(1 - np.floor(np.log10(std)), 0, 4)) if std > 0.0 else 4
        lacking = name in unknown or (name.startswith("com_") and "com" in unknown)
        said = f"{value:.{digits}f} ± {std:.{digits}f} {unit}".rstrip()
        state.numbers[title] = f"undetermined ({said})" if lacking else said
        state.note(name, time, value, std)
    state.centre = None
    if {"com_x", "com_y"} <= values.keys() and "com" not in unknown:
        (x, x_std), (y, y_std) = values["com_x"], values["com_y"]
        state.centre = (np.array([x, y, 0.0]), np.array([x_std, y_std, 0.0]))


def take_property_status(state: State, time: float, statuses: Any) -> None:
    """Take the statuses of `property_estimator`."""
    read = Statuses(statuses)
    if "link_1" not in read:
        return
    pairs = {name: read.numbers("link_1", [name, f"{name}_std"]) for name in _KINDS}
    values = {name: tuple(pair) for name, pair in pairs.items() if np.isfinite(pair).all()}
    take_properties(state, time, values, read.words("link_1", "undetermined"))
    state.remark, state.good = read.text("link_1"), read.level("link_1") == OK
    error = read.number("solver", "whitened_rms")
    if np.isfinite(error):
        state.error = error
        state.note("error", time, error)


def take_diagnosis(state: State, statuses: Any) -> None:
    """Take the verdict of `model_check`."""
    read = Statuses(statuses)
    state.verdict, state.fits = read.text("diagnosis"), read.level("diagnosis") == OK


def take_markers(state: State, markers: Any) -> bool:
    """Take the surface of the object, if it is among markers; return whether it is."""
    corners = [
        [point.x, point.y, point.z]
        for marker in markers
        if marker.type == _TRIANGLE_LIST and marker.action == _ADD
        for point in marker.points
    ]
    if corners:
        state.shape, state.shape_pose = np.array(corners), state.object_pose
    return bool(corners)


def take_progress(state: State, status: Any) -> None:
    """Take what `explorer` or `push_controller` says that it does."""
    values = status_values(status)
    state.plan = f"{values.get('state', status.name)}: {status.message}"
    if "direction" not in values or values.get("state") not in ("pushing", "waiting"):
        state.pushes = ()
        return
    chosen = _push(values, True)
    rivals = json.loads(values.get("rivals", "[]"))
    state.pushes = (chosen, *(_push(rival, False) for rival in rivals))


def _push(values: Mapping[str, Any], chosen: bool) -> Push:
    point, direction = (
        np.array(json.loads(told) if isinstance(told, str) else told, dtype=float)
        for told in (values["point"], values["direction"])
    )
    gain = values.get("expected_gain")
    length = float(values.get("length", 0.06))
    return Push(point, direction, length, None if gain is None else float(gain), chosen)
