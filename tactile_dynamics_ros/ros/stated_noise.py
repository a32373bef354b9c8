"""What messages state of their noise, by one rule: what cannot be meant is counted and not used.

A statement that cannot be meant (`core.streams.pose_noise`; a standard deviation that is not
positive) costs no measurement: its noise is then what the samples show.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.streams.pose_noise import read_covariances
from tactile_dynamics_ros.ros.conversions import MessageError, covariance_to_core, pose_to_core
from tactile_dynamics_ros.ros.diagnostics import Faults
from tactile_dynamics_ros.ros.wire import Stamped

NOT_STATED = "covariance_not_stated"


def read_tracked_pose(
    message: Stamped, topic: str, frame: str, faults: Faults, planar: bool = False
) -> tuple[Array, Array | None]:
    """Return the pose (4, 4) of an object and its covariance (6, 6), None where none is stated.

    Args:
        message: PoseWithCovarianceStamped; position first.
        topic: for texts.
        frame: that the header has to name.
        faults: where a covariance that cannot be meant is counted.
        planar: whether the object lies on a table, so that x, y and yaw alone count.

    Raises:
        MessageError: wrong frame, pose not finite, bad quaternion, or its covariance says that the
            tracker has lost the object.
    """
    matrix = pose_to_core(message, topic, frame)
    said = read_covariances(covariance_to_core(message)[None], planar)
    for mistake in said.mistakes:
        faults.add(NOT_STATED, f"{topic}: {mistake}; taken as not stated")
    if said.lost[0]:
        deviation = np.sqrt(said.covariance[0].diagonal())
        raise MessageError(
            "pose_lost",
            f"{topic}: the tracker has lost the object: it states a standard deviation of "
            f"{deviation[3:].max():.3g} m and {deviation[:3].max():.3g} rad; taken as a gap",
        )
    return matrix, said.covariance[0] if said.stated[0] else None


def read_force_std(message: Stamped, topic: str, faults: Faults) -> Array | None:
    """Return standard deviations (3,) of a force, N; None where they cannot be meant.

    Args:
        message: Vector3Stamped.
        topic: for the text.
        faults: where one that is not finite, negative or zero is counted.
    """
    values = np.array(message.values, dtype=float)
    if all(0.0 < value < math.inf for value in values.tolist()):
        return values
    text = f"{topic}: {values.tolist()} N, expected positive; taken as not stated"
    faults.add("force_std_not_stated", text)
    return None
