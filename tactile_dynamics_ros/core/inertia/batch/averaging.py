"""Streams that are faster than any motion, averaged to a rate that estimators can afford."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.local_polynomial import typical_period
from tactile_dynamics_ros.core.rigid_body.rotation import nearest_rotation
from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream, Streams

FAST = 125.0
"""Rate, Hz, to which faster streams are averaged. A motion of 2 Hz loses 4e-4 of itself in a mean
over 8 ms, of forces and of accelerations alike. Lower blurs motion, higher costs time in
proportion: windows of the motion hold as many samples more."""


def averaged(streams: Streams) -> Streams:
    """The same streams with means over 1 / `FAST` s in place of samples that come more than twice.

    All streams are cut at the same times, so that what forces and motion lose is the same. Noise is
    that of means of independent samples.

    Args:
        streams: at any rates.
    """
    pose, imu = streams.pose, streams.imu
    contacts = {name: _contact(one) for name, one in streams.contacts.items()}
    return replace(
        streams,
        pose=None if pose is None else _pose(pose),
        contacts=contacts,
        imu=None if imu is None else _imu(imu),
    )


class _Bins:
    """Samples by the 1 / `FAST` s that they fall into."""

    def __init__(self, time: Array) -> None:
        number = np.floor(time * FAST)
        self.starts = np.flatnonzero(np.diff(number, prepend=-np.inf))
        self.count = np.diff(np.append(self.starts, len(time))).astype(float)

    def mean(self, values: Array) -> Array:
        """Means (K, ...) of values (N, ...)."""
        total = np.add.reduceat(values, self.starts, axis=0)
        return np.asarray(total / self._over(total))

    def noise(self, variances: Array) -> Array:
        """Variances (K, ...) of means from those of samples (N, ...)."""
        mean = self.mean(variances)
        return np.asarray(mean / self._over(mean))

    def turn(self, rotations: Array) -> Array:
        """Mean rotations (K, 3, 3), nearest to the mean matrix."""
        return nearest_rotation(self.mean(rotations))

    def _over(self, values: Array) -> Array:
        return self.count.reshape(-1, *[1] * (values.ndim - 1))


def _is_fast(time: Array) -> bool:
    return len(time) > 1 and typical_period(time) <= 0.5 / FAST


def _pose(pose: PoseStream) -> PoseStream:
    if not _is_fast(pose.time):
        return pose
    bins = _Bins(pose.time)
    return replace(
        pose,
        time=bins.mean(pose.time),
        position=bins.mean(pose.position),
        rotation=bins.turn(pose.rotation),
        covariance=None if pose.covariance is None else bins.noise(pose.covariance),
    )


def _contact(contact: ContactStream) -> ContactStream:
    if _is_fast(contact.time):
        bins = _Bins(contact.time)
        std = contact.force_std
        contact = replace(
            contact,
            time=bins.mean(contact.time),
            force=bins.mean(contact.force),
            torque=bins.mean(contact.torque),
            force_std=None if std is None else np.sqrt(bins.noise(std**2)),
        )
    if _is_fast(contact.pose_time):
        bins = _Bins(contact.pose_time)
        contact = replace(
            contact,
            pose_time=bins.mean(contact.pose_time),
            position=bins.mean(contact.position),
            rotation=bins.turn(contact.rotation),
        )
    return contact


def _imu(imu: ImuStream) -> ImuStream:
    if not _is_fast(imu.time):
        return imu
    bins, std = _Bins(imu.time), imu.specific_force_std
    return replace(
        imu,
        time=bins.mean(imu.time),
        rotation=None if imu.rotation is None else bins.turn(imu.rotation),
        angular_velocity=(
            None if imu.angular_velocity is None else bins.mean(imu.angular_velocity)
        ),
        specific_force=bins.mean(imu.specific_force),
        specific_force_std=None if std is None else std / float(np.sqrt(np.median(bins.count))),
    )
