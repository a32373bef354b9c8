"""What another reading of a recording is, and the changes of streams that readings are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    PoseStream,
    Streams,
    between_turns,
    nearest_samples,
    on_lines,
)

CONVENTIONS = (
    "force_sign",
    "torque_sign",
    "force_unit",
    "torque_unit",
    "sensor_axes",
    "mirrored_axes",
    "world_axes",
    "quaternion_order",
    "inverse_rotation",
    "angle_unit",
    "position_unit",
    "time_unit",
    "gravity_direction",
    "gyro_unit",
    "gyro_sign",
    "acceleration_unit",
    "gravity_removed",
)
"""Names of the conventions, as `--assume` takes them. They are API: another name breaks commands
and reports that name it."""


@dataclass(frozen=True)
class Reading:
    """One way in which a recording may have been meant.

    Attributes:
        name: the convention, one of `CONVENTIONS`.
        change: what is done to read the recording right, in a few words.
        apply: the streams read so.
    """

    name: str
    change: str
    apply: Callable[[Streams], Streams]


def of_contacts(streams: Streams, change: Callable[[ContactStream], ContactStream]) -> Streams:
    """Streams with every contact changed."""
    contacts = {name: change(contact) for name, contact in streams.contacts.items()}
    return replace(streams, contacts=contacts)


def scaled_wrenches(streams: Streams, force: float, torque: float) -> Streams:
    """Streams with all forces and torques multiplied; stated deviations with the forces."""

    def scaled(contact: ContactStream) -> ContactStream:
        std = contact.force_std
        return replace(
            contact,
            force=force * contact.force,
            torque=torque * contact.torque,
            force_std=None if std is None else abs(force) * std,
        )

    return of_contacts(streams, scaled)


def turned_wrenches(
    streams: Streams, frame: str, by_force: Array, by_torque: Array | None = None
) -> Streams:
    """Streams whose forces and torques are multiplied by matrices in axes of a frame.

    Args:
        streams: measurements.
        frame: "sensor" for the contact's, "body" or "world".
        by_force: (3, 3).
        by_torque: (3, 3); that of the forces by default.
    """
    other = by_force if by_torque is None else by_torque

    def turned(contact: ContactStream) -> ContactStream:
        axes = axes_of(streams, contact, frame)
        return replace(
            contact,
            force=_within(axes, by_force, contact.force),
            torque=_within(axes, other, contact.torque),
        )

    return of_contacts(streams, turned)


def moved_axes(streams: Streams, frame: str, back: bool) -> Streams:
    """Streams whose recorded forces were in axes of a frame; or, `back`, were turned into it."""

    def moved(contact: ContactStream) -> ContactStream:
        axes = axes_of(streams, contact, frame)
        turn = np.swapaxes(axes, 1, 2) if back else axes
        return replace(
            contact,
            force=np.einsum("nij,nj->ni", turn, contact.force),
            torque=np.einsum("nij,nj->ni", turn, contact.torque),
        )

    return of_contacts(streams, moved)


def _within(axes: Array, matrix: Array, vectors: Array) -> Array:
    """A matrix applied to world vectors (N, 3) in axes (N, 3, 3)."""
    inside = np.einsum("nji,nj->ni", axes, vectors) @ matrix.T
    return np.asarray(np.einsum("nij,nj->ni", axes, inside))


def axes_of(streams: Streams, contact: ContactStream, frame: str) -> Array:
    """Axes (N, 3, 3) of a frame at the times of a contact's forces."""
    if frame == "sensor":
        return contact.rotation[nearest_samples(contact.pose_time, contact.time)]
    if frame == "body":
        return rotation_at(streams, contact.time)
    return np.broadcast_to(np.eye(3), (len(contact.time), 3, 3))


def rotation_at(streams: Streams, time: Array) -> Array:
    """Rotation of the object (N, 3, 3) between samples of its pose, or of the IMU's."""
    source = streams.pose or streams.imu
    assert source is not None and source.rotation is not None
    return between_turns(source.time, source.rotation, time)


def with_pose(streams: Streams, pose: PoseStream, carried: bool) -> Streams:
    """Streams with another pose of the object.

    Args:
        streams: measurements.
        pose: with the stamps of the old one.
        carried: whether contacts were put into the world by the old pose, so that they move too;
            if not, they are right where they are.
    """
    old = streams.pose
    assert old is not None
    changed = replace(streams, pose=pose)
    if not carried:
        return changed
    return of_contacts(changed, lambda contact: _carried(contact, old, pose))


def _carried(contact: ContactStream, old: PoseStream, new: PoseStream) -> ContactStream:
    turn = _turn(old, new, contact.time)
    place_turn = _turn(old, new, contact.pose_time)
    was = on_lines(old.time, old.position, contact.pose_time)
    now = on_lines(new.time, new.position, contact.pose_time)
    arm = np.einsum("nij,nj->ni", place_turn, contact.position - was)
    return replace(
        contact,
        force=np.einsum("nij,nj->ni", turn, contact.force),
        torque=np.einsum("nij,nj->ni", turn, contact.torque),
        position=now + arm,
        rotation=place_turn @ contact.rotation,
    )


def _turn(old: PoseStream, new: PoseStream, time: Array) -> Array:
    """Rotation (N, 3, 3) of the world from where the old pose had it to the new one."""
    before = between_turns(old.time, old.rotation, time)
    return np.asarray(between_turns(new.time, new.rotation, time) @ np.swapaxes(before, 1, 2))


def turned_world(streams: Streams, turn: Array, forces: bool = True) -> Streams:
    """Streams in a world turned by (3, 3): poses and places, and forces or not."""
    pose = streams.pose

    def turned(contact: ContactStream) -> ContactStream:
        return replace(
            contact,
            force=contact.force @ turn.T if forces else contact.force,
            torque=contact.torque @ turn.T if forces else contact.torque,
            position=contact.position @ turn.T,
            rotation=turn @ contact.rotation,
        )

    changed = of_contacts(streams, turned)
    if changed.imu is not None and changed.imu.rotation is not None:
        changed = replace(changed, imu=replace(changed.imu, rotation=turn @ changed.imu.rotation))
    if pose is None:
        return changed
    moved = replace(pose, position=pose.position @ turn.T, rotation=turn @ pose.rotation)
    if pose.covariance is not None:
        block = np.kron(np.eye(2), turn)
        moved = replace(moved, covariance=block @ pose.covariance @ block.T)
    return replace(changed, pose=moved)
