"""What the page shows, from topics or from a recording.

Messages are read by their fields, so that those of running nodes and of recordings do alike.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    inertia_matrix,
)
from tactile_dynamics_ros.ros.diagnostics import OK, Statuses, status_values

Span = tuple[float, float]

KEPT = 600
"""Points of a chart: a minute at 10 Hz of what changes each time, about as many as it has pixels.
More cost time to send."""

_REACH = 4.0
"""Height of a chart either way, in multiples of what the newer half of it needs. Smaller cuts off
more of how an estimate began, larger makes its last bands thin."""


_EDGE = 1e-3
"""Width of the edge of a shade, s: far below a pixel of a minute's chart."""


@dataclass(frozen=True)
class Quantity:
    """A number with its standard deviation."""

    value: float
    std: float


@dataclass(frozen=True)
class Force:
    """Force of a contact on the object.

    Attributes:
        point: (3,) m, world.
        force: (3,) N, world axes.
        std: (3,) N along world axes; None if not stated.
    """

    point: Array
    force: Array
    std: Array | None = None


@dataclass(frozen=True)
class Body:
    """Mass, centre of mass and inertia of the object.

    Attributes:
        mass: kg.
        com: (3,) m, axes of the object.
        com_std: (3,) m.
        inertia: (6,) kg m^2 about it: xx, xy, yy, xz, yz, zz; None where it is not known.
        inertia_std: (6,) kg m^2.
    """

    mass: Quantity
    com: Array
    com_std: Array
    inertia: Array | None = None
    inertia_std: Array | None = None

    @property
    def shells(self) -> tuple[Array, Array, Array] | None:
        """Semi-axes (3,), m, of the ellipsoids of equal inertia a deviation smaller and larger.

        And their directions (3, 3). A semi-axis r of second moment s = m r^2 / 5 is off by 5 / (2 m
        r) times the deviation of s, half that of the moments together.
        """
        if self.inertia is None or self.inertia_std is None or self.mass.value <= 0.0:
            return None
        tensor = inertia_matrix(self.inertia)
        radii, directions = InertialParameters(self.mass.value, self.com, tensor).even_ellipsoid
        off = 0.5 * float(np.linalg.norm(self.inertia_std[[0, 2, 5]]))
        squares, more = radii**2, 5.0 * off / self.mass.value
        inner, outer = (np.sqrt(np.maximum(squares + sign * more, 0.0)) for sign in (-1.0, 1.0))
        return inner, outer, directions


@dataclass(frozen=True)
class Push:
    """A push of the object that may be made, is made, or was made.

    Attributes:
        point: (2,) m, where it begins on the outline, support.
        direction: (2,) unit vector.
        length: m.
        chosen: whether it is the one that is made, and not a rival.
    """

    point: Array
    direction: Array
    length: float
    chosen: bool = True


class History:
    """The last values of a quantity with their bands.

    Args:
        whole: whether all values are drawn, however far they lie from the newest.
    """

    def __init__(self, whole: bool = False) -> None:
        self._whole = whole
        self._rows: deque[tuple[float, float, float]] = deque(maxlen=KEPT)

    def add(self, time: float, value: float, std: float = 0.0) -> None:
        """Add a value unless nothing is newer; what lies in the future of the time is dropped.

        While a value stays as it was, its last point moves on.
        """
        while self._rows and self._rows[-1][0] > time:
            self._rows.pop()
        if self._rows and self._rows[-1][0] == time:
            return
        if len(self._rows) > 1 and self._rows[-1][1:] == self._rows[-2][1:] == (value, std):
            self._rows.pop()
        self._rows.append((time, value, std))

    @property
    def first(self) -> float:
        """Time of the first value, s."""
        return self._rows[0][0] if self._rows else 0.0

    def columns(self) -> Array:
        """Time from the first, value, and both ends of ± one standard deviation, (4, N).

        What lies far from the newest value, as the first bands do, is cut off: later ones could not
        be seen beside it.
        """
        time, value, std = np.array(self._rows, dtype=float).reshape(-1, 3).T
        if not len(time):
            return np.zeros((4, 0))
        lately = value[len(value) // 2 :]
        reach = _REACH * max(np.ptp(lately), 2.0 * std[-1], 0.02 * abs(value[-1]))
        reach = np.inf if self._whole else reach
        rows = np.array([value, value - std, value + std])
        return np.vstack([time - time[0], np.clip(rows, value[-1] - reach, value[-1] + reach)])


@dataclass
class State:
    """Everything that the page shows; what is not known is None or empty.

    Attributes:
        object_pose: (4, 4) X_WO.
        forces: by contact.
        body: mass and centre of mass.
        friction: static coefficient.
        error: whitened RMS; 1 is the noise that sensors report. floor: to which it can fall.
        fails: sentences on where the model fails.
        without: the error without the effects of the model; None where it is not known.
        failing: stretches (start, end), s, in which it fails, on the clock of the histories.
        regimes: those in which a named effect acts.
        effects: of the model. missing: names of which one may be added.
        fitted: effects with which the estimate is made. refused: why there is none with them.
        remark: what the estimator says of its estimate.
        good: whether that is good news.
        verdict: of the last diagnosis, in a sentence. fits: whether it found nothing missing.
        centre: centre of mass of a pushed object and its std, (3,) m, axes of the object.
        pushed: whether the object is one on a support. numbers: of it, in words, by name.
        plan: what explores or pushes the object, in a sentence.
        shape: (K, 3) corners of triangles of the object's surface, m, world, where it was seen.
        shape_pose: (4, 4) pose of the object then; None for an object that did not move since.
        footprint: (V, 2) m, outline on the support in axes of the object.
        second_pose: (4, 4) of a second part. second_footprint: (V, 2) m, its outline in its axes.
        pushes: the one that is made, and its rivals.
        next_view: (4, 4) pose where the camera should look from.
        urdf: of the robot.
        joints: positions by name, rad or m.
        histories: by quantity.
    """

    object_pose: Array | None = None
    forces: dict[str, Force] = field(default_factory=dict)
    body: Body | None = None
    friction: Quantity | None = None
    error: float | None = None
    floor: float = 1.0
    without: float | None = None
    fails: tuple[str, ...] = ()
    failing: tuple[Span, ...] = ()
    regimes: tuple[Span, ...] = ()
    effects: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    fitted: tuple[str, ...] = ()
    refused: str = ""
    remark: str = ""
    good: bool = True
    verdict: str = ""
    fits: bool = True
    centre: tuple[Array, Array] | None = None
    pushed: bool = False
    numbers: dict[str, str] = field(default_factory=dict)
    plan: str = ""
    shape: Array | None = None
    shape_pose: Array | None = None
    footprint: Array | None = None
    second_pose: Array | None = None
    second_footprint: Array | None = None
    pushes: tuple[Push, ...] = ()
    next_view: Array | None = None
    urdf: str = ""
    joints: dict[str, float] = field(default_factory=dict)
    histories: dict[str, History] = field(default_factory=dict)

    def note(self, name: str, time: float, value: float, std: float = 0.0) -> None:
        """Add a value to the history of a quantity; errors are shown as large as they were."""
        self.histories.setdefault(name, History(name == "error")).add(time, value, std)


def error_columns(history: History, state: State) -> tuple[Array, ...]:
    """The columns of the error's chart, with its floor and two shades up to the largest error.

    The shades, where a regime holds and where the model fails, have edges of their own, since
    errors may come seldom.

    Args:
        history: of the error.
        state: with floor and stretches.
    """
    time, *values = history.columns()
    if not len(time):
        return (*history.columns(), *np.zeros((3, 0)))
    kinds = [np.array(s).reshape(-1, 2) - history.first for s in (state.regimes, state.failing)]
    edges = np.concatenate([span.ravel() for span in kinds])
    edges = np.concatenate([edges, edges - _EDGE, edges + _EDGE])
    dense = np.unique([*time, *edges[(edges > time[0]) & (edges < time[-1])]])
    top = np.max(values[0], initial=state.floor)
    shades = [
        top * np.any((dense >= spans[:, :1]) & (dense <= spans[:, 1:]), axis=0) for spans in kinds
    ]
    lines = [np.interp(dense, time, value) for value in values]
    return (dense, *lines, np.full(len(dense), state.floor), *shades)


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
    state.pushed, state.remark = True, read.text("link_1")
    state.good = read.level("link_1") == OK
    state.effects, state.refused = (
        read.words("solver", "effects"),
        read.values("solver").get("refused", ""),
    )
    state.fitted = tuple(name for name in state.effects if f"effect {name}" in read)
    without = read.number("solver", "without_effects")
    state.without = without if np.isfinite(without) else None
    error = read.number("solver", "whitened_rms")
    if np.isfinite(error):
        state.error = error
        state.note("error", time, error)


def take_diagnosis(state: State, statuses: Any, start: float = 0.0) -> None:
    """Take the verdict of `model_check`, what it names, and when that acts.

    Args:
        state: of the page.
        statuses: of the message.
        start: stamp of the time zero of the histories, s.
    """
    read = Statuses(statuses)
    state.regimes, state.failing = (
        tuple(
            (a - start, b - start) for a, b in json.loads(read.values("diagnosis").get(key, "[]"))
        )
        for key in ("regime", "failing")
    )
    state.verdict, state.fits = read.text("diagnosis"), read.level("diagnosis") == OK
    floor = read.number("diagnosis", "noise_floor")
    state.floor = floor if np.isfinite(floor) else 1.0
    named = (*read.words("diagnosis", "effect"), *read.words("diagnosis", "group"))
    state.missing = tuple(dict.fromkeys(named))


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
    length = float(values.get("length", 0.06))
    return Push(point, direction, length, chosen)
