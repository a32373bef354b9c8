"""Poses and contacts of the world as they lie on a support."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream

Array = NDArray[np.float64]

GRAVITY_W = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Support:
    """Axes of a support, z its normal upwards.

    Attributes:
        place: (3,) origin in the world, m.
        R_WS: (3, 3) axes in the world.
    """

    place: Array = field(default_factory=lambda: np.zeros(3))
    R_WS: Array = field(default_factory=lambda: np.eye(3))

    @property
    def gravity(self) -> Array:
        """(3,) m/s^2 in axes of the support."""
        return np.asarray(self.R_WS.T @ GRAVITY_W)

    def link(self, pose: PoseStream, footprint: Array) -> LinkStream:
        """Return a part by its poses and its outline (V, 2), m."""
        turn = self.R_WS.T @ pose.rotation
        yaw = np.unwrap(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
        place = (pose.position - self.place) @ self.R_WS
        planar = np.column_stack([place[:, :2], yaw])
        return LinkStream(pose.time, planar, self._planar_std(pose), footprint)

    def path(self, name: str, path: PoseStream, point_std: float | None) -> PushContact:
        """Return a contact of which only the way is known."""
        return PushContact(
            name=name,
            time=np.zeros(0),
            force=np.zeros((0, 3)),
            force_std=None,
            pose_time=path.time,
            point=(path.position - self.place) @ self.R_WS,
            normal=path.rotation[:, :, 2] @ self.R_WS,
            point_std=point_std,
        )

    def contact(self, felt: ContactStream, point_std: float | None) -> PushContact:
        """Return a contact with its forces."""
        std = felt.force_std
        return PushContact(
            name=felt.name,
            time=felt.time,
            force=felt.force @ self.R_WS,
            force_std=None if std is None else np.sqrt(np.median(std**2, axis=0)),
            pose_time=felt.pose_time,
            point=(felt.position - self.place) @ self.R_WS,
            normal=felt.rotation[:, :, 2] @ self.R_WS,
            point_std=point_std,
            torque=felt.torque @ self.R_WS if felt.carries_torque else None,
        )

    def _planar_std(self, pose: PoseStream) -> Array | None:
        """Return stated std of x, y and yaw on the support, or None."""
        if pose.covariance is None:
            return None
        turn, shift = pose.covariance[:, :3, :3], pose.covariance[:, 3:, 3:]
        variances = np.einsum("ia,nij,ja->na", self.R_WS, shift, self.R_WS)[:, :2]
        about = np.einsum("i,nij,j->n", self.R_WS[:, 2], turn, self.R_WS[:, 2])
        found = np.sqrt(np.median(np.column_stack([variances, about]), axis=0))
        return np.asarray(found) if np.all(found > 0.0) else None


def anticlockwise(corners: Array, where: str) -> Array:
    """Return the corners (V, 2) of an outline anticlockwise.

    Raises:
        BadInputError: there are fewer than three, or some are not numbers.
    """
    if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3:
        raise BadInputError(f"{where} has shape {corners.shape}; expected three corners (V, 2)")
    if not np.isfinite(corners).all():
        raise BadInputError(f"{where} has corners that are no numbers")
    after = np.roll(corners, -1, axis=0)
    area = np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0])
    return corners if area > 0.0 else corners[::-1]
