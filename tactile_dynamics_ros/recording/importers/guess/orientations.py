"""Readings of the columns of an orientation, and which of them agrees with the weight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.recording.importers.fields import read_field
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.groups import Group
from tactile_dynamics_ros.recording.importers.guess.weight import Measured, Scene, Weighing
from tactile_dynamics_ros.recording.importers.tables import Table

Array = NDArray[np.float64]

_ALIKE = 1.3
"""Misfit over that of the best reading up to which a reading agrees as well. Noise makes misfits of
1500 rows differ by 2 %; wrong axes and orders leave several times as much."""
_SAME = 0.03
"""Angle, rad, by which two readings may differ all along and mean the same: rotation vectors and
Euler angles of an object that hardly turns."""
_FLOOR = 0.005
"""Misfit over the size of the forces below which readings agree perfectly: exports round."""
_TURN_IN_RADIANS = 6.4
"""Largest angle that is written in radians: a full turn, and rounding."""
_CLEARLY_LESS, _TURNED = 0.5, 0.05
"""Misfit with a turned sensor over that without, and angle, rad, from which it is asked if the
sensor is turned. Noise lowers the misfit by 1 %; sensors are screwed on to 3 degrees, which the
effect `sensor_rotation` finds."""
_OWN_WEIGHT = 0.2
"""Weight over constant part of the forces below which the constant part may be the weight, seen in
other axes."""


@dataclass(frozen=True)
class Reading:
    """One way to read the columns of an orientation.

    Attributes:
        label: in words, also for answers.
        key: field of a mapping; entry: its content.
        natural: whether names or habits of loggers mean it.
    """

    label: str
    key: str
    entry: dict[str, Any]
    natural: bool

    def rotations(self, table: Table) -> Array:
        """(N, 3, 3) body to world."""
        return np.asarray(read_field(table.source, self.key, self.entry, table))

    def inverted(self) -> Reading:
        """Return the reading as world to body."""
        entry = {**self.entry, "inverse": True}
        return Reading(f"{self.label}, world to body", self.key, entry, False)


WORLDS: dict[str, tuple[float, float, float]] = {"z": (0.0, 0.0, 0.0), "y": (90.0, 0.0, 0.0)}
"""Axis of the file's world that points up, and Euler angles xyz, deg, that make it z. Cameras for
motion capture have y up; all else z."""


@dataclass(frozen=True)
class Judged:
    """A reading, the axes of the forces, and the load that they show then.

    Attributes:
        reading: of the orientation.
        rotation: (N, 3, 3) under it, in a world whose z points up.
        weighing: the load; scene: the motion.
        up: axis of the file's world that points up.
    """

    reading: Reading
    rotation: Array
    weighing: Weighing
    scene: Scene
    up: str = "z"


def readings_of(group: Group, table: Table) -> list[Reading]:
    """Return all ways to read a group, those that names mean marked as natural."""
    values = table.columns(*group.columns)
    columns = list(group.columns)
    found = {
        "quaternion": _named_quaternion,
        "quad": _quadruple,
        "euler": _named_euler,
        "abc": _kuka_angles,
        "turn3": _three_numbers,
        "matrix9": _nine,
        "matrix12": _twelve,
        "matrix16": _sixteen,
    }[group.kind](columns, values, group)
    return [*found, *(reading.inverted() for reading in found)]


def _named_quaternion(columns: list[str], values: Array, group: Group) -> list[Reading]:
    return [Reading("quaternion", "quaternion", {"columns": columns}, True)]


def _quadruple(columns: list[str], values: Array, group: Group) -> list[Reading]:
    return [
        Reading(f"quaternion {order}", "quaternion", {"columns": columns, "order": order}, False)
        for order in ("wxyz", "xyzw")
    ]


def _angle_units(values: Array, group: Group) -> list[str]:
    if group.unit in ("rad", "deg"):
        return [group.unit]
    return ["deg"] if np.nanmax(np.abs(values)) > _TURN_IN_RADIANS else ["rad", "deg"]


def _euler(columns: list[str], order: str, unit: str, natural: bool) -> Reading:
    entry = {"columns": columns, "order": order, "unit": unit}
    return Reading(f"Euler angles {order} in {unit}", "euler", entry, natural)


def _named_euler(columns: list[str], values: Array, group: Group) -> list[Reading]:
    units = _angle_units(values, group)
    known = len(units) == 1 or np.nanmax(np.abs(values)) > 1.0
    return [
        _euler(columns, order, unit, order == "xyz" and known and unit == units[0])
        for unit in units
        for order in ("xyz", "XYZ")
    ]


def _kuka_angles(columns: list[str], values: Array, group: Group) -> list[Reading]:
    units = _angle_units(values, group)
    return [
        _euler(columns, order, unit, order == "ZYX" and len(units) == 1)
        for unit in units
        for order in ("ZYX", "ZYZ", "xyz")
    ]


def _three_numbers(columns: list[str], values: Array, group: Group) -> list[Reading]:
    units = _angle_units(values, group)
    words = set(group.stem)
    vector = bool(words & {"rotvec", "rv", "rvec", "axis"} or {"actual", "tcp"} <= words)
    angles = bool(words & {"euler", "rpy"})
    found = []
    for unit in units:
        entry = {"columns": columns, "unit": unit}
        label = f"rotation vector in {unit}"
        found.append(Reading(label, "rotation_vector", entry, vector and unit == units[0]))
        found += [
            _euler(columns, order, unit, angles and order == "xyz" and len(units) == 1)
            for order in ("xyz", "XYZ", "zyx", "ZYX", "ZYZ")
        ]
    return found


def _nine(columns: list[str], values: Array, group: Group) -> list[Reading]:
    return [Reading("rotation matrix by rows", "rotation", {"columns": columns}, True)]


def _twelve(columns: list[str], values: Array, group: Group) -> list[Reading]:
    rows = [columns[4 * i + j] for i in range(3) for j in range(3)]
    return [Reading("matrix 3x4 by rows", "rotation", {"columns": rows}, True)]


def _sixteen(columns: list[str], values: Array, group: Group) -> list[Reading]:
    rows = [columns[4 * i + j] for i in range(3) for j in range(3)]
    if is_by_rows(values):
        return [Reading("matrix 4x4 by rows", "rotation", {"columns": rows}, True)]
    by_columns = [columns[4 * j + i] for i in range(3) for j in range(3)]
    return [Reading("matrix 4x4 by columns", "rotation", {"columns": by_columns}, True)]


def is_by_rows(values: Array) -> bool:
    """Whether the sixteen numbers of homogeneous matrices (N, 16) are written row by row."""
    return bool(np.nanmax(np.abs(values[:, [12, 13, 14]])) < 1e-9)


def choose_reading(
    readings: Sequence[Reading],
    table: Table,
    measured_under: Callable[[Array], Measured],
    answers: Answers,
    what: str,
) -> Judged:
    """Return the reading and the axes of the forces that agree with gravity.

    Raises:
        Question: several agree equally well and mean different things, or none does.
    """
    wanted = answers.get("orientation")
    if wanted is not None:
        labels = [reading.label for reading in readings]
        answers.choose("orientation", labels, "")
        readings = [reading for reading in readings if reading.label == wanted]
    judged = [item for reading in readings for item in _judge(reading, table, measured_under)]
    axes = answers.get("frame")
    if axes is not None:
        answers.choose("frame", ("sensor", "world"), "")
        judged = [item for item in judged if item.weighing.axes == axes]
    good = [item for item in judged if item.weighing.seen and _is_load(item.weighing, judged)]
    if not good:
        if wanted is not None and axes is not None:
            return judged[0]
        _ask_for_mounting(judged, what)
        answers.choose(
            "orientation",
            [reading.label for reading in readings],
            f"the forces of {what} show no weight under any reading of the orientation, so that "
            "axes and signs cannot be tested (say frame=sensor or world too; joint angles "
            "need a yaml file with a URDF)",
        )
    least = min(item.weighing.rms for item in good)
    bound = _ALIKE * max(least, _FLOOR * good[0].weighing.size)
    agreeing = [item for item in good if item.weighing.rms <= bound]
    upright = [item for item in agreeing if item.up == "z"] or agreeing
    natural = [item for item in upright if item.reading.natural]
    best = _only_one(natural or upright, answers, what)
    if axes is None and _seems_turned(best):
        _ask_for_mounting([best], what)
    return best


def _seems_turned(best: Judged) -> bool:
    """Whether a turned sensor would explain the forces much better than one that is not."""
    mounting = best.scene.mounting() if best.weighing.axes == "sensor" else None
    if mounting is None or mounting[0] > _CLEARLY_LESS * best.weighing.rms:
        return False
    return float(np.linalg.norm(log_so3(mounting[1][None])[0])) > _TURNED


def _ask_for_mounting(judged: Sequence[Judged], what: str) -> None:
    """Say how the sensor seems to be turned against the frame of the pose, if that would fit.

    Raises:
        Question: a constant rotation makes the forces agree.
    """
    found = [
        (*mounting, item)
        for item in judged
        if item.weighing.axes == "sensor" and item.up == "z"
        if (mounting := item.scene.mounting()) is not None
    ]
    if not found:
        return
    _, turn, item = min(found, key=lambda entry: entry[0])
    angles = Rotation.from_matrix(turn).as_euler("xyz", degrees=True)
    shown = ", ".join(f"{angle + 0.0:.1f}" for angle in angles)
    raise Question(
        f"the forces of {what} agree with gravity only if the sensor is turned against the frame "
        f"of the pose ({item.reading.label}): is it mounted so? Then write a yaml file with "
        f"sensor_rotation: {{euler: [{shown}], order: xyz, unit: deg}} (docs/recordings.md)"
    )


def _judge(
    reading: Reading, table: Table, measured_under: Callable[[Array], Measured]
) -> list[Judged]:
    rotation = reading.rotations(table)
    if not np.isfinite(rotation).any():
        return []
    defect = np.abs(np.einsum("nij,nkj->nik", rotation, rotation) - np.eye(3)).max(axis=(1, 2))
    if np.nanmedian(defect) > 0.02:
        return []
    rotation = np.where((defect > 0.02)[:, None, None], np.nan, rotation)
    measured = measured_under(rotation)
    found = []
    for up, angles in WORLDS.items():
        turned = measured.upright(Rotation.from_euler("xyz", angles, degrees=True).as_matrix())
        scene = Scene(turned)
        found += [
            Judged(reading, turned.rotation, scene.weigh(axes), scene, up)
            for axes in ("sensor", "world")
        ]
    return found


def _is_load(weighing: Weighing, judged: Sequence[Judged]) -> bool:
    """False if the forces hardly change, so that their constant part may be the weight."""
    weight = abs(weighing.mass) * 9.81
    return weight > _OWN_WEIGHT * weighing.bias


def _only_one(agreeing: Sequence[Judged], answers: Answers, what: str) -> Judged:
    """Return the one that is left if those that mean the same are one.

    Raises:
        Question: they mean different things.
    """
    best = min(agreeing, key=lambda item: item.weighing.rms)
    others = [item for item in agreeing if not _means_same(item, best)]
    if not others:
        return best
    axes = sorted({item.weighing.axes for item in agreeing})
    turned = {item.reading.label for item in agreeing}
    if len(axes) > 1 and len(turned) == 1:
        answers.choose(
            "frame", axes, f"the forces of {what} fit in the axes of the sensor and of the world"
        )
    answers.choose(
        "orientation",
        sorted(turned),
        f"the orientation of {what} may be read as {' or as '.join(sorted(turned))}",
    )
    return best


def _means_same(one: Judged, other: Judged) -> bool:
    if (one.weighing.axes, one.up) != (other.weighing.axes, other.up):
        return False
    if (one.weighing.mass > 0.0) != (other.weighing.mass > 0.0):
        return False
    known = np.isfinite(one.rotation).all(axis=(1, 2)) & np.isfinite(other.rotation).all(
        axis=(1, 2)
    )
    turn = log_so3(np.swapaxes(one.rotation[known], 1, 2) @ other.rotation[known])
    return bool(np.linalg.norm(turn, axis=1).max(initial=0.0) < _SAME)
