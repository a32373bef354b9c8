"""Readings of an IMU: units, sign, and whether gravity is still in it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.constants import g

from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W
from tactile_dynamics_ros.core.inertia.conventions.reading import Reading, rotation_at
from tactile_dynamics_ros.core.streams.streams import Streams

_ACCELERATIONS = {"g": g, "mg": 1e-3 * g, "cm/s^2": 1e-2}
"""m/s^2 per unit that accelerometers report. Definitions; a unit that is missing here is not found,
each costs a reading to be weighed."""
_RATES = {"deg/s": np.pi / 180.0, "rpm": np.pi / 30.0}
"""rad/s per unit that gyroscopes report. Definitions; a unit that is missing here is not found,
each costs a reading to be weighed."""


def imu_readings(streams: Streams) -> list[Reading]:
    """Readings of the IMU of a recording; none where there is none."""
    imu = streams.imu
    if imu is None:
        return []
    found = [
        Reading(
            "acceleration_unit",
            f"accelerations are in {unit}, not m/s^2",
            partial(scaled_acceleration, scale=scale),
        )
        for unit, scale in _ACCELERATIONS.items()
    ]
    if streams.pose is not None or imu.rotation is not None:
        text = "gravity was taken out of the accelerations: put it back"
        found.append(Reading("gravity_removed", text, with_gravity))
    if imu.angular_velocity is not None:
        found += [
            Reading("gyro_unit", f"angular velocities are in {unit}, not rad/s",
                    partial(scaled_gyro, scale=scale))
            for unit, scale in _RATES.items()
        ]  # fmt: skip
        found.append(
            Reading("gyro_sign", "negate angular velocities", partial(scaled_gyro, scale=-1.0))
        )
    return found


def scaled_acceleration(streams: Streams, scale: float) -> Streams:
    """Streams with accelerations of the IMU multiplied."""
    imu = streams.imu
    assert imu is not None
    std = imu.specific_force_std
    changed = replace(
        imu,
        specific_force=scale * imu.specific_force,
        specific_force_std=None if std is None else scale * std,
    )
    return replace(streams, imu=changed)


def scaled_gyro(streams: Streams, scale: float) -> Streams:
    """Streams with angular velocities of the IMU multiplied."""
    imu = streams.imu
    assert imu is not None and imu.angular_velocity is not None
    return replace(streams, imu=replace(imu, angular_velocity=scale * imu.angular_velocity))


def with_gravity(streams: Streams) -> Streams:
    """Streams with accelerations of the IMU as an accelerometer at rest feels them."""
    imu = streams.imu
    assert imu is not None
    weight = np.einsum("nji,j->ni", rotation_at(streams, imu.time), -GRAVITY_W)
    return replace(streams, imu=replace(imu, specific_force=imu.specific_force + weight))
