"""Parts of streams by time, and several recordings of one object as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.streams import ContactStream, ImuStream, PoseStream, Streams

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


Stream = TypeVar("Stream", PoseStream, ContactStream, ImuStream)

PAUSE = 10.0
"""Time between joined recordings, s: longer than any window, and than what spectra keep as silence
(2 s), so that nothing is derived across it. More makes grids longer, whose empty part costs
memory."""


def join_streams(parts: Sequence[Streams]) -> Streams:
    """Put recordings one after the other, each after a pause; a missing contact sends zeros.

    Args:
        parts: of one object, in the same body and world frames.

    Returns:
        One of them as it is; of several, `session_starts` tells when each begins.

    Raises:
        BadInputError: none is given, or some have poses or an IMU and others do not.
    """
    if not parts:
        raise BadInputError("no recording to read; expected one at least")
    if len(parts) == 1:
        return parts[0]
    for what in ("pose", "imu"):
        if len({getattr(part, what) is None for part in parts}) > 1:
            raise BadInputError(
                f"some of the {len(parts)} recordings have {what} samples and others do not; ask "
                "about those that were recorded alike"
            )
    names = list(dict.fromkeys(name for part in parts for name in part.contacts))
    shifted, starts, begin = [], [], 0.0
    for part in parts:
        first, last = _span(part)
        starts.append(begin)
        shifted.append(_moved(_with_contacts(part, names), begin - first))
        begin += last - first + PAUSE
    poses = [part.pose for part in shifted if part.pose is not None]
    imus = [part.imu for part in shifted if part.imu is not None]
    return Streams(
        pose=_joined(poses, _POSE, ("covariance",)) if poses else None,
        contacts={name: _joined_contact([p.contacts[name] for p in shifted]) for name in names},
        imu=_joined(imus, _IMU, _IMU_OPTIONAL) if imus else None,
        session_starts=tuple(starts),
    )


_POSE = ("time", "position", "rotation")
"""Fields of poses that are rows, one per sample, and are put one after the other; a field that is
missing here would keep the length of the first recording alone."""
_CONTACT = ("time", "force", "torque", "pose_time", "position", "rotation")
"""Fields of contacts that are rows, one per sample; one that is missing here would keep the length
of the first recording alone."""
_IMU = ("time", "specific_force")
"""Fields of an IMU that are rows, one per sample; one that is missing here would keep the length of
the first recording alone."""
_IMU_OPTIONAL = ("rotation", "angular_velocity")
"""Fields of an IMU that are rows where all recordings have them, and are left out where one has
not; among `_IMU` an IMU without them could not be joined."""


def _span(part: Streams) -> tuple[float, float]:
    """First and last stamp of all streams, s."""
    stamps = [c.time for c in part.contacts.values()]
    stamps += [c.pose_time for c in part.contacts.values()]
    stamps += [s.time for s in (part.pose, part.imu) if s is not None]
    held = [time for time in stamps if len(time)]
    return min(float(t[0]) for t in held), max(float(t[-1]) for t in held)


def _with_contacts(part: Streams, names: Sequence[str]) -> Streams:
    """The recording with contacts that it lacks as such that do not touch."""
    like = next(iter(part.contacts.values()))
    zero = np.zeros_like(like.force)
    absent = {
        name: replace(like, name=name, force=zero, torque=zero, carries_torque=False)
        for name in names
        if name not in part.contacts
    }
    return replace(part, contacts=part.contacts | absent)


def _moved(part: Streams, shift: float) -> Streams:
    contacts = {
        name: replace(c, time=c.time + shift, pose_time=c.pose_time + shift)
        for name, c in part.contacts.items()
    }
    pose = part.pose and replace(part.pose, time=part.pose.time + shift)
    imu = part.imu and replace(part.imu, time=part.imu.time + shift)
    return replace(part, contacts=contacts, pose=pose, imu=imu)


def _joined(streams: Sequence[Stream], rows: Sequence[str], optional: Sequence[str]) -> Stream:
    """One stream of all rows; optional ones that a part lacks are left out of all."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(s, name) for s in streams]) for name in rows
    }
    for name in optional:
        parts = [getattr(s, name) for s in streams]
        columns[name] = None if any(part is None for part in parts) else np.concatenate(parts)
    return replace(streams[0], **columns)


def _joined_contact(streams: Sequence[ContactStream]) -> ContactStream:
    joined = _joined(streams, _CONTACT, ("force_std",))
    return replace(joined, carries_torque=any(s.carries_torque for s in streams))
