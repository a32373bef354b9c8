"""What torques and accelerations of an IMU say beside forces: axes, centre of mass, positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.recording.importers.fields import UNITS
from tactile_dynamics_ros.recording.importers.guess.answers import Question
from tactile_dynamics_ros.recording.importers.guess.groups import Group
from tactile_dynamics_ros.recording.importers.guess.weight import GRAVITY, Scene, Weighing
from tactile_dynamics_ros.recording.importers.tables import Table

_ALIKE = 1.3
"""Misfit over that of the best signs up to which torques are taken as forces are. Signs that are
wrong leave several times as much."""
_CLEAR = 10.0
"""Standard deviations by which the first moment that turning shows in the forces must contradict
that of the torques for them to be of the other sign. Filters and noise of the motion feign two or
three; where nothing turns quickly, no sign of torques can be reported."""
_SAME_MASS = 0.1
"""Share by which mass by weight and by acceleration differ at most where a world leans: cables and
springs that pull a load aside change its weight."""
_SIGNS = [np.ones(3), *(1.0 - 2.0 * np.eye(3))]
"""Signs of the three axes of a torque, those that all agree first; all negated fit alike."""


def torque_signs(scene: Scene, weighing: Weighing) -> Array:
    """Signs (3,) of the axes of the torques, recorded axes, that fit the load best.

    Those of the forces, all of one sign, are kept where no others fit clearly better.
    """
    if not _is_measured(scene):
        return np.ones(3)
    tried = _SIGNS if weighing.axes == "sensor" else _SIGNS[:1]
    fits = [_fit(scene, weighing, signs) for signs in tried]
    least = min(left for _, left in fits)
    near = [pair for pair in zip(tried, fits, strict=True) if pair[1][1] <= _ALIKE * least]
    signs, (moment, _) = near[0]
    return signs if _support(weighing, moment) > -_CLEAR else -signs


def _support(weighing: Weighing, moment: Array) -> float:
    """Standard deviations by which turning shows a first moment this way, not the other."""
    found = []
    for side in weighing.sides:
        size = float(np.linalg.norm(moment / side.moment_std))
        found.append(float(np.sum(side.moment * moment / side.moment_std**2)) / max(size, 1e-300))
    return max(found, key=abs)


def lever_of(scene: Scene, weighing: Weighing) -> float | None:
    """Distance of the centre of mass as torques in their own unit tell it.

    None without torques, or where neither weight nor acceleration shows a mass.
    """
    mass = abs(weighing.mass or weighing.inertial or 0.0)
    if not _is_measured(scene) or mass == 0.0:
        return None
    moment, _ = _fit(scene, weighing, torque_signs(scene, weighing))
    return float(np.linalg.norm(moment)) / mass


def torque_size(scene: Scene, weighing: Weighing) -> tuple[float, float] | None:
    """Size of the unit of torques, in units of the force times m, and its standard deviation.

    That by which the first moment of the torques becomes the one that turning shows in the forces;
    None where turning does not show it.
    """
    if not _is_measured(scene):
        return None
    moment, _ = _fit(scene, weighing, torque_signs(scene, weighing))
    side = min(weighing.sides, key=lambda one: float(np.max(one.moment_std)))
    weight = (moment / side.moment_std) ** 2
    std = float(np.sum(weight)) ** -0.5 if np.any(weight) else np.inf
    size = float(np.sum(moment * side.moment / side.moment_std**2)) * std**2
    return (size, std) if np.isfinite(std) and size > _CLEAR * std else None


def leans(scene: Scene, weighing: Weighing) -> bool | None:
    """Whether forces that point aside are the weight of the load in a world that leans.

    A cable or a spring that pulls aside turns the load too, unless it acts at its centre of mass;
    without torques nothing tells it, and None is returned. Where positions are known, accelerations
    must show the same mass.
    """
    ratio = weighing.agreement
    if ratio is None and scene.measured.time is not None and scene.measured.position is not None:
        return False
    if ratio is not None and abs(ratio - 1.0) > _SAME_MASS:
        return False
    if not _is_measured(scene):
        return None
    signs = torque_signs(scene, weighing)
    alone, beside = (_fit(scene, weighing, signs, pulled)[1] for pulled in (False, True))
    return alone <= _ALIKE * beside


def _is_measured(scene: Scene) -> bool:
    torque = scene.measured.torque
    return torque is not None and bool(np.isfinite(torque[scene.rows]).all())


def _fit(
    scene: Scene, weighing: Weighing, signs: Array, pulled: bool = False
) -> tuple[Array, float]:
    """First moment (3,) of the load, of the longer side of a change, and RMS of what is left.

    Args:
        scene: the motion.
        weighing: the load.
        signs: (3,) by which the recorded torques are multiplied.
        pulled: whether a constant force at any point of the load is admitted.
    """
    assert scene.measured.torque is not None
    read = scene.own_axes(signs * scene.measured.torque[scene.rows], weighing.axes, weighing.turn)
    specific_force, still = GRAVITY * scene.in_body(weighing.up), np.zeros_like(read)
    moved, rate, change = (still, still, still) if scene.motion is None else scene.motion
    columns = [
        regressor(specific_force + moved, rate, change)[:, :3, 1:],
        np.tile(np.eye(3), (len(read), 1, 1)),
    ]
    if pulled:
        columns += [skew(axis) @ scene.to_body for axis in np.eye(3)]
    matrix = np.concatenate(columns, axis=2)
    sides = [_least(matrix[part], read[part]) for part in scene.sides]
    moment, _, count = max(sides, key=lambda side: side[2])
    squares = sum(side[1] for side in sides)
    return moment[:3], float(np.sqrt(squares / sum(side[2] for side in sides)))


def _least(matrix: Array, read: Array) -> tuple[Array, float, int]:
    flat = matrix.reshape(read.size, -1)
    solution = np.linalg.lstsq(flat, read.ravel(), rcond=None)[0]
    return solution, float(np.sum((read.ravel() - flat @ solution) ** 2)), read.size


_OFF = 0.3
"""Difference of readings and gravity, over gravity, up to which an IMU's axes are those of the
orientation: robots accelerate loads by up to 2 m/s^2. Axes that are exchanged or turned about are
off by 1.4 and 2; at 0.1 robots would have to be slow."""


def read_acceleration(group: Group, table: Table, rotation: Array) -> dict[str, Any]:
    """Return the entry of a mapping for what an accelerometer reads, gravity included.

    At rest it reads R' (0, 0, g).

    Args:
        group: its columns.
        table: rows.
        rotation: (N, 3, 3) body to world, z up.

    Raises:
        Question: it does not read gravity in the axes of the orientation.
    """
    values = table.columns(*group.columns)
    units = [group.unit] if group.unit in UNITS["acceleration"] else list(UNITS["acceleration"])
    off, unit = min((_distance(UNITS["acceleration"][u] * values, rotation), u) for u in units)
    if not off < _OFF:
        raise Question(
            f"no position is in the table, and {group.label} do not read gravity in the axes of "
            "the orientation as an IMU there would: name columns and sensor_rotation of object_imu "
            "in a yaml file (docs/recordings.md)"
        )
    return {"columns": list(group.columns), "unit": unit}


def _distance(specific_force: Array, rotation: Array) -> float:
    """Difference (N, 3) of readings and gravity as a root mean square, over gravity."""
    error = specific_force - GRAVITY * rotation[:, 2]
    return float(np.sqrt(np.nanmean(np.sum(error**2, axis=1)))) / GRAVITY
