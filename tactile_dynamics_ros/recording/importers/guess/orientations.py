"""Readings of the columns of an orientation, and which of them agrees with the weight."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.noise import white_noise_std
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3, upright
from tactile_dynamics_ros.recording.importers.fields import read_field
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.geometry import (
    LEANING,
    Geometry,
    others,
    say_gravity,
    simple,
)
from tactile_dynamics_ros.recording.importers.guess.groups import Group
from tactile_dynamics_ros.recording.importers.guess.torques import leans
from tactile_dynamics_ros.recording.importers.guess.weight import GRAVITY, Measured, Scene, Weighing
from tactile_dynamics_ros.recording.importers.tables import Table

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
_CLEARLY_LESS = 0.5
"""Misfit of another geometry over that of what is written, from which it is believed: noise lowers
it by 1 %, effects of the catalogue by a third."""
_FINE = 0.05
"""Misfit over the weight up to which another geometry is believed: of noise, taps and sensors of
coarse steps less is left. At 0.15 a spring of 30 N/m is a sensor turned by 13 deg, upside down."""
_AGREEMENT = (0.3, 3.0)
"""Mass by acceleration over mass by weight between which units and clock are right. Noise of poses
makes it smaller than 1; wrong units make it a thousandth or a thousand, a wrong side of up -1."""
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
        inside: whether the position is that of the world's origin in the body's axes.
    """

    label: str
    key: str
    entry: dict[str, Any]
    natural: bool
    inside: bool = False

    def rotations(self, table: Table) -> Array:
        """(N, 3, 3) body to world."""
        return np.asarray(read_field(table.source, self.key, self.entry, table))

    def inverted(self, inside: bool = False) -> Reading:
        """Return the reading as world to body, of the whole pose if the position is `inside`."""
        entry = {**self.entry, "inverse": True}
        label = f"{self.label}, world to body" + (", position too" if inside else "")
        return Reading(label, self.key, entry, False, inside)


@dataclass(frozen=True)
class Judged:
    """A reading, the axes of the forces, and the load that they show then.

    Attributes:
        reading: of the orientation.
        geometry: how world and sensor lie, and the load.
        scene: the motion.
    """

    reading: Reading
    geometry: Geometry
    scene: Scene

    @property
    def weighing(self) -> Weighing:
        """The load."""
        return self.geometry.weighing

    @property
    def rotation(self) -> Array:
        """(N, 3, 3) body to a world whose z points up."""
        return np.asarray(upright(-self.weighing.up) @ self.scene.measured.rotation)

    @property
    def agrees(self) -> bool:
        """Whether weight and acceleration tell one mass, if both are seen."""
        ratio = self.weighing.agreement
        return ratio is None or _AGREEMENT[0] < ratio < _AGREEMENT[1]


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
    inverse = [reading.inverted(inside) for inside in (False, True) for reading in found]
    return [*found, *inverse]


def _named_quaternion(columns: list[str], values: Array, group: Group) -> list[Reading]:
    other = {"columns": columns, "order": "wxyz"}
    return [
        Reading("quaternion", "quaternion", {"columns": columns}, True),
        Reading("quaternion wxyz, whatever the names", "quaternion", other, False),
    ]


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
    measured_under: Callable[[Reading, Array], Measured],
    answers: Answers,
    what: str,
    geometries: bool = True,
) -> Judged:
    """Return the reading and the axes of the forces that agree with gravity.

    Args:
        readings: of the orientation.
        table: rows.
        measured_under: what the table says under a reading and its rotations (N, 3, 3).
        answers: to questions.
        what: name of the forces, for people.
        geometries: whether other ways are tried in which world and sensor may lie.

    Raises:
        Question: several agree equally well and mean different things, or none does.
    """
    wanted = answers.get("orientation")
    if wanted is not None:
        labels = [reading.label for reading in readings]
        answers.choose("orientation", labels, "")
        readings = [reading for reading in readings if reading.label == wanted]
    scenes = list(_scenes(readings, table, measured_under))
    judged = [Judged(r, g, scene) for r, scene in scenes for g in simple(scene, answers)]
    axes = answers.get("frame")
    if axes is not None:
        answers.choose("frame", ("sensor", "world"), "")
        judged = [item for item in judged if item.weighing.axes == axes]
    good = [item for item in judged if item.weighing.seen and _is_load(item.weighing)]
    if geometries and not _is_noise(good):
        placed = [(r, scene) for r, scene in scenes if not r.inside]
        more = [Judged(r, g, scene) for r, scene in placed for g in others(scene, answers)]
        good = _believed(good, [item for item in more if axes in (None, item.weighing.axes)])
    if not good:
        if wanted is not None and axes is not None:
            return judged[0]
        answers.choose(
            "orientation",
            [reading.label for reading in readings if not reading.inside],
            f"the forces of {what} show no weight under any reading of the orientation, so that "
            "axes and signs cannot be tested (say frame=sensor or world too; joint angles "
            "need a yaml file with a URDF)",
        )
    best = _only_one(_simplest(good), answers, what)
    if best.geometry.kind == LEANING and leans(best.scene, best.weighing) is None:
        raise Question(
            f"the forces of {what} fit if the world of the poses leans, or if something pulls the "
            "load aside, which no torque tells: answer with --say "
            f"{say_gravity(best.weighing.up)} or --say gravity=0,0,-1"
        )
    return best


def _scenes(
    readings: Sequence[Reading],
    table: Table,
    measured_under: Callable[[Reading, Array], Measured],
) -> Iterator[tuple[Reading, Scene]]:
    """Motions under the readings that are orientations at all."""
    for reading in readings:
        rotation = reading.rotations(table)
        if not np.isfinite(rotation).any():
            continue
        defect = np.abs(np.einsum("nij,nkj->nik", rotation, rotation) - np.eye(3)).max(axis=(1, 2))
        if np.nanmedian(defect) > 0.02:
            continue
        rotation = np.where((defect > 0.02)[:, None, None], np.nan, rotation)
        yield reading, Scene(measured_under(reading, rotation))


def _is_noise(good: Sequence[Judged]) -> bool:
    """Whether what is written, and nothing but the noise of the forces, is seen."""
    best = min((g for g in good if g.agrees), key=lambda item: item.weighing.rms, default=None)
    if best is None or not best.reading.natural:
        return False
    return best.weighing.rms <= _noise(best)


def _noise(judged: Judged) -> float:
    """What noise and rounding of the forces leave at most, if anything tells it."""
    time, force = judged.scene.measured.force_time, judged.scene.measured.force
    noise = 0.0 if time is None else white_noise_std(time, force)
    return _ALIKE * max(noise, _FLOOR * judged.weighing.size)


def _believed(good: list[Judged], more: Sequence[Judged]) -> list[Judged]:
    """What fits as it is written, or what fits clearly better in another geometry."""
    seen = [m for m in more if m.weighing.seen and _is_load(m.weighing) and m.agrees]
    seen = [m for m in seen if m.weighing.rms < _FINE * abs(m.weighing.mass) * GRAVITY]
    seen = [
        m for m in seen if m.geometry.kind != LEANING or leans(m.scene, m.weighing) is not False
    ]
    plain = [item for item in good if item.agrees]
    if not plain:
        return seen or good
    least = min(item.weighing.rms for item in plain)
    if least <= _FLOOR * plain[0].weighing.size:
        return plain
    clear = [item for item in seen if item.weighing.rms < _CLEARLY_LESS * least]
    timed = plain[0].scene.measured.force_time is not None
    sure = [m for m in clear if m.geometry.is_exact or not timed or m.weighing.rms <= _noise(m)]
    return sure or plain


def _simplest(good: Sequence[Judged]) -> list[Judged]:
    """Readings that agree as well as the best, those of the simplest kind and natural first."""
    size = good[0].weighing.size
    bound = _ALIKE * max(min(item.weighing.rms for item in good), _FLOOR * size)
    agreeing = [item for item in good if item.weighing.rms <= bound]
    least = min((item.reading.inside, item.geometry.kind) for item in agreeing)
    simplest = [i for i in agreeing if (i.reading.inside, i.geometry.kind) == least]
    return [item for item in simplest if item.reading.natural] or simplest


def _is_load(weighing: Weighing) -> bool:
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


def _marks(judged: Judged) -> tuple[Array | float, ...]:
    weighing = judged.weighing
    return weighing.axes == "world", weighing.mass > 0.0, weighing.up, weighing.turn


def _means_same(one: Judged, other: Judged) -> bool:
    pairs = zip(_marks(one), _marks(other), strict=True)
    if not all(np.allclose(a, b, atol=_SAME) for a, b in pairs):
        return False
    known = np.isfinite(one.rotation).all(axis=(1, 2)) & np.isfinite(other.rotation).all(
        axis=(1, 2)
    )
    turn = log_so3(np.swapaxes(one.rotation[known], 1, 2) @ other.rotation[known])
    return bool(np.linalg.norm(turn, axis=1).max(initial=0.0) < _SAME)
