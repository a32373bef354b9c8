"""Parts of streams by time."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream, Streams

Array = NDArray[np.float64]
Rows: TypeAlias = slice | NDArray[np.bool_]


def cut_streams(streams: Streams, start: float, stop: float) -> Streams:
    """Return the samples with start <= time < stop; contacts without any are left out.

    Args:
        streams: the whole.
        start: s.
        stop: s.
    """
    contacts = {name: _cut_contact(c, start, stop) for name, c in streams.contacts.items()}
    return Streams(
        pose=streams.pose and _cut_pose(streams.pose, start, stop),
        contacts={name: c for name, c in contacts.items() if len(c.time) and len(c.pose_time)},
        imu=streams.imu and _cut_imu(streams.imu, start, stop),
        session_starts=streams.session_starts,
    )


def _inside(time: Array, start: float, stop: float) -> slice:
    """Return the rows of increasing times within an interval."""
    first, last = np.searchsorted(time, [start, stop])
    return slice(int(first), int(last))


def _cut_pose(pose: PoseStream, start: float, stop: float) -> PoseStream:
    return pose_rows(pose, _inside(pose.time, start, stop))


def pose_rows(pose: PoseStream, rows: Rows) -> PoseStream:
    """Return some of the poses."""
    return replace(
        pose,
        time=pose.time[rows],
        position=pose.position[rows],
        rotation=pose.rotation[rows],
        covariance=None if pose.covariance is None else pose.covariance[rows],
    )


def _cut_contact(contact: ContactStream, start: float, stop: float) -> ContactStream:
    rows = _inside(contact.time, start, stop)
    return contact_rows(contact, rows, _inside(contact.pose_time, start, stop))


def contact_rows(contact: ContactStream, rows: Rows, poses: Rows) -> ContactStream:
    """Return some of the forces and some of the poses of a contact."""
    return replace(
        contact,
        time=contact.time[rows],
        force=contact.force[rows],
        torque=contact.torque[rows],
        force_std=None if contact.force_std is None else contact.force_std[rows],
        pose_time=contact.pose_time[poses],
        position=contact.position[poses],
        rotation=contact.rotation[poses],
    )


def _cut_imu(imu: ImuStream, start: float, stop: float) -> ImuStream:
    rows = _inside(imu.time, start, stop)
    return replace(
        imu,
        time=imu.time[rows],
        rotation=None if imu.rotation is None else imu.rotation[rows],
        angular_velocity=None if imu.angular_velocity is None else imu.angular_velocity[rows],
        specific_force=imu.specific_force[rows],
    )
