"""Measurements of one stream as columns of numbers, before they are cleaned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.core.streams.streams import between_turns

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoseColumns:
    """Poses as they were measured.

    Attributes:
        label: topic or array name for messages to the user.
        time: (N,) s.
        position: (N, 3) m.
        quaternion: (N, 4) xyzw.
        covariance: (N, 6, 6) [rotation, position], or None.
    """

    label: str
    time: Array
    position: Array
    quaternion: Array
    covariance: Array | None = None


@dataclass(frozen=True)
class WrenchColumns:
    """Wrenches of one contact as they were measured.

    Attributes:
        label: topic or array name for messages to the user.
        time: (N,) s.
        force: (N, 3) N on the object, world axes.
        torque: (N, 3) N m about the contact point, world axes.
    """

    label: str
    time: Array
    force: Array
    torque: Array

    def in_world_axes(self, pose: PoseColumns) -> WrenchColumns:
        """Return a wrench of a sensor's own axes in those of the world, turned by its poses.

        Where no pose is a rotation the wrench is not finite.
        """
        length = np.linalg.norm(pose.quaternion, axis=1)
        known = np.isfinite(pose.time) & np.isfinite(length) & (length > 0.0)
        if not known.any() or not len(self.time):
            return replace(self, force=np.full_like(self.force, np.nan))
        stamps, first = np.unique(pose.time[known], return_index=True)
        order = np.flatnonzero(known)[first]
        turned = quaternion_to_matrix(pose.quaternion[order] / length[order, None])
        time = np.where(np.isfinite(self.time), self.time, stamps[0])
        rotation = between_turns(stamps, turned, time)
        return replace(
            self,
            force=np.einsum("nij,nj->ni", rotation, self.force),
            torque=np.einsum("nij,nj->ni", rotation, self.torque),
        )


@dataclass(frozen=True)
class StdColumns:
    """Standard deviations of a contact's force: (M,) s and (M, 3) N."""

    label: str
    time: Array
    std: Array


@dataclass(frozen=True)
class ImuColumns:
    """An IMU on the object as it was measured; absent columns are None.

    Attributes:
        label: topic or array name for messages to the user.
        time: (N,) s.
        specific_force: (N, 3) m/s^2, body axes.
        quaternion: (N, 4) xyzw, or None.
        angular_velocity: (N, 3) rad/s, body axes, or None.
        specific_force_std: m/s^2 per axis, or None.
    """

    label: str
    time: Array
    specific_force: Array
    quaternion: Array | None = None
    angular_velocity: Array | None = None
    specific_force_std: float | None = None
