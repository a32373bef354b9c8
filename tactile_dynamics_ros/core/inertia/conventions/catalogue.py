"""All readings of a recording."""

from __future__ import annotations

from tactile_dynamics_ros.core.inertia.conventions.imus import imu_readings
from tactile_dynamics_ros.core.inertia.conventions.poses import pose_readings
from tactile_dynamics_ros.core.inertia.conventions.reading import Reading
from tactile_dynamics_ros.core.inertia.conventions.wrenches import wrench_readings
from tactile_dynamics_ros.core.streams.streams import Streams


def readings_of(streams: Streams) -> list[Reading]:
    """Every other way in which a recording may have been meant; the commonest of equals first."""
    return [*wrench_readings(streams), *pose_readings(streams), *imu_readings(streams)]
