"""Time-stamped measurements of one held object, as the estimators take them.

World frame: z up. Contact forces are those that the finger applies **on the object**.
Spatial vectors and covariances are ordered [rotation, translation].
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import turned_between


@dataclass(frozen=True)
class PoseStream:
    """Pose of the object in the world, X_WO.

    Attributes:
        time: (N,) seconds, strictly increasing.
        position: (N, 3) p_WO in metres.
        rotation: (N, 3, 3) R_WO.
        covariance: (N, 6, 6) [rotation about world axes, position], or None if not stated.
        white: whether the covariance is that of white noise; if not, slow errors may be in it.
    """

    time: Array
    position: Array
    rotation: Array
    covariance: Array | None = None
    white: bool = False


@dataclass(frozen=True)
class ContactSample:
    """What one contact applies on the object at one instant, world axes; zero means no contact.

    Attributes:
        time: s. name: of the finger or sensor.
        point: (3,) m. rotation: (3, 3) contact frame, z the normal into the object.
        force: (3,) N. torque: (3,) N m about the point, for contacts that carry torque.
        std: (3,) N of the force, or None if it is not stated.
    """

    time: float
    name: str
    point: Array
    rotation: Array
    force: Array
    torque: Array = field(default_factory=lambda: np.zeros(3))
    std: Array | None = None

    @property
    def touches(self) -> bool:
        """Whether it applies anything."""
        return bool(self.force.any() or self.torque.any())

    def moved(self, motion: Array) -> ContactSample:
        """Return the contact after a motion (4, 4) of the world."""
        turn = motion[:3, :3]
        return replace(
            self,
            point=turn @ self.point + motion[:3, 3],
            rotation=turn @ self.rotation,
            force=turn @ self.force,
            torque=turn @ self.torque,
        )


@dataclass(frozen=True)
class ContactStream:
    """Force (and torque) that one contact applies on the object, and where.

    Attributes:
        name: the finger, or "wrist" for a flange force/torque sensor.
        time: (N,) seconds, strictly increasing, of the wrench.
        force: (N, 3) newtons, world axes.
        torque: (N, 3) N m about the contact point, world axes (zero for point contacts).
        force_std: (N, 3) newtons, or None if not stated.
        pose_time: (M,) seconds of the contact pose.
        position: (M, 3) contact point in the world, metres.
        rotation: (M, 3, 3) contact frame in the world; its z axis is the normal into the object.
        carries_torque: whether the torque is measured (a force/torque sensor) or zero by kind.
        own_axes: whether noise is what the samples show along the axes of the contact frame; if
            not, it is as stated, or the same along all axes.
    """

    name: str
    time: Array
    force: Array
    torque: Array
    force_std: Array | None
    pose_time: Array
    position: Array
    rotation: Array
    carries_torque: bool = False
    own_axes: bool = False


@dataclass(frozen=True)
class ImuStream:
    """An IMU at the body origin, axes of the body frame.

    Attributes:
        time: (N,) seconds.
        rotation: (N, 3, 3) R_WO, or None if the IMU gives no orientation.
        angular_velocity: (N, 3) rad/s, body frame, or None if the IMU has no gyroscope.
        specific_force: (N, 3) R_OW (a - g) in m/s^2, body frame.
        specific_force_std: m/s^2 per axis, or None if not stated.
    """

    time: Array
    rotation: Array | None
    angular_velocity: Array | None
    specific_force: Array
    specific_force_std: float | None = None


@dataclass(frozen=True)
class Streams:
    """All that was measured of one held object.

    Attributes:
        pose: of the object, or None.
        contacts: by name.
        imu: on the object, or None.
        session_starts: s, when each of several recordings begins that are joined in these streams;
            empty for a single one.
    """

    pose: PoseStream | None
    contacts: dict[str, ContactStream] = field(default_factory=dict)
    imu: ImuStream | None = None
    session_starts: tuple[float, ...] = ()


def nearest_samples(stamps: Array, time: Array) -> NDArray[np.int64]:
    """Index (N,) of the sample nearest to each time; the earlier one where two are as near.

    Args:
        stamps: (K,) s, increasing.
        time: (N,) s.
    """
    right = np.clip(np.searchsorted(stamps, time), 1, max(len(stamps) - 1, 1))
    right = np.minimum(right, len(stamps) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(time - stamps[left] <= stamps[right] - time, left, right)


def enclosing_steps(stamps: Array, time: Array) -> tuple[NDArray[np.int64], Array]:
    """Sample (N,) before each time (the first or last but one at the ends), and step (N,) after it.

    Args:
        stamps: (K,) s, increasing, two at least.
        time: (N,) s.
    """
    left = np.clip(np.searchsorted(stamps, time, side="right") - 1, 0, len(stamps) - 2)
    return left, stamps[left + 1] - stamps[left]


def on_lines(stamps: Array, values: Array, time: Array) -> Array:
    """Values (N, k) on lines between samples, those of the first and last sample beyond them.

    Args:
        stamps: (K,) s, increasing.
        values: (K, k).
        time: (N,) s.
    """
    return np.stack([np.interp(time, stamps, column) for column in values.T], axis=1)


def between_turns(stamps: Array, rotation: Array, time: Array) -> Array:
    """Rotations (N, 3, 3) on the shortest turns between samples, those of the ends beyond them.

    Args:
        stamps: (K,) s, increasing.
        rotation: (K, 3, 3).
        time: (N,) s.
    """
    if len(stamps) < 2:
        return np.asarray(rotation[np.zeros(len(time), dtype=np.int64)])
    left, step = enclosing_steps(stamps, time)
    share = np.clip((time - stamps[left]) / step, 0.0, 1.0)
    return turned_between(rotation[left], rotation[left + 1], share)


def places_at(
    pose_time: Array, position: Array, rotation: Array, time: Array
) -> tuple[Array, Array]:
    """Contact points (N, 3), on lines between poses, and rotations (N, 3, 3) between theirs.

    Args:
        pose_time: (M,) s, increasing.
        position: (M, 3) m.
        rotation: (M, 3, 3).
        time: (N,) s.
    """
    return on_lines(pose_time, position, time), between_turns(pose_time, rotation, time)
