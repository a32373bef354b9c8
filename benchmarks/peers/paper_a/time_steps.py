"""Pose triples with the contacts at their first instant: data of paper A's dynamics factor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.streams import ContactStream, Streams, nearest_samples

_SAME_INSTANT = 0.5


@dataclass(frozen=True)
class TimeSteps:
    """K triples of consecutive poses and C contacts at the first pose of each.

    Attributes:
        time: (K, 3) s.
        rotation: (K, 3, 3, 3) R_WO of the triple.
        position: (K, 3, 3) p_WO, m.
        point: (K, C, 3) contact points in the body frame at the first pose, m.
        force: (K, C, 3) N on the object, likewise.
    """

    time: Array
    rotation: Array
    position: Array
    point: Array
    force: Array

    @classmethod
    def from_streams(cls, streams: Streams, stride: int = 1) -> TimeSteps:
        """Take every stride-th pose as the start of a triple; absent contacts have zero force.

        Raises:
            BadInputError: no poses, or fewer than 12 of them.
        """
        pose = streams.pose
        if pose is None or len(pose.time) < 12:
            raise BadInputError("paper A's method needs at least 12 poses of the object")
        first = np.arange(0, len(pose.time) - 2, stride)
        triple = first[:, None] + np.arange(3)
        readings = [_read(c, pose.time[first]) for c in streams.contacts.values()]
        rotation, position = pose.rotation[first], pose.position[first]
        force = np.stack([r[0] for r in readings], axis=1)
        point = np.stack([r[1] for r in readings], axis=1) - position[:, None]
        present = np.stack([r[2] for r in readings], axis=1)
        return cls(
            pose.time[triple],
            pose.rotation[triple],
            pose.position[triple],
            np.einsum("kji,kcj->kci", rotation, point) * present[..., None],
            np.einsum("kji,kcj->kci", rotation, force) * present[..., None],
        )


def _read(contact: ContactStream, time: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Force and point of the nearest reading, world axes, and whether there is one."""
    nearest = nearest_samples(contact.time, time)
    period = float(np.median(np.diff(contact.time)))
    present = np.abs(contact.time[nearest] - time) < _SAME_INSTANT * period + 1e-6
    return (
        contact.force[nearest],
        contact.position[nearest_samples(contact.pose_time, time)],
        present,
    )
