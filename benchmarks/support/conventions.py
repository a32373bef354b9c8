"""Recordings that mean another unit, sign, axis or order than they are read with.

Every convention is a mistake that people make with the rows of a table before it becomes streams;
nothing here knows how it is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.support.tables import SensorTable, Table
from tactile_dynamics_ros.synthetic import randomness

Mistake = Callable[[Table, np.random.Generator, int], Table]

STANDARD_GRAVITY = 9.80665
_POUND = 4.4482216
_UP = np.array([0.0, 0.0, -9.81])


def mistaken(table: Table, name: str, seed: int) -> Table:
    """Return what is recorded by somebody who makes the named mistake.

    Args:
        table: rows as they should be.
        name: one of MISTAKES.
        seed: of which of several forms of it; successive seeds take successive forms.
    """
    return MISTAKES[name](table, randomness.stream(seed, "convention", name), seed)


def _of_sensors(table: Table, change: Callable[[SensorTable], SensorTable]) -> Table:
    return replace(table, sensors={name: change(s) for name, s in table.sensors.items()})


def _both(sensor: SensorTable, matrix: np.ndarray) -> SensorTable:
    """Force and torque in other axes."""
    torque = None if sensor.torque is None else sensor.torque @ matrix.T
    return replace(sensor, force=sensor.force @ matrix.T, torque=torque)


def _force_sign(table: Table, rng: np.random.Generator, seed: int) -> Table:
    """What the object applies on the sensor, torque included or not."""
    if seed % 2:
        return _of_sensors(table, lambda s: _both(s, -np.eye(3)))
    return _of_sensors(table, lambda s: replace(s, force=-s.force))


def _torque_sign(table: Table, rng: np.random.Generator, seed: int) -> Table:
    return _of_sensors(table, lambda s: replace(s, torque=-s.torque))


def _force_unit(table: Table, rng: np.random.Generator, seed: int) -> Table:
    unit = (STANDARD_GRAVITY, 1e-3, _POUND, 1e-3 * STANDARD_GRAVITY)[seed % 4]
    return _of_sensors(
        table, lambda s: replace(s, force=s.force / unit, force_std=s.force_std / unit)
    )


def _torque_unit(table: Table, rng: np.random.Generator, seed: int) -> Table:
    unit = (1e-3, 1e-2, 1e-2 * STANDARD_GRAVITY, 1e-3)[seed % 4]
    return _of_sensors(table, lambda s: replace(s, torque=s.torque / unit))


def _signed(rng: np.random.Generator, determinant: float) -> np.ndarray:
    """A signed permutation other than the identity and its negative."""
    every = [
        np.diag(signs)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    wanted = [m for m in every if np.linalg.det(m) * determinant > 0 and abs(np.trace(m)) < 3]
    return wanted[int(rng.integers(len(wanted)))]


def _sensor_axes(table: Table, rng: np.random.Generator, seed: int) -> Table:
    matrix = _signed(rng, 1.0)
    return _of_sensors(table, lambda s: _both(s, matrix))


def _mirrored_axes(table: Table, rng: np.random.Generator, seed: int) -> Table:
    matrix = _signed(rng, -1.0)
    return _of_sensors(table, lambda s: _both(s, matrix))


def _world_axes(table: Table, rng: np.random.Generator, seed: int) -> Table:
    """Sensor axes taken as the world's, or the reverse."""
    return replace(table, turned=2 * (seed % 2))


def _turned_pose(table: Table, rotation: np.ndarray, seed: int, position: np.ndarray) -> Table:
    """Another pose; contacts are carried by it, or were put into the world before."""
    if seed % 2:
        return replace(table, position=position, rotation=rotation)
    return replace(table, position=position, rotation=rotation, carrier=(position, rotation))


def _quaternion_order(table: Table, rng: np.random.Generator, seed: int) -> Table:
    x, y, z, w = Rotation.from_matrix(table.rotation).as_quat().T
    mixed = np.stack([w, x, y, z] if seed % 4 < 2 else [y, z, w, x], axis=1)
    return _turned_pose(table, Rotation.from_quat(mixed).as_matrix(), seed, table.position)


def _inverse_rotation(table: Table, rng: np.random.Generator, seed: int) -> Table:
    return _turned_pose(table, np.swapaxes(table.rotation, 1, 2), seed, table.position)


def _angle_unit(table: Table, rng: np.random.Generator, seed: int) -> Table:
    """Degrees taken as radians, or the reverse; of roll, pitch and yaw or a rotation vector."""
    turn = Rotation.from_matrix(table.rotation)
    factor = np.degrees(1.0) if seed % 4 < 2 else np.radians(1.0)
    if seed % 2:
        vector = turn.as_rotvec()
        for k in range(1, len(vector)):  # the vector of the same rotation nearest to the last
            length = np.linalg.norm(vector[k])
            other = vector[k] * (1.0 - 2.0 * np.pi / max(length, 1e-12))
            if np.linalg.norm(other - vector[k - 1]) < np.linalg.norm(vector[k] - vector[k - 1]):
                vector[k] = other
        mixed = Rotation.from_rotvec(factor * vector)
    else:
        mixed = Rotation.from_euler("xyz", factor * turn.as_euler("xyz"))
    return _turned_pose(table, mixed.as_matrix(), 0, table.position)


def _position_unit(table: Table, rng: np.random.Generator, seed: int) -> Table:
    scale = (1e3, 1e2)[seed % 2]
    position, rotation = table.carrier
    longer = _of_sensors(table, lambda s: replace(s, point=scale * s.point))
    return replace(
        longer,
        position=scale * table.position,
        position_std=scale * table.position_std,
        carrier=(scale * position, rotation),
    )


def _time_unit(table: Table, rng: np.random.Generator, seed: int) -> Table:
    return replace(table, time=table.time * (1e3, 1e6)[seed % 2])


def _gravity_direction(table: Table, rng: np.random.Generator, seed: int) -> Table:
    """The base hangs from the ceiling or on a wall; its frame is taken as the world's."""
    turn = (
        Rotation.from_euler("x", 180.0, degrees=True),
        Rotation.from_euler("x", 90.0, degrees=True),
        Rotation.from_euler("y", 90.0, degrees=True),
        Rotation.from_euler("x", -90.0, degrees=True),
        Rotation.from_euler("y", -90.0, degrees=True),
    )[seed % 5].as_matrix()

    def moved(pose: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        return pose[0] @ turn.T, turn @ pose[1]

    position, rotation = moved((table.position, table.rotation))
    return replace(table, position=position, rotation=rotation, carrier=moved(table.carrier))


def _gyro_unit(table: Table, rng: np.random.Generator, seed: int) -> Table:
    return replace(table, gyro=np.degrees(table.gyro))


def _gyro_sign(table: Table, rng: np.random.Generator, seed: int) -> Table:
    return replace(table, gyro=-table.gyro)


def _acceleration_unit(table: Table, rng: np.random.Generator, seed: int) -> Table:
    unit = (STANDARD_GRAVITY, 1e-3 * STANDARD_GRAVITY)[seed % 2]
    return replace(table, specific_force=table.specific_force / unit)


def _gravity_removed(table: Table, rng: np.random.Generator, seed: int) -> Table:
    gravity = np.einsum("nji,j->ni", table.rotation, _UP)
    return replace(table, specific_force=table.specific_force + gravity)


MISTAKES: dict[str, Mistake] = {
    "force_sign": _force_sign,
    "torque_sign": _torque_sign,
    "force_unit": _force_unit,
    "torque_unit": _torque_unit,
    "sensor_axes": _sensor_axes,
    "mirrored_axes": _mirrored_axes,
    "world_axes": _world_axes,
    "quaternion_order": _quaternion_order,
    "inverse_rotation": _inverse_rotation,
    "angle_unit": _angle_unit,
    "position_unit": _position_unit,
    "time_unit": _time_unit,
    "gravity_direction": _gravity_direction,
    "gyro_unit": _gyro_unit,
    "gyro_sign": _gyro_sign,
    "acceleration_unit": _acceleration_unit,
    "gravity_removed": _gravity_removed,
}
OF_IMU = ("gyro_unit", "gyro_sign", "acceleration_unit", "gravity_removed")
"""Mistakes that need an IMU."""
OF_FINGERS = (
    "force_sign",
    "sensor_axes",
    "mirrored_axes",
    "world_axes",
    "quaternion_order",
    "inverse_rotation",
    "angle_unit",
    "position_unit",
    "time_unit",
    "gravity_direction",
)
"""Mistakes that recordings of fingertips without torque can show: all forces in another unit are
those of an object as many times as heavy."""
