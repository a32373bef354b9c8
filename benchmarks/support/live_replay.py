"""A recording passed through the live estimator in the order of its stamps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.live.estimator import IncrementalInertialEstimator
from tactile_dynamics_ros.core.inertia.live.live_estimate import LiveEstimate
from tactile_dynamics_ros.core.streams.streams import (
    ContactSample,
    ContactStream,
    PoseStream,
    Streams,
    places_at,
)


def replay_streams(
    streams: Streams, estimator: IncrementalInertialEstimator | None = None, every: int = 1
) -> Iterator[LiveEstimate]:
    """Estimates as they would have been published live, one after so many poses.

    Args:
        streams: a recording with poses of the object.
        estimator: to feed; a new one by default.
        every: poses between two estimates.

    Raises:
        BadInputError: the recording has no poses.
    """
    if streams.pose is None:
        raise BadInputError("no /object/pose in the recording: the live estimator needs poses")
    estimator = estimator or IncrementalInertialEstimator()
    queues = [
        (contact, places_at(contact.pose_time, contact.position, contact.rotation, contact.time))
        for contact in streams.contacts.values()
    ]
    positions = [0] * len(queues)
    for k, time in enumerate(streams.pose.time):
        _add_pose(estimator, streams.pose, k)
        for index, (contact, places) in enumerate(queues):
            while positions[index] < len(contact.time) and contact.time[positions[index]] <= time:
                _add_contact(estimator, contact, positions[index], places)
                positions[index] += 1
        estimate = None if (k + 1) % every else estimator.update()
        if estimate is not None:
            yield estimate


def _add_pose(estimator: IncrementalInertialEstimator, pose: PoseStream, k: int) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation[k], pose.position[k]
    covariance = None if pose.covariance is None else pose.covariance[k]
    estimator.add_pose(float(pose.time[k]), matrix, covariance)


def _add_contact(
    estimator: IncrementalInertialEstimator,
    contact: ContactStream,
    k: int,
    places: tuple[Array, Array],
) -> None:
    sample = ContactSample(
        float(contact.time[k]),
        contact.name,
        places[0][k],
        places[1][k],
        contact.force[k],
        contact.torque[k] if contact.carries_torque else np.zeros(3),
        None if contact.force_std is None else contact.force_std[k],
    )
    estimator.add_contact(sample)
