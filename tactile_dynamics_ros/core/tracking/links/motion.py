"""Pose and velocity of a link between images: a Kalman filter with unknown accelerations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3

_LONGEST_STEP = 0.2
"""Time, s, for which a velocity is believed to go on: three images. A push ends within it; longer
carries a hidden link away from where it stopped, shorter loses one that moves on."""
_FIRST_SPEED, _FIRST_TURN = 0.05, 0.3
"""Standard deviations of the velocity at first, m/s and rad/s: that of slow pushes. Larger ones let
the first images alone tell the pose, which they do anyway."""
UNKNOWN_STD = np.array([10.0] * 3 + [1.0] * 3)
"""Largest standard deviation, rad and m: more than a whole turn, more than the table. Without a
limit, what no image shows (the turn of a cylinder) would grow until numbers lose their digits."""


@dataclass(frozen=True)
class LinkMotionConfig:
    """How suddenly a pushed link moves."""

    acceleration: float = parameter(2.0, "std of accelerations between images", "m/s^2", 0.01, 1e3)
    turning: float = parameter(10.0, "std of turning accelerations", "rad/s^2", 0.01, 1e4)

    def __post_init__(self) -> None:
        check_ranges(self)


class LinkMotion:
    """Pose X_WO of a link about its middle, with velocity and covariance of both.

    The error is [turn, shift of the middle] in world axes, restricted to the motions that are
    possible (x, y and yaw on a support).

    Args:
        pose: (4, 4) X_WO.
        covariance: (6, 6) of it.
        centre: (3,) middle, object frame, m.
        free: indices of the possible motions.
        config: accelerations.

    Attributes:
        pose: (4, 4) at `time`. twist: (6,) velocity. time: s, None before the first image.
    """

    def __init__(
        self,
        pose: Array,
        covariance: Array,
        centre: Array,
        free: tuple[int, ...],
        config: LinkMotionConfig,
    ) -> None:
        self.pose, self.twist = np.array(pose, dtype=float), np.zeros(6)
        self.time: float | None = None
        self.free = list(free)
        self._centre, count = centre, len(free)
        self._acceleration = np.array([config.turning] * 3 + [config.acceleration] * 3)[self.free]
        speed = np.array([_FIRST_TURN] * 3 + [_FIRST_SPEED] * 3)[self.free]
        self._covariance = np.zeros((2 * count, 2 * count))
        self._covariance[:count, :count] = covariance[np.ix_(self.free, self.free)]
        self._covariance[count:, count:] = np.diag(speed**2)

    def predicted(self, time: float) -> Array:
        """Return X_WO (4, 4) at a time after the last image, if it moves on for a while."""
        step = 0.0 if self.time is None else min(time - self.time, _LONGEST_STEP)
        return self._moved(step * self.twist)

    def correct(self, pose: Array, information: Array, time: float) -> Array:
        """Take the pose of an image and return the covariance (K, K) of the possible motions.

        Args:
            pose: (4, 4) X_WO that the image shows.
            information: (K, K) of it.
            time: s, of the image.
        """
        self._advance(time)
        count = len(self.free)
        prior = self._covariance[:, :count]
        gain = prior @ np.linalg.inv(np.eye(count) + information @ prior[:count]) @ information
        step = gain @ self._difference(pose)[self.free]
        self._covariance -= gain @ prior.T
        self._covariance = 0.5 * (self._covariance + self._covariance.T)
        motion = np.zeros(6)
        motion[self.free] = step[:count]
        self.pose = self._moved(motion)
        self.twist[self.free] += step[count:]
        return self._covariance[:count, :count].copy()

    def _advance(self, time: float) -> None:
        """Carry the state on to a time."""
        step = 0.0 if self.time is None else max(time - self.time, 0.0)
        self.pose = self.predicted(time)
        if step > _LONGEST_STEP:
            self.twist = np.zeros(6)
        self.time = time
        count = len(self.free)
        carry = np.eye(2 * count)
        carry[:count, count:] = step * np.eye(count)
        noise = np.concatenate([0.5 * step**2 * self._acceleration, step * self._acceleration])
        shared = np.tile(np.eye(count), (2, 2))
        grown = carry @ self._covariance @ carry.T + shared * np.outer(noise, noise)
        limit = np.tile(UNKNOWN_STD[self.free], 2)
        scale = np.minimum(1.0, limit / np.sqrt(np.maximum(np.diag(grown), 1e-18)))
        self._covariance = grown * np.outer(scale, scale)

    def _moved(self, motion: Array) -> Array:
        """Return the pose after a turn about the middle and a shift of it (6,)."""
        pose = self.pose.copy()
        turn = exp_so3(motion[:3])
        pose[:3, :3] = turn @ self.pose[:3, :3]
        pose[:3, 3] += motion[3:] + (self.pose[:3, :3] - pose[:3, :3]) @ self._centre
        return pose

    def _difference(self, pose: Array) -> Array:
        """Return turn and shift (6,) of the middle from here to a pose."""
        shift = (pose[:3, :3] - self.pose[:3, :3]) @ self._centre + pose[:3, 3] - self.pose[:3, 3]
        return np.concatenate([log_so3(pose[:3, :3] @ self.pose[:3, :3].T), shift])
